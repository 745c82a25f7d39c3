"""The collision cone: where a velocity leads into a safety sphere, and the tangents that avoid it.

X is the sphere's centre relative to the vehicle and V the vehicle's velocity relative to the
sphere, so that a moving obstacle is one that stands still. In the plane of X and V two tangents p_1
and p_2 touch the sphere, and V = a p_1 + b p_2 (thesis (3.16)-(3.19), IISc (A9)-(A19)). The thesis
prints u_1 and u_2 without the vector X after their first brackets.

V lies between the tangents where a > 0 and b > 0 (3.20), by more than rounding. Since
a - b = 1 / (c d) is never negative, p_1 is always the nearer one: the second line of (3.21) cannot
happen.
"""

from __future__ import annotations

import math

from visenvs.core.compile import kernel

HEAD_ON = 1e-9  # squared sine below which X and V span no plane
EDGE = 1e-6  # b / a of a velocity along the tangent, which a law reaches but for rounding


@kernel
def dot(p, q):
    """Inner product of two vectors (3,)."""
    return p[0] * q[0] + p[1] * q[1] + p[2] * q[2]


@kernel
def coordinates(X, V, d):
    """c (s/m) of (3.17), and a and b (1/s) of (3.19).

    Args:
        X, V: relative position (m) and velocity (m/s), (3,).
        d: radius of the sphere, m.

    Head-on there is no plane: c is infinite, a and b are what they tend to. Inside the sphere there
    are no tangents: all three are 0.
    """
    XX, VV, XV = dot(X, X), dot(V, V), dot(X, V)
    outside, plane = XX - d * d, XX * VV - XV * XV
    if outside <= 0.0:
        return 0.0, 0.0, 0.0
    half = 0.5 * XV / outside
    if plane <= HEAD_ON * XX * VV:
        return math.inf, half, half
    c = math.sqrt(outside / plane)
    return c, half + 0.5 / (c * d), half - 0.5 / (c * d)


@kernel
def leads_in(a, b):
    """Whether a velocity leads into the sphere, from its coordinates a and b (3.20)."""
    return b > EDGE * a


@kernel
def tangents(X, V, d, c, p1, p2):
    """Write the vectors p_1 and p_2 (3,), m, from the vehicle to the points of contact (3.16).

    c: of `coordinates`, finite and above 0.
    """
    XX, cXV = dot(X, X), c * dot(X, V)
    for i in range(3):
        p1[i] = X[i] + d * (c * V[i] - (cXV + d) * X[i] / XX)
        p2[i] = X[i] + d * ((cXV - d) * X[i] / XX - c * V[i])


@kernel
def way_out(X, d, p):
    """Write the virtual aiming point (3,), m: the point of the sphere straight out (IISc B).

    Of a vehicle inside the sphere, so that it lies on the side away from the centre. Returns
    whether there is such a point: none from the centre itself.
    """
    r = math.sqrt(dot(X, X))
    for i in range(3):
        p[i] = X[i] - d * X[i] / r if r > 0.0 else 0.0
    return r > 0.0


@kernel
def abeam(X, V, d, p):
    """Write the point (3,), m, of the sphere across the line of sight from its centre.

    To the side that V leads to, the vehicle's velocity relative to the sphere, m/s. Returns whether
    there is such a point: none head-on.
    """
    XX, VV, XV = dot(X, X), dot(V, V), dot(X, V)
    for i in range(3):
        p[i] = V[i] - XV / XX * X[i] if XX > 0.0 else V[i]
    across = dot(p, p)
    if across <= HEAD_ON * VV:
        return False
    for i in range(3):
        p[i] = X[i] + d / math.sqrt(across) * p[i]
    return True


@kernel
def is_farther(p, q, X, d, Y, e):
    """Whether p is at least as far as q from the middle of two spheres' overlap (IISc (4.5)-(4.6)).

    Args:
        p, q: points, (3,). X, Y: centres of the spheres, (3,), of radius d and e. All in m.
    """
    square, toward_p, toward_q = 0.0, 0.0, 0.0
    for i in range(3):
        square += (Y[i] - X[i]) ** 2
    share = 0.5 * (1.0 + (d * d - e * e) / square) if square > 0.0 else 0.0
    for i in range(3):
        middle = X[i] + share * (Y[i] - X[i])
        toward_p += (p[i] - middle) ** 2
        toward_q += (q[i] - middle) ** 2
    return toward_p >= toward_q


@kernel
def time_to(p, V, lateral):
    """Time until the vehicle is level with a point, s: -1 where it never will be.

    Args:
        p: the point relative to the vehicle, m. V: the vehicle's velocity relative to it, m/s.
        lateral: level means at the same north coordinate (thesis (3.22) as a duration, IISc (4.4));
            otherwise nearest to it along V.
    """
    ahead, pace = (p[0], V[0]) if lateral else (dot(p, V), dot(V, V))
    return ahead / pace if pace != 0.0 else -1.0
