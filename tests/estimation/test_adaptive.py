"""Filters of an unmodelled leader: textbook oracles, consistency, and when adaptation holds."""

import math

import numpy as np
import pytest
from scipy import stats
from scipy.linalg import expm

from visenvs.estimation import adaptive

pytestmark = pytest.mark.kernel

OWN = np.dtype(
    [("r_V_N", "f8", (3,)), ("v_V_N", "f8", (3,)), ("size_told", "f8"), ("range_told", "f8")]
)
SIGHT = np.dtype([("u_N", "f8", (3,)), ("alpha", "f8")])
BELIEF = np.dtype(
    [(name, "f8", (3,)) for name in ("r_LV_N", "v_LV_N", "a_L_N", "innovation")]
    + [(name, "f8") for name in ("sd_log_range", "b", "sd_b", "nis")]
    + [("C", "f8", (6, 6))]
)
SIZE, ALPHA = 2.67, math.sqrt(2.0)  # wingspan, m; noise of the angle over that of a point
NUMBERS = {"dt": 0.1, "sigma_image": 2e-3, "q_velocity": 0.1, "q_jerk": 0.4}
NUMBERS |= {"singer_rate": 0.1, "adapt_gain": 0.15, "adapt_decay": 0.03}
SETTINGS = np.dtype([(name, "f8") for name in NUMBERS])
ADAPTIVE = ("kf-nn", "kf-nn-velocity", "kf-integrator")


def settings(**changes):
    out = np.zeros(1, SETTINGS)
    for name, value in (NUMBERS | changes).items():
        out[name] = value
    return out[0]


def empty():
    """Records of a filter, its scratch, the follower, an image and the belief."""
    out = [np.zeros(1, t)[0] for t in (adaptive.TRACK, adaptive.SCRATCH, OWN, SIGHT, BELIEF)]
    out[2]["size_told"], out[2]["range_told"] = SIZE, 30.0
    return out


def look(own, sight, r_L, cfg, rng=None):
    """Write what a camera at the follower sees of a leader at r_L, with noise or without."""
    r = np.asarray(r_L) - own["r_V_N"]
    distance = np.linalg.norm(r)
    u, alpha = r / distance, 2.0 * math.atan(0.5 * SIZE / distance)
    if rng is not None:
        u = u + cfg["sigma_image"] * rng.normal(size=3)
        u /= np.linalg.norm(u)
        alpha += ALPHA * cfg["sigma_image"] * rng.normal()
    sight["u_N"], sight["alpha"] = u, alpha


def fly(estimator, seconds, leader, seed=0, **changes):
    """Follow 20 m behind the place of a leader (t -> position); (k, 9) states and own places."""
    cfg, rng = settings(**changes), np.random.default_rng(seed)
    kind = adaptive.KINDS.index(estimator)
    f, w, own, sight, belief = empty()
    out = []
    for k in range(round(seconds / cfg["dt"]) + 1):
        t, h = k * cfg["dt"], 1e-3
        own["r_V_N"] = leader(t) - [20.0, 4.0, 3.0]
        look(own, sight, leader(t), cfg, rng)
        if k == 0:
            own["v_V_N"] = (leader(h) - leader(-h)) / (2 * h)
            adaptive.begin(f, kind, own, sight, cfg, w)
        else:
            adaptive.predict(f, kind, cfg)
            adaptive.update(f, kind, own, sight, belief, cfg, w)
        out.append(f["x"].copy())
    return np.array(out)


def circle(t, V=22.86, omega=0.1):
    return np.array([math.sin(omega * t), 1.0 - math.cos(omega * t), 0.0]) * V / omega


@pytest.mark.parametrize("rate", [0.0, 0.1, 3.0])
def test_the_drift_is_the_exponential_of_the_model(rate):
    rng, dt, q = np.random.default_rng(1), 0.3, 0.7
    x, root = rng.normal(size=9), rng.normal(size=(9, 9))
    P = root @ root.T
    A = np.kron(np.array([[0, 1, 0], [0, 0, 1], [0, 0, -rate]]), np.eye(3))
    Phi = expm(A * dt)
    Q = np.zeros((9, 9))
    if rate:
        Q[6:, 6:] = q * dt * np.eye(3)
    else:
        Q[:6, :6] = q * np.kron([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]], np.eye(3))
    expected = Phi @ x, Phi @ P @ Phi.T + Q
    adaptive.drift(x, P, dt, q, rate)
    assert x == pytest.approx(expected[0], rel=1e-12)
    assert P == pytest.approx(expected[1], rel=1e-12)
    assert np.array_equal(P, P.T)


def test_a_measured_position_is_the_leader_with_the_errors_it_is_given():
    cfg, rng, r_L = settings(), np.random.default_rng(2), np.array([130.0, -40.0, 12.0])
    _, w, own, sight, _ = empty()
    own["r_V_N"] = 100.0, -35.0, 20.0
    places = []
    for noise in [None] + 4000 * [rng]:
        look(own, sight, r_L, cfg, noise)
        adaptive.locate(own, sight, 1.0, w)
        places.append(w["y"].copy())
    assert places[0] == pytest.approx(r_L)
    H, variance = w["H"][:, :3], w["variance"]
    assert H @ H.T == pytest.approx(np.eye(3), abs=1e-12)
    adaptive.spread(np.linalg.norm(r_L - own["r_V_N"]), own, sight, cfg, w)
    errors = (np.array(places[1:]) - r_L) @ H.T
    assert errors.std(axis=0) == pytest.approx(np.sqrt(variance), rel=0.1)


def test_an_update_is_the_textbook_one():
    cfg, rng, kind = settings(), np.random.default_rng(3), adaptive.PLAIN
    f, w, own, sight, belief = empty()
    root = rng.normal(size=(9, 9))
    x, P, r_L = rng.normal(size=9), root @ root.T, np.array([30.0, 5.0, -4.0])
    x[:3] += r_L
    f["x"], f["P"] = x, P
    look(own, sight, r_L, cfg)
    adaptive.update(f, kind, own, sight, belief, cfg, w)
    C, H = np.eye(3, 9), w["H"][:, :3]
    R = H.T @ np.diag(w["variance"]) @ H
    S = C @ P @ C.T + R
    gain = P @ C.T @ np.linalg.inv(S)
    assert f["x"] == pytest.approx(x + gain @ (r_L - x[:3]), abs=1e-8)
    assert f["P"] == pytest.approx(P - gain @ C @ P, abs=1e-8)
    assert belief["nis"] == pytest.approx((r_L - x[:3]) @ np.linalg.solve(S, r_L - x[:3]))


def test_bearings_alone_leave_the_range_alone():
    cfg, kind = settings(), adaptive.PLAIN
    f, w, own, sight, belief = empty()
    look(own, sight, [30.0, 0.0, 0.0], cfg)
    adaptive.begin(f, kind, own, sight, cfg, w)
    f["P"][:3, :3] = 25.0 * np.eye(3)
    look(own, sight, [30.0, 1.0, 0.0], cfg)
    sight["alpha"] = 0.0
    adaptive.update(f, kind, own, sight, belief, cfg, w)
    across = np.array([-1.0, 30.0, 0.0]) / math.hypot(1.0, 30.0)
    assert sight["u_N"] @ f["P"][:3, :3] @ sight["u_N"] == pytest.approx(25.0, rel=1e-6)
    assert across @ f["P"][:3, :3] @ across == pytest.approx((30.0 * 2e-3) ** 2, rel=0.01)
    assert f["x"][1] == pytest.approx(1.0, rel=0.05)


def manoeuvre(kind, r, v, a, cfg, rng):
    """One period of white noise on the velocity, or on an acceleration that decays."""
    dt, rate = cfg["dt"], cfg["singer_rate"]
    if kind == adaptive.SINGER:
        grow = (1.0 - math.exp(-rate * dt)) / rate
        noise = math.sqrt(cfg["q_jerk"] * dt) * rng.normal(size=3)
        r = r + dt * v + (dt - grow) / rate * a
        return r, v + grow * a, math.exp(-rate * dt) * a + noise
    kick, other = math.sqrt(cfg["q_velocity"] * dt) * rng.normal(size=(2, 3))
    return r + dt * (v + 0.5 * kick + other / math.sqrt(12.0)), v + kick, a


@pytest.mark.parametrize("estimator", ["kf", "kf-singer"])
def test_it_is_consistent_where_the_leader_does_what_it_assumes(estimator):
    """NEES of position and velocity over runs with the process noise of the filter."""
    runs, steps, cfg, rng = 60, 100, settings(), np.random.default_rng(4)
    kind = adaptive.KINDS.index(estimator)
    nees = []
    for _ in range(runs):
        f, w, own, sight, belief = empty()
        a = np.zeros(3)
        r, v = np.array([20.0, 5.0, -3.0]), adaptive.START_VELOCITY * rng.normal(size=3)
        if kind == adaptive.SINGER:
            a = adaptive.START_ACCELERATION * rng.normal(size=3)
        for k in range(steps):
            look(own, sight, r, cfg, rng)
            if k == 0:
                adaptive.begin(f, kind, own, sight, cfg, w)
                continue
            r, v, a = manoeuvre(kind, r, v, a, cfg, rng)
            own["r_V_N"] = r - [20.0, 5.0, -3.0]
            look(own, sight, r, cfg, rng)
            adaptive.predict(f, kind, cfg)
            adaptive.update(f, kind, own, sight, belief, cfg, w)
        adaptive.describe(f, own, belief)
        error = np.r_[belief["r_LV_N"] - (r - own["r_V_N"]), belief["v_LV_N"] - v]
        nees.append(error @ np.linalg.solve(belief["C"], error))
    low, high = stats.chi2.ppf([1e-4, 1 - 1e-4], 6 * runs) / runs
    assert low < np.mean(nees) < high


@pytest.mark.parametrize("estimator", [*ADAPTIVE, "kf-singer"])
def test_the_acceleration_of_a_circle_is_found(estimator):
    gain = 0.5 if estimator == "kf-integrator" else 0.1
    states = fly(estimator, 60.0, circle, adapt_gain=gain, seed=5)[400:]
    t = 40.0 + 0.1 * np.arange(len(states))
    inwards = 2.286 * np.stack([-np.sin(0.1 * t), np.cos(0.1 * t)], axis=1)
    errors = states[:, 6:8] - inwards
    assert np.abs(errors.mean(axis=0)).max() < 0.3
    assert np.sqrt((errors**2).sum(axis=1).mean()) < 0.7
    assert not fly("kf", 20.0, circle)[:, 6:].any()


def test_the_network_must_be_slower_than_its_filter():
    """G |sigma|^2 < sqrt(2) lambda: half of it settles, twice of it swings to the bound."""
    variance = (20.6**2 * 2e-3 * ALPHA / SIZE) ** 2
    limit = math.sqrt(2.0) * (NUMBERS["q_velocity"] / (variance * 0.1)) ** 0.25

    def straight(t):
        return np.array([22.0 * t, 0.0, 0.0])

    slow, fast = (
        np.linalg.norm(
            fly("kf-integrator", 60.0, straight, adapt_gain=k * limit, adapt_decay=0.0)[300:, 6:],
            axis=1,
        ).max()
        for k in (0.5, 2.0)
    )
    assert slow < 3.0
    assert fast > 0.9 * adaptive.LARGEST


def test_weights_stay_without_an_image():
    cfg, kind = settings(), adaptive.TURNED
    f, w, own, sight, belief = empty()
    own["v_V_N"] = 22.0, 0.0, 0.0
    rng = np.random.default_rng(6)
    for k in range(30):
        look(own, sight, own["r_V_N"] + [20.0, 0.02 * k**2, 0.0], cfg, rng)
        if k == 0:
            adaptive.begin(f, kind, own, sight, cfg, w)
        adaptive.predict(f, kind, cfg)
        adaptive.update(f, kind, own, sight, belief, cfg, w)
    weights, nu = f["W"].copy(), f["nu"].copy()
    for _ in range(30):
        adaptive.predict(f, kind, cfg)
    assert np.abs(weights).max() > 0.0
    assert np.array_equal(f["W"], weights)
    assert np.array_equal(f["nu"], nu)
    assert np.array_equal(f["history"][0], f["x"][:3])


def test_its_inputs_are_delayed_differences():
    """On a parabola they are its velocity a delay ago and its acceleration."""
    cfg = settings()
    f, w, *_ = empty()
    p, v, a = np.array([[90.0, -60.0, 30.0], [9.0, 6.0, -3.0], [0.9, -0.6, 0.3]])
    d = adaptive.DELAY * cfg["dt"]
    for k in range(adaptive.HISTORY):
        t = -k * cfg["dt"]
        f["history"][k] = p + v * t + 0.5 * a * t * t
    adaptive.listen(f, adaptive.NETWORK, cfg["dt"], w)
    assert w["mu"][0] == 1.0
    assert w["mu"][1:4] == pytest.approx(p / adaptive.POSITION)
    assert w["mu"][4:7] == pytest.approx((v - 0.5 * d * a) / adaptive.RATE)
    assert w["mu"][7:] == pytest.approx(a / adaptive.SECOND)
    assert w["sigma"][0] == 1.0
    assert w["sigma"][1:] == pytest.approx(np.tanh(adaptive.V @ w["mu"])[1:])


def test_the_fixed_weights_look_drawn():
    assert adaptive.V.mean() == pytest.approx(0.0, abs=0.2)
    assert adaptive.V.std() == pytest.approx(1.0, abs=0.1)
    products = adaptive.V @ adaptive.V.T / adaptive.INPUTS
    assert np.abs(products[np.triu_indices(adaptive.NEURONS, 1)]).max() < 0.9
