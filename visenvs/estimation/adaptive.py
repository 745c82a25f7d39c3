"""Filters of a leader whose acceleration nobody models (tracking paper, section 5).

State: position, velocity and acceleration of the leader in N, each (3,): x (9,), P (9, 9). An image
with a subtended angle is turned into a measured position, so that filter and model are linear,
(28)-(30). They differ in where the acceleration comes from:

- `kf`: there is none. The Kalman filter without adaptation.
- `kf-nn`: the network (36), nu = W' sigma(mu), of 12 neurons, one of them constant. Their inputs
  are fixed random sums of the measured position and its delayed differences (32)-(33); the weights
  learn from what the filter keeps correcting its velocity by. Axes of N, as the paper has it.
- `kf-nn-velocity`: the same in axes along the estimated horizontal velocity.
- `kf-integrator`: those axes and the constant neuron alone, that is an integrator.
- `kf-singer`: no network; the acceleration is a state that decays (Singer 1970).

For all but the last the acceleration is an input: its rows of P are zero. The paper leaves the
weights' law to its references. Here it is dW/dt = G (sigma e' - kappa |e| W), with e-modification
and e = K_v (y - yhat) / T, where T is the camera's period. It needs G |sigma|^2 < sqrt(2) lambda
with lambda = (q / (R T))^(1/4): the network has to be slower than the filter that teaches it.
"""

from __future__ import annotations

import math

import numpy as np

from visenvs.core.compile import kernel
from visenvs.core.frames import camera_towards
from visenvs.core.units import FOOT
from visenvs.estimation.ekf import update_sequential, white_acceleration

KINDS = ("kf", "kf-nn", "kf-nn-velocity", "kf-integrator", "kf-singer")
PLAIN, NETWORK, TURNED, INTEGRATOR, SINGER = range(len(KINDS))
NEURONS, INPUTS, DELAY = 12, 10, 20
HISTORY = 2 * DELAY + 1  # camera periods that the inputs look back, and now
START_VELOCITY, START_ACCELERATION = 5.0, 2.0  # standard deviations at the start, m/s and m/s^2
UNKNOWN = 1e12  # variance of a range that nothing tells, m^2
LARGEST = 32 * FOOT  # acceleration that the network may tell, m/s^2
POSITION, RATE, SECOND = 1000 * FOOT, 100 * FOOT, 10 * FOOT  # what is 1 in the inputs
# sines of squares have no pattern, mean 0 and, times a root of 2, variance 1
V = (math.sqrt(2.0) * np.sin(np.arange(1.0, NEURONS * INPUTS + 1.0) ** 2)).reshape(NEURONS, INPUTS)

TRACK = np.dtype([
    ("x", "f8", (9,)), ("P", "f8", (9, 9)),
    ("nu", "f8", (3,)),  # acceleration that the network tells, in its axes
    ("W", "f8", (NEURONS, 3)),
    ("history", "f8", (HISTORY, 3)),  # of measured positions in N, the newest first; else predicted
])  # fmt: skip
SCRATCH = np.dtype([
    ("H", "f8", (3, 9)), ("residual", "f8", (3,)), ("variance", "f8", (3,)),
    ("B", "f8", (3, 9)), ("S", "f8", (3,)),
    ("y", "f8", (3,)), ("v", "f8", (3,)), ("e", "f8", (3,)),
    ("mu", "f8", (INPUTS,)), ("sigma", "f8", (NEURONS,)),
])  # fmt: skip


@kernel
def begin(f, kind, own, sight, cfg, w):
    """Start at the first measured position, with the follower's own velocity as a guess.

    Args:
        f, w: TRACK and SCRATCH records.
        kind: place in KINDS.
        own, sight, cfg: records as `estimation.formation` describes them.
    """
    x, P = f["x"], f["P"]
    locate(own, sight, own["range_told"], w)
    spread(distance_between(w["y"], own["r_V_N"]), own, sight, cfg, w)
    for i in range(9):
        x[i] = 0.0
        for j in range(9):
            P[i, j] = 0.0
    for i in range(3):
        x[i], x[i + 3] = w["y"][i], own["v_V_N"][i]
        for k in range(HISTORY):
            f["history"][k, i] = x[i] - k * cfg["dt"] * x[i + 3]
        for j in range(3):
            for k in range(3):
                P[i, j] += w["H"][k, i] * w["H"][k, j] * w["variance"][k]
        P[i + 3, i + 3] = START_VELOCITY**2
        P[i + 6, i + 6] = START_ACCELERATION**2 if kind == SINGER else 0.0
        f["nu"][i] = 0.0
        for k in range(NEURONS):
            f["W"][k, i] = 0.0


@kernel
def predict(f, kind, cfg):
    """Let the leader fly on for a period."""
    if kind == SINGER:
        drift(f["x"], f["P"], cfg["dt"], cfg["q_jerk"], cfg["singer_rate"])
    else:
        drift(f["x"], f["P"], cfg["dt"], cfg["q_velocity"], 0.0)
        steer(f, kind)
    remember(f["history"], f["x"])


@kernel
def update(f, kind, own, sight, belief, cfg, w):
    """Use a measured position, and let the network learn from what it corrects.

    Writes the innovation and the NIS of the position into `belief`.
    """
    x, innovation = f["x"], belief["innovation"]
    distance = max(distance_between(x, own["r_V_N"]), 1.0)
    locate(own, sight, distance, w)
    spread(distance, own, sight, cfg, w)
    for i in range(3):
        w["v"][i], w["residual"][i] = x[i + 3], 0.0
        for k in range(3):
            w["residual"][i] += w["H"][i, k] * (w["y"][k] - x[k])
        f["history"][0, i] = w["y"][i]
    innovation[0], innovation[1] = w["residual"][1] / distance, w["residual"][2] / distance
    innovation[2] = 0.0
    if sight["alpha"] > 0.0:
        innovation[2] = sight["alpha"] - 2.0 * math.atan(0.5 * own["size_told"] / distance)
    belief["nis"] = update_sequential(
        x, f["P"], w["H"], w["residual"], w["variance"], 0.0, w["B"], w["S"]
    )
    if kind in (NETWORK, TURNED, INTEGRATOR):
        for i in range(3):
            w["e"][i] = (x[i + 3] - w["v"][i]) / cfg["dt"]
        listen(f, kind, cfg["dt"], w)
        learn(f, kind, cfg["adapt_gain"], cfg["adapt_decay"], cfg["dt"], w)
        steer(f, kind)


@kernel
def describe(f, own, belief):
    """Write what is believed, relative to the follower. The wingspan is taken as it was told."""
    x, P, square, along = f["x"], f["P"], 0.0, 0.0
    for i in range(3):
        belief["r_LV_N"][i] = x[i] - own["r_V_N"][i]
        belief["v_LV_N"][i] = x[i + 3] - own["v_V_N"][i]
        belief["a_L_N"][i] = x[i + 6]
        square += belief["r_LV_N"][i] ** 2
    for i in range(6):
        for j in range(6):
            belief["C"][i, j] = P[i, j]
    for i in range(3):
        for j in range(3):
            along += belief["r_LV_N"][i] * P[i, j] * belief["r_LV_N"][j]
    belief["sd_log_range"] = math.sqrt(max(along, 0.0)) / max(square, 1.0)
    belief["b"], belief["sd_b"] = own["size_told"], 0.0


@kernel
def locate(own, sight, distance, w):
    """Write the measured position r_V + b / (2 tan(alpha / 2)) u and axes along and across u.

    Args:
        distance: to be taken where there is no subtended angle, m.
        w: y and H are written.
    """
    u = sight["u_N"]
    if sight["alpha"] > 0.0:
        distance = 0.5 * own["size_told"] / math.tan(0.5 * sight["alpha"])
    camera_towards(u, w["H"])
    for i in range(3):
        w["y"][i] = own["r_V_N"][i] + distance * u[i]


@kernel
def spread(distance, own, sight, cfg, w):
    """Write the variances of a position measured at a distance (m): along the sight, and across.

    They are (r^2 sigma_alpha / b)^2, without the angle as good as infinite, and (r sigma)^2 twice.
    """
    across = distance * cfg["sigma_image"]
    w["variance"][0] = UNKNOWN
    if sight["alpha"] > 0.0:  # from two wing tips
        w["variance"][0] = 2.0 * (distance * across / own["size_told"]) ** 2
    w["variance"][1] = w["variance"][2] = across * across


@kernel
def drift(x, P, dt, q, rate):
    """Advance a constant acceleration, or one that decays, and its covariance, in place.

    Args:
        x, P: position, velocity, acceleration in N, (9,), and covariance (9, 9).
        q: spectral density of the white noise: with a rate on the acceleration, m^2/s^5, and
            without one on the velocity, m^2/s^3.
        rate: of the acceleration's decay (Singer's alpha), 1/s; 0 where it is given.
    """
    keep, ahead, grow = 1.0, 0.5 * dt * dt, dt
    if rate > 0.0:
        keep = math.exp(-rate * dt)
        grow = (1.0 - keep) / rate
        ahead = (dt - grow) / rate
    for i in range(3):
        x[i] += dt * x[i + 3] + ahead * x[i + 6]
        x[i + 3] += grow * x[i + 6]
        x[i + 6] *= keep
    for a in range(9):
        for i in range(3):
            P[i, a] += dt * P[i + 3, a] + ahead * P[i + 6, a]
            P[i + 3, a] += grow * P[i + 6, a]
            P[i + 6, a] *= keep
    for a in range(9):
        for i in range(3):
            P[a, i] += dt * P[a, i + 3] + ahead * P[a, i + 6]
            P[a, i + 3] += grow * P[a, i + 6]
            P[a, i + 6] *= keep
    place, both, speed = white_acceleration(q, dt)
    for i in range(3):
        if rate > 0.0:
            P[i + 6, i + 6] += q * dt
        else:
            P[i, i] += place
            P[i, i + 3] += both
            P[i + 3, i] += both
            P[i + 3, i + 3] += speed
    for i in range(9):
        for j in range(i):
            P[i, j] = P[j, i] = 0.5 * (P[i, j] + P[j, i])


@kernel
def steer(f, kind):
    """Write the network's acceleration, turned from its axes into N, into the state."""
    c, s = heading(f["x"], kind)
    nu = f["nu"]
    f["x"][6], f["x"][7] = c * nu[0] - s * nu[1], s * nu[0] + c * nu[1]
    f["x"][8] = nu[2]


@kernel
def heading(x, kind):
    """Cosine and sine of the heading of the network's axes: the estimated course, or north."""
    speed = math.hypot(x[3], x[4])
    if speed == 0.0 or kind == NETWORK:
        return 1.0, 0.0
    return x[3] / speed, x[4] / speed


@kernel
def distance_between(a, b):
    """Length of the difference of the first three numbers of two arrays."""
    return math.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)


@kernel
def remember(history, y):
    """Push a position (its first three numbers) into the delay line."""
    for k in range(HISTORY - 1, 0, -1):
        for i in range(3):
            history[k, i] = history[k - 1, i]
    for i in range(3):
        history[0, i] = y[i]


@kernel
def listen(f, kind, period, w):
    """Write the network's inputs (32)-(33) and its neurons' outputs, in its axes."""
    mu, sigma, history = w["mu"], w["sigma"], f["history"]
    c, s = heading(f["x"], kind)
    sigma[0] = 1.0
    if kind == INTEGRATOR:
        for k in range(1, NEURONS):
            sigma[k] = 0.0
        return
    d = DELAY * period
    mu[0] = 1.0
    for i in range(3):
        now, before, first = history[0, i], history[DELAY, i], history[2 * DELAY, i]
        mu[1 + i] = now / POSITION
        mu[4 + i] = (now - before) / (d * RATE)
        mu[7 + i] = (now - 2.0 * before + first) / (d * d * SECOND)
    for j in range(1, INPUTS, 3):
        north, east = mu[j], mu[j + 1]
        mu[j], mu[j + 1] = c * north + s * east, c * east - s * north
    for k in range(1, NEURONS):
        total = 0.0
        for j in range(INPUTS):
            total += V[k, j] * mu[j]
        sigma[k] = math.tanh(total)


@kernel
def learn(f, kind, gain, decay, period, w):
    """Move the weights by what the filter keeps correcting, then write the network's output."""
    c, s = heading(f["x"], kind)
    e, sigma, W, nu = w["e"], w["sigma"], f["W"], f["nu"]
    e[0], e[1] = c * e[0] + s * e[1], c * e[1] - s * e[0]
    size = math.sqrt(e[0] * e[0] + e[1] * e[1] + e[2] * e[2])
    for i in range(3):
        nu[i] = 0.0
        for k in range(NEURONS):
            W[k, i] += period * gain * (sigma[k] * e[i] - decay * size * W[k, i])
            nu[i] += W[k, i] * sigma[k]
    length = math.sqrt(nu[0] * nu[0] + nu[1] * nu[1] + nu[2] * nu[2])
    if length > LARGEST:
        for i in range(3):
            nu[i] *= LARGEST / length
