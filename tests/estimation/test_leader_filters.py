"""Filters of a leader: first image, prediction, update and consistency against textbooks."""

import math

import numba
import numpy as np
import pytest
from scipy import stats

from tests.estimation.test_leader_models import V_OWN, B, polar_state
from visenvs.core.noise import normal
from visenvs.estimation.formation import (
    BELIEF,
    CARTESIAN,
    EKF,
    EKF_LOG,
    EKF_NATURAL,
    ESTIMATORS,
    LEADER,
    SCRATCH,
    SIGHT,
    SUBSTEPS,
    TRACK,
    TRUTH,
    UKF,
    begin,
    describe,
    predict,
    update,
)

pytestmark = pytest.mark.kernel

FILTERS = (EKF, EKF_LOG, EKF_NATURAL, CARTESIAN, UKF)
POLAR = (EKF, EKF_LOG, EKF_NATURAL)
NUMBERS = {
    "dt": 0.1, "sigma_image": 0.002, "sd_size": 0.02, "sd_range": 0.3, "sd_velocity": 3.0,
    "sd_lat": 1.0, "sd_up": 0.0, "q_a": 0.01, "q_lat": 0.004, "q_up": 0.0, "q_velocity": 0.1,
    "q_jerk": 0.4, "singer_rate": 0.1, "adapt_gain": 0.1, "adapt_decay": 0.1,
}  # fmt: skip
SETTINGS = np.dtype([("estimator", "i8"), *((name, "f8") for name in NUMBERS)])
OWN = np.dtype([
    ("r_V_N", "f8", 3), ("v_V_N", "f8", 3), ("push", "f8", (SUBSTEPS, 3)), ("size_told", "f8"),
    ("range_told", "f8"),
])  # fmt: skip


def settings(estimator, **changes):
    cfg = np.zeros(1, SETTINGS)
    for name, value in (NUMBERS | changes).items():
        cfg[name] = value
    cfg["estimator"] = estimator
    return cfg[0]


def own_at(v=V_OWN, push=(0.0, 0.0, 0.0)):
    own = np.zeros(1, OWN)
    own["v_V_N"], own["push"], own["size_told"], own["range_told"] = v, push, B, 30.0
    return own[0]


def image(r, b=B, noise=(0.0, 0.0, 0.0), wings=True):
    """A sight of a leader at r with angular noise to the right, down and of the wing tips."""
    sight, u = np.zeros(1, SIGHT), r / np.linalg.norm(r)
    right = np.array([-u[1], u[0], 0.0]) / math.hypot(u[0], u[1])
    measured = u + noise[0] * right + noise[1] * np.cross(u, right)
    sight["u_N"] = measured / np.linalg.norm(measured)
    if wings:
        sight["alpha"] = 2 * math.atan(0.5 * b / np.linalg.norm(r)) + noise[2]
    return sight[0]


class Filter:
    """A filter with its records."""

    def __init__(self, estimator, **changes):
        self.cfg = settings(estimator, **changes)
        self.track, self.work = np.zeros(1, TRACK)[0], np.zeros(1, SCRATCH)[0]
        self.belief = np.zeros(1, BELIEF)[0]

    def begin(self, own, sight):
        begin(self.track, own, sight, self.cfg, self.work)
        return self.tell(own)

    def predict(self, own):
        predict(self.track, own, self.cfg, self.work)
        return self.tell(own)

    def update(self, own, sight):
        update(self.track, own, sight, self.belief, self.cfg, self.work)
        return self.tell(own)

    def tell(self, own):
        describe(self.track, own, np.zeros(1, LEADER)[0], self.belief, self.cfg, self.work)
        return self.belief


@pytest.mark.parametrize("estimator", FILTERS)
def test_the_first_image_gives_the_range_and_what_its_error_is(estimator):
    """The spread of range and wingspan against many drawn images: they err together."""
    r, n = np.array([28.0, 4.0, -5.0]), 400
    far = np.linalg.norm(r)
    ranges = []
    for k in range(n):
        size = B * math.exp(0.02 * normal(1, 0, 0, k, 3))
        noise = [0.002 * normal(1, 0, 0, k, i) for i in range(2)]
        noise.append(0.002 * math.sqrt(2) * normal(1, 0, 0, k, 2))
        sight = image(r, size, noise)
        ranges.append(B / (2 * math.tan(0.5 * sight["alpha"])))
    filter_ = Filter(estimator)
    belief = filter_.begin(own_at(), image(r))
    assert belief["r_LV_N"] == pytest.approx(r, abs=1e-9)
    assert np.std(np.log(np.array(ranges) / far)) == pytest.approx(belief["sd_log_range"], rel=0.12)
    u = r / far
    assert math.sqrt(u @ belief["C"][:3, :3] @ u) == pytest.approx(
        far * belief["sd_log_range"], rel=1e-9
    )
    assert belief["sd_b"] == pytest.approx(0.02 * B, rel=1e-9)


@pytest.mark.parametrize("estimator", FILTERS)
def test_a_prediction_moves_mean_and_covariance_as_points_move(estimator):
    """No noise: the estimate follows the exact motion, its covariance the linear one."""
    r, v = np.array([30.0, 2.0, -4.0]), np.array([1.0, -0.5, 0.3])
    push = np.array([0.5, -1.0, 0.2])
    filter_ = Filter(estimator, q_a=0.0, q_lat=0.0, sd_lat=0.0, sd_velocity=0.5, sd_size=1e-6)
    filter_.begin(own_at(), image(r))
    if estimator in POLAR:
        filter_.track["polar"]["x"][:] = polar_state(r, v, 0.0)
    else:
        filter_.track["cartesian"]["x"][3:6] = v
    before = filter_.tell(own_at())["C"].copy()
    dt = filter_.cfg["dt"]
    belief = filter_.predict(own_at(V_OWN + dt * push, push))
    assert belief["r_LV_N"] == pytest.approx(r + dt * v - 0.5 * dt * dt * push, abs=2e-4)
    assert belief["v_LV_N"] == pytest.approx(v - dt * push, abs=2e-3)
    Phi = np.eye(6) + dt * np.eye(6, k=3)
    assert belief["C"] == pytest.approx(Phi @ before @ Phi.T, abs=3e-3 * np.abs(before).max())


def textbook(estimator, filter_, sight):
    """The update by matrices, in error coordinates where they are polar."""
    track = filter_.track["polar" if estimator in POLAR else "cartesian"]
    x, P = track["x"].copy(), track["P"].copy()
    r = x[:3] / x[6] if estimator in POLAR else x[:3]
    b = x[8] if estimator in POLAR else x[6]
    u, far = r / np.linalg.norm(r), np.linalg.norm(r)
    right = np.array([-u[1], u[0], 0.0]) / math.hypot(u[0], u[1])
    axes, half = np.array([right, np.cross(u, right)]), 0.5 * b / far
    share = 2 * half / (1 + half * half)
    H = np.zeros((3, len(x)))
    if estimator in POLAR:
        H[:2, :3] = axes
        H[2, 6], H[2, 8] = share, share
        if estimator == EKF_NATURAL:
            H[2, 6], H[2, 8] = share * far, share / b
    else:
        H[:2, :3], H[2, :3], H[2, 6] = axes / far, -share * u / far, share / b
    e = np.array([*(axes @ sight["u_N"]), sight["alpha"] - 2 * math.atan(half)])
    R = 0.002**2 * np.diag([1.0, 1.0, 2.0])
    S = H @ P @ H.T + R
    K = P @ H.T @ np.linalg.inv(S)
    if estimator == EKF:
        K[8] = 0.0
    left = np.eye(len(x)) - K @ H
    return x, K @ e, left @ P @ left.T + K @ R @ K.T, e @ np.linalg.solve(S, e), e


@pytest.mark.parametrize("estimator", [EKF, EKF_LOG, EKF_NATURAL, CARTESIAN])
def test_an_update_is_the_textbooks(estimator):
    """Joseph form with a gain of zero for a considered wingspan; then the constraints."""
    r = np.array([30.0, 2.0, -4.0])
    filter_ = Filter(estimator)
    filter_.begin(own_at(), image(r))
    filter_.predict(own_at())
    sight = image(r + np.array([1.0, 0.1, 0.05]), noise=(0.001, -0.002, 0.003))
    x, step, P, nis, e = textbook(estimator, filter_, sight)
    belief = filter_.update(own_at(), sight)
    track = filter_.track["polar" if estimator in POLAR else "cartesian"]
    if estimator in (EKF, EKF_LOG):
        new = x + step
        new[6], new[8] = x[6] * math.exp(step[6]), x[8] * math.exp(step[8])
    else:
        new = x + step
    if estimator in POLAR:
        new[:3] /= np.linalg.norm(new[:3])
        new[3:6] -= new[:3] * (new[:3] @ new[3:6])
    assert track["x"] == pytest.approx(new, rel=1e-8, abs=1e-10)
    scale = np.sqrt(np.outer(np.diag(P), np.diag(P))) + 1e-12
    assert track["P"] / scale == pytest.approx(P / scale, abs=1e-7)
    assert belief["nis"] == pytest.approx(nis, rel=1e-6)
    assert belief["innovation"] == pytest.approx(e, abs=1e-12)


def test_the_unscented_update_is_the_extended_one_where_the_spread_is_small():
    r = np.array([30.0, 2.0, -4.0])
    told = {}
    for estimator in (UKF, CARTESIAN):
        filter_ = Filter(estimator, sd_velocity=0.1, sd_size=0.005)
        filter_.begin(own_at(), image(r))
        for _ in range(3):
            filter_.predict(own_at())
            told[estimator] = filter_.update(own_at(), image(r, noise=(1e-3, -1e-3, 2e-3)))
    one, other = told[UKF], told[CARTESIAN]
    assert one["r_LV_N"] == pytest.approx(other["r_LV_N"], abs=0.02)
    assert np.diag(one["C"]) == pytest.approx(np.diag(other["C"]), rel=0.02)


@pytest.mark.parametrize("estimator", POLAR)
def test_constraints_hold_after_prediction_and_update(estimator):
    r = np.array([30.0, 2.0, -4.0])
    filter_ = Filter(estimator)
    filter_.begin(own_at(), image(r))
    for k in range(20):
        filter_.predict(own_at(push=(0.5, -1.0, 0.3)))
        for step in range(2):
            x = filter_.track["polar"]["x"]
            assert np.linalg.norm(x[:3]) == pytest.approx(1.0, abs=1e-12)
            assert x[:3] @ x[3:6] == pytest.approx(0.0, abs=1e-12)
            if step == 0:
                filter_.update(own_at(), image(r, noise=(0.002, 0.001 * k, 0.001)))


def test_a_considered_wingspan_stays_as_told_and_a_known_one_has_no_doubt():
    r = np.array([30.0, 2.0, -4.0])
    for estimator, spread in ((EKF, 0.02), (EKF_LOG, 0.0), (CARTESIAN, 0.0), (UKF, 0.0)):
        filter_ = Filter(estimator, sd_size=spread)
        filter_.begin(own_at(), image(r))
        for k in range(10):
            filter_.predict(own_at(push=(0.0, 1.0, 0.0)))
            belief = filter_.update(own_at(), image(r, 1.1 * B, noise=(0.0, 0.0, 1e-3 * k)))
        assert belief["b"] == pytest.approx(B, abs=1e-9)
        assert belief["sd_b"] == pytest.approx(spread * B, abs=1e-9)


def test_without_doubt_about_a_lat_there_is_none():
    r = np.array([30.0, 2.0, -4.0])
    for estimator in FILTERS:
        filter_ = Filter(estimator, sd_lat=0.0, q_lat=0.0)
        filter_.begin(own_at(), image(r))
        for _ in range(5):
            filter_.predict(own_at(push=(0.0, 1.0, 0.0)))
            belief = filter_.update(own_at(), image(r, noise=(0.01, 0.0, 0.0)))
        assert belief["a_L_N"] == pytest.approx(np.zeros(3), abs=1e-9)


@pytest.mark.parametrize("estimator", FILTERS)
def test_bearings_alone_start_from_the_range_that_is_told(estimator):
    r = np.array([28.0, 4.0, -5.0])
    filter_ = Filter(estimator)
    belief = filter_.begin(own_at(), image(r, wings=False))
    assert np.linalg.norm(belief["r_LV_N"]) == pytest.approx(30.0, rel=1e-9)
    assert belief["sd_log_range"] == pytest.approx(0.3, rel=1e-9)
    belief = filter_.update(own_at(), image(r, wings=False, noise=(0.002, 0.0, 0.0)))
    assert belief["innovation"][2] == 0.0 and belief["nis"] < 9.0


def test_perfect_information_is_the_truth_without_doubt():
    own, leader = own_at(), np.zeros(1, LEADER)[0]
    leader["r_N"], leader["v_N"], leader["a_N"] = (30, 1, 2), (21, 3, 0), (0, 2, 0)
    leader["wingspan"] = B
    filter_ = Filter(TRUTH)
    begin(filter_.track, own, image(np.array([30.0, 0, 0])), filter_.cfg, filter_.work)
    predict(filter_.track, own, filter_.cfg, filter_.work)
    describe(filter_.track, own, leader, filter_.belief, filter_.cfg, filter_.work)
    belief = filter_.belief
    assert belief["r_LV_N"] == pytest.approx((30, 1, 2))
    assert belief["v_LV_N"] == pytest.approx(np.array((21, 3, 0)) - V_OWN)
    assert belief["a_L_N"] == pytest.approx((0, 2, 0))
    assert belief["b"] == B and not belief["C"].any() and belief["sd_log_range"] == 0.0
    assert ESTIMATORS[TRUTH] == "truth"


@pytest.mark.parametrize("estimator", FILTERS)
@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="many flights")
def test_nees_is_within_its_bounds_where_the_leader_does_what_the_filter_assumes(estimator):
    """A leader with white acceleration and a wandering a_lat; the follower holds its course."""
    flights, steps, dt = 100, 60, 0.1
    filter_ = Filter(estimator, sd_velocity=1.0)
    nees = []
    for k in range(flights):

        def z(i, step=0, k=k):
            return normal(7, k, 1, step, i)

        r, a_lat = np.array([30.0, 2.0, -4.0]), z(3)
        v = V_OWN + [z(i) for i in range(3)]
        size = B * math.exp(-0.02 * z(4))
        own = own_at()
        noise = 0.002 * np.array([z(5), z(6), math.sqrt(2) * z(7)])
        filter_.begin(own, image(r, size, noise))
        for step in range(1, steps + 1):
            for _ in range(5):
                course = v[:2] / np.hypot(*v[:2])
                a = a_lat * np.array([-course[1], course[0], 0.0])
                r = r + 0.02 * (v - V_OWN) + 0.5 * 0.02**2 * a
                v = v + 0.02 * a
            v = v + math.sqrt(0.01 * dt) * np.array([z(i, step) for i in range(3)])
            a_lat += math.sqrt(0.004 * dt) * z(3, step)
            filter_.predict(own)
            noise = 0.002 * np.array([z(5, step), z(6, step), math.sqrt(2) * z(7, step)])
            belief = filter_.update(own, image(r, size, noise))
        e = np.r_[belief["r_LV_N"] - r, belief["v_LV_N"] - v + V_OWN]
        nees.append(e @ np.linalg.solve(belief["C"], e))
    low, high = stats.chi2.ppf([1e-3, 1 - 1e-3], 6 * flights) / flights
    assert low < np.mean(nees) < high
