"""The bearings-only task against its own prior, a simulation written apart, and symmetry."""

import math

import numba
import numpy as np
import pytest
from scipy import stats

from visenvs.core.config import override
from visenvs.core.lanes import Lanes
from visenvs.core.noise import normal, uniform
from visenvs.core.outcome import Outcome
from visenvs.core.registry import load_task
from visenvs.envs.bearings_only import BEARING, SCENARIOS, BearingsOnlyConfig

pytestmark = pytest.mark.kernel

TASK = load_task("visenvs/BearingsOnly-v0")
SEEDS = 2000
FLIGHTS = 20 if numba.config.DISABLE_JIT else 500


def started(seeds=(1,), **changes):
    lanes = Lanes(TASK, override(SCENARIOS["random"], changes), len(seeds))
    lanes.reset(list(seeds))
    return lanes


def state(records, hat=""):
    position = records["rhat_TV_N" if hat else "r_TV_N"]
    return np.concatenate([position, records["vhat_T_N" if hat else "v_T_N"]], axis=-1)


def nees_of(records):
    error = state(records, "hat") - state(records)
    return np.einsum("ni,nij,nj->n", error, np.linalg.inv(records["P"]), error)


def weave(k):
    """A turn over the largest that depends on nothing but the step."""
    return 0.9 * math.sin(0.15 * k)


def fly(lanes):
    """Yield the records after every step of the weave."""
    while not lanes.done.any():
        action = weave(int(lanes.records["step"][0]))
        lanes.step(np.full((lanes.count, 1), action, np.float32))
        yield lanes.records


# the start


def test_the_drawn_truth_has_the_prior_that_the_filter_is_told():
    records = started(range(SEEDS), p_detect=0.0).records
    low, high = stats.chi2.ppf([0.025, 0.975], 4 * SEEDS) / SEEDS
    assert low < nees_of(records).mean() < high
    assert stats.kstest(nees_of(records), stats.chi2(4).cdf).pvalue > 1e-3
    error = state(records) - state(records, "hat")
    white = np.linalg.solve(np.linalg.cholesky(records["P"]), error[..., None])[..., 0]
    assert np.abs(white.mean(axis=0)).max() < 4 / math.sqrt(SEEDS)
    assert np.allclose(np.cov(white.T), np.eye(4), atol=4 * math.sqrt(2 / SEEDS))


def test_ranges_bearings_and_courses_are_spread_evenly():
    records, config = started(range(SEEDS), p_detect=0.0).records, SCENARIOS["random"]
    low, high = config.range_drawn
    rhat, v = records["rhat_TV_N"], records["v_V_N"]
    assert stats.kstest(records["range_hat"], stats.uniform(low, high - low).cdf).pvalue > 1e-3
    for vector in (rhat, v):
        angle = np.arctan2(vector[:, 1], vector[:, 0])
        assert stats.kstest(angle, stats.uniform(-math.pi, 2 * math.pi).cdf).pvalue > 1e-3
    assert np.hypot(*v.T) == pytest.approx(np.full(SEEDS, config.speed), rel=1e-12)
    ahead = np.einsum("ni,ni->n", records["r_TV_N"], rhat) / records["range_hat"] ** 2
    assert ahead.min() > 0.05  # 1 - 3 x 0.3, so the target is always ahead
    assert np.std(ahead) == pytest.approx(config.range_error, rel=0.1)


def test_the_filter_is_consistent_where_it_is_nearly_linear():
    """NEES at the end of a weave with 5 % range error lies in its bounds (99.8 %)."""
    lanes = started(range(FLIGHTS), range_error=0.05, t_f=100.0)
    for _ in fly(lanes):
        pass
    low, high = stats.chi2.ppf([1e-3, 1 - 1e-3], 4 * FLIGHTS) / FLIGHTS
    assert low < nees_of(lanes.records).mean() < high
    assert lanes.records["nees"] == pytest.approx(nees_of(lanes.records), rel=1e-5)


# the step


def points_of(x, P):
    """Cubature points, 2 columns of a Cholesky factor along and across the line of sight away."""
    c, s = x[:2] / np.hypot(*x[:2])
    R = np.kron(np.eye(2), [[c, s], [-s, c]])
    columns = 2.0 * np.linalg.cholesky(R @ P @ R.T).T @ R
    return np.vstack([x + columns, x - columns])


def cubature(x, P, measured, r):
    """A cubature filter's update, with the angles turned to the estimate's bearing first."""
    points, sight = points_of(x, P), math.atan2(x[1], x[0])
    z = np.angle(np.exp(1j * (np.arctan2(points[:, 1], points[:, 0]) - sight)))
    S = np.var(z) + r
    K = (z - z.mean()) @ (points - x) / 8 / S
    e = float(np.angle(np.exp(1j * (measured - sight - z.mean()))))
    return x + K * e, P - S * np.outer(K, K)


def extended(x, P, measured, r):
    h = np.array([-x[1], x[0], 0.0, 0.0]) / (x[0] ** 2 + x[1] ** 2)
    K = P @ h / (h @ P @ h + r)
    e = float(np.angle(np.exp(1j * (measured - math.atan2(x[1], x[0])))))
    return x + K * e, P - np.outer(K, h @ P)


def simulate(record, cfg, seed):
    """Truth, filter and cost of the weave from a record at the start, step by step."""
    update = {"ukf": cubature, "ekf": extended}[cfg.estimator]
    truth, x, P = state(record), state(record, "hat"), record["P"].copy()
    heading, cost = math.atan2(*record["v_V_N"][::-1]), 0.0
    Phi, steps = np.eye(4) + cfg.dt * np.eye(4, k=2), round(cfg.t_f / cfg.dt)
    for k in range(steps):
        share = float(np.float32(weave(k)))
        rate = share * cfg.turn_max
        fine = heading + rate * cfg.dt * (np.arange(200) + 0.5) / 200
        moved = cfg.speed * cfg.dt * np.array([np.cos(fine).mean(), np.sin(fine).mean(), 0, 0])
        heading += rate * cfg.dt
        truth, x, P = Phi @ truth - moved, Phi @ x - moved, Phi @ P @ Phi.T
        if uniform(seed, 0, BEARING, k + 1, 1) < cfg.p_detect:
            noise = cfg.sigma_bearing * normal(seed, 0, BEARING, k + 1, 0)
            x, P = update(x, P, math.atan2(truth[1], truth[0]) + noise, cfg.sigma_bearing**2)
        e = (x - truth)[:2]
        distance = math.sqrt(e @ np.linalg.solve(P[:2, :2], e))
        cost += cfg.beta * np.hypot(*e) / cfg.error_scale / steps
        cost += (1 - cfg.beta) * max(distance - cfg.mahalanobis_free, 0.0) / steps
        cost += cfg.turn_weight * share**2 / steps
        yield truth, x, P, distance, cost


@pytest.mark.parametrize(
    ("seed", "changes"),
    [
        (3, {}),
        (4, {"estimator": "ekf"}),
        (5, {"p_detect": 0.5, "dt": 1.0, "t_f": 80.0}),
        (6, {"sigma_bearing": 0.002, "mahalanobis_free": 0.5, "beta": 0.2}),
    ],
)
def test_every_step_matches_a_simulation_written_apart(seed, changes):
    lanes = started([seed], **changes)
    other = simulate(lanes.records[0].copy(), lanes.config, seed)
    rewards, errors = 0.0, []
    for records, (truth, x, P, distance, cost) in zip(fly(lanes), other, strict=True):
        record = records[0]
        assert state(record) == pytest.approx(truth, abs=0.05)
        assert state(record, "hat") == pytest.approx(x, abs=0.1)
        assert record["P"] == pytest.approx(P, rel=1e-3, abs=0.1)
        assert record["mahalanobis"] == pytest.approx(distance, rel=1e-2, abs=1e-2)
        assert record["total_cost"] == pytest.approx(cost, rel=1e-3)
        rewards += lanes.rewards[0]
        errors.append(np.hypot(*(x - truth)[:2]))
    assert rewards == pytest.approx(-record["total_cost"], rel=1e-12)
    assert record["position_error_mean"] == pytest.approx(np.mean(errors), rel=1e-3)
    assert record["miss_distance"] == pytest.approx(errors[-1], abs=0.1)
    wanted = record["miss_distance"] <= lanes.config.success_radius
    assert record["outcome"] == (Outcome.SUCCESS if wanted else Outcome.MISS)


def test_the_target_does_not_accelerate_and_the_observer_keeps_its_speed():
    lanes = started([9])
    start = (lanes.records["r_V_N"] + lanes.records["r_TV_N"])[0]
    velocity = lanes.records["v_T_N"][0].copy()
    for k, records in enumerate(fly(lanes), 1):
        place = (records["r_V_N"] + records["r_TV_N"])[0]
        assert place == pytest.approx(start + k * lanes.config.dt * velocity, abs=1e-8)
    assert np.hypot(*lanes.records["v_V_N"][0]) == pytest.approx(lanes.config.speed, rel=1e-12)


def test_a_full_turn_is_what_the_action_says():
    lanes = started([9])
    before = math.atan2(*lanes.records["v_V_N"][0, ::-1])
    lanes.step(np.array([[-1.0]], np.float32))
    turned = math.atan2(*lanes.records["v_V_N"][0, ::-1]) - before
    expected = -lanes.config.turn_max * lanes.config.dt
    assert math.remainder(turned - expected, 2 * math.pi) == pytest.approx(0.0, abs=1e-12)
    assert lanes.terms[0, 2] == pytest.approx(-lanes.config.turn_weight / 150, rel=1e-12)


# the row


def test_the_row_is_the_belief_seen_along_the_line_of_sight():
    lanes = started(range(20))
    for records in fly(lanes):
        if records["step"][0] == 40:
            break
    for record, values in zip(lanes.records, TASK.observation.records(lanes.rows), strict=True):
        sight = record["rhat_TV_N"] / np.hypot(*record["rhat_TV_N"])
        L = np.array([sight, [-sight[1], sight[0]]])  # to its right: clockwise from above
        R = np.kron(np.eye(2), L)
        assert values["range_hat"] == pytest.approx(np.hypot(*record["rhat_TV_N"]), rel=1e-6)
        assert values["vhat_T_L"] == pytest.approx(L @ record["vhat_T_N"], abs=1e-5)
        assert values["v_V_L"] == pytest.approx(L @ record["v_V_N"], abs=1e-5)
        factor = np.zeros((4, 4))
        factor[np.tril_indices(4)] = np.concatenate([values["chol_r"], values["chol_v"]])
        scale = np.sqrt(np.diag(record["P"]))
        ours, theirs = factor @ factor.T, R @ record["P"] @ R.T
        assert ours / np.outer(scale, scale) == pytest.approx(
            theirs / np.outer(scale, scale), abs=1e-4
        )


def test_north_does_not_matter():
    """The same scene turned by any angle gives the same rows and costs."""
    lanes, turned = started([3, 4]), started([3, 4])
    R = np.array([[math.cos(2.0), -math.sin(2.0)], [math.sin(2.0), math.cos(2.0)]])
    moved = turned.snapshot()
    for name in ("r_TV_N", "v_T_N", "r_V_N", "v_V_N", "rhat_TV_N", "vhat_T_N"):
        moved[name] = moved[name] @ R.T
    moved["P"] = np.kron(np.eye(2), R) @ moved["P"] @ np.kron(np.eye(2), R).T
    turned.restore(moved)
    for _ in zip(fly(lanes), fly(turned), strict=True):
        assert turned.rows == pytest.approx(lanes.rows, abs=1e-4)
        assert turned.rewards == pytest.approx(lanes.rewards, rel=1e-6)


# what bearings can tell


def test_range_stays_unknown_on_a_straight_course_and_is_learnt_by_turning():
    """A constant-velocity observer cannot see the range of a constant-velocity target."""
    straight, weaving = started(range(FLIGHTS)), started(range(FLIGHTS))
    prior = 0.3 * straight.records["range_hat"]
    while not straight.done.any():
        straight.step(np.zeros((FLIGHTS, 1), np.float32))
    for _ in fly(weaving):
        pass
    spread = [np.median(lanes.records["chol_r"][:, 0] / prior) for lanes in (straight, weaving)]
    assert spread[0] > 0.6
    assert spread[1] < 0.4 * spread[0]


def test_impossible_settings_are_refused():
    for wrong in (
        {"dt": 0.0},
        {"turn_max": 4.0},
        {"beta": 1.1},
        {"kappa": -1.0},
        {"p_detect": 1.5},
        {"range_error": 0.34},
        {"range_drawn": (3.0, 2.0)},
    ):
        with pytest.raises(ValueError, match=f"out of range: {next(iter(wrong))}"):
            BearingsOnlyConfig(**wrong)


# A golden episode: a change of dynamics, noise, filter, prior or cost shows here. If it is meant,
# bump the version in ENV_ID (visenvs/BearingsOnly-v1) before you write the new numbers down.
GOLDEN = {
    "ukf": {
        "total_cost": 1.5342076736996466,
        "control_cost": 0.003967585748196683,
        "position_error_mean": 218.336121605674,
        "miss_distance": 15.112729132755181,
        "mahalanobis_peak": 3.4674236944950794,
        "nees_mean": 9.029588192987905,
        "rhat_TV_N": [-1614.8818617151342, 1062.0231661897224],
        "vhat_T_N": [-8.46726909276555, 4.3757762391882205],
        "bearing": [2.5616490576237805],
    },
    "ekf": {
        "total_cost": 1.5195600237383082,
        "control_cost": 0.003967585748196683,
        "position_error_mean": 216.2416397449895,
        "miss_distance": 16.496514238316088,
        "mahalanobis_peak": 3.4311955641213903,
        "nees_mean": 9.303300171841274,
        "rhat_TV_N": [-1613.8177170970532, 1061.1081622496813],
        "vhat_T_N": [-8.463454165780263, 4.361142434029539],
        "bearing": [2.5616490576237805],
    },
}


@pytest.mark.parametrize("estimator", GOLDEN)
def test_a_seeded_episode_stays_what_it_was_in_this_version(estimator):
    lanes = started([123], estimator=estimator)
    for _ in fly(lanes):
        pass
    assert TASK.id == "visenvs/BearingsOnly-v0"
    for name, value in GOLDEN[estimator].items():
        assert lanes.records[name][0] == pytest.approx(value, rel=1e-6), name
