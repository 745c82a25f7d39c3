"""What a camera tells of one object: an image point, or two angles; geometry and size of the noise.

IMAGE: (y, z) = (Y/X, Z/X) in C (thesis (3.3)). ANGLES: (theta, phi) of the relative position in C,
theta = atan2(Y, X) to the right, phi = atan2(Z, sqrt(X^2 + Y^2)) downwards (IISc (3.19)). Filters
measure with it, sensors simulate with it.
"""

from __future__ import annotations

import math

from visenvs.core.bearing import bearing_slope
from visenvs.core.compile import kernel
from visenvs.core.frames import direction, rotate, wrap_angle
from visenvs.core.pinhole import jacobian, pixel_variance, project

SENSORS = ("image", "angles")  # the order of the codes
IMAGE, ANGLES = range(2)


@kernel
def see(sensor, C, r, nearest):
    """The noise-free measurement of an object, and the distance that its noise depends on.

    Args:
        sensor: IMAGE or ANGLES.
        C: camera attitude C_CN, (3, 3).
        r: position of the object relative to the camera in N, m, (3,).
        nearest: least distance, m: along the optical axis (IMAGE), or to the object (ANGLES).

    Returns:
        The two measured numbers; the depth (IMAGE) or the range (ANGLES), m, at least `nearest`.
    """
    if sensor == IMAGE:
        X, y, z = project(C, r, nearest)
        return y, z, X
    X, Y, Z = rotate(C, r)
    theta, phi, length = to_angles(X, Y, Z)
    return theta, phi, max(length, nearest)


@kernel
def to_angles(X, Y, Z):
    """Angles theta and phi (rad) and length of a vector (IISc (3.19))."""
    flat = math.sqrt(X * X + Y * Y)
    return math.atan2(Y, X), math.atan2(Z, flat), math.sqrt(flat * flat + Z * Z)


@kernel
def slope(sensor, C, r, nearest, H):
    """Write the derivative of the measurement by r, shape (2, 3), 1/m.

    Nearer than `nearest` it is that of an object at `nearest`; for theta this is the distance from
    the vertical axis of the camera.
    """
    if sensor == IMAGE:
        X, y, z = project(C, r, nearest)
        jacobian(C, X, y, z, H)
    else:
        X, Y, Z = rotate(C, r)
        flat = math.sqrt(X * X + Y * Y)
        theta_X, theta_Y = bearing_slope(X, Y, nearest)
        phi_flat, phi_Z = bearing_slope(flat, Z, nearest)
        out = phi_flat / max(flat, nearest)
        for j in range(3):
            H[0, j] = theta_X * C[0, j] + theta_Y * C[1, j]
            H[1, j] = out * (X * C[0, j] + Y * C[1, j]) + phi_Z * C[2, j]


@kernel
def turn(theta, phi, A):
    """Write the unit vector with these angles and its derivatives by theta and phi, as columns.

    The vector is (cos phi cos theta, cos phi sin theta, sin phi) (IISc (3.20)); A has shape (3, 3).
    """
    A[0, 0], A[1, 0], A[2, 0] = direction(theta, -phi)
    A[0, 1], A[1, 1], A[2, 1] = -A[1, 0], A[0, 0], 0.0
    A[0, 2], A[1, 2], A[2, 2] = direction(theta, -phi - 0.5 * math.pi)


@kernel
def ray(sensor, C, first, second, A, D):
    """Write where a measurement points, in N, and its derivatives by the two measured numbers.

    Args:
        first, second: the measurement.
        A: scratch, (3, 3).
        D: columns d, dd/dfirst, dd/dsecond, shape (3, 3). The object is at `distance` d: a depth
            for IMAGE (d = C' (1, y, z)), a range for ANGLES (d is a unit vector).
    """
    if sensor == IMAGE:
        for i in range(3):
            for j in range(3):
                A[i, j] = 1.0 if i == j else 0.0
        A[1, 0], A[2, 0] = first, second
    else:
        turn(first, second, A)
    for i in range(3):
        for j in range(3):
            D[i, j] = C[0, i] * A[0, j] + C[1, i] * A[1, j] + C[2, i] * A[2, j]


@kernel
def differ(sensor, measured, predicted):
    """Measured minus predicted number; angles by the shorter way round."""
    return wrap_angle(measured - predicted) if sensor == ANGLES else measured - predicted


@kernel
def noise_variance(distance, settings):
    """Variance of each of the two measured numbers at the distance that `see` returns.

    IMAGE: `pinhole.pixel_variance`. ANGLES: sigma_angle (1 - fade^range), squared; the IISc report
    has sigma_angle = 20 % of 120 degrees / 3 and fade = 0.99 per metre (3.25)-(3.26).

    Args:
        settings: record with sensor, sigma_range (m), sigma_angle (rad for ANGLES), fade (in
            [0, 1): 0 is noise of the same size everywhere).
    """
    if settings["sensor"] == IMAGE:
        return pixel_variance(distance, settings["sigma_range"], settings["sigma_angle"])
    sigma = settings["sigma_angle"] * (1.0 - settings["fade"] ** distance)
    return sigma * sigma
