"""A line seen as segments: residuals, their slopes, the update, the start, and sliding ends."""

import math

import numpy as np
import pytest
from scipy import stats

from visenvs.core.frames import camera_towards
from visenvs.estimation.lines import (
    D_ONLY,
    FOUR,
    SCRATCH,
    SIGHT,
    begin,
    in_order,
    linearise,
    sight,
    slide,
    slopes,
    update,
)

pytestmark = pytest.mark.kernel

SIGMA = 0.002
CFG = np.dtype(
    [(name, "f8") for name in ("near", "sigma_image", "e_gate", "s_ray", "horizon", "range_max")]
    + [("estimator", "i8")]
)


def settings(estimator=FOUR, **changes):
    out = np.zeros(1, CFG)
    values = {"near": 0.5, "sigma_image": SIGMA, "e_gate": 5.0, "s_ray": 5.0}
    for name, value in (values | {"horizon": 0.05, "range_max": 1e3} | changes).items():
        out[name] = value
    out["estimator"] = estimator
    return out[0]


def camera(r_V, towards):
    C = np.zeros((3, 3))
    camera_towards(np.asarray(towards, float) - r_V, C)
    return C


def image(C, r_V, X):
    q = C @ (X - r_V)
    return q[1:] / q[0]


def segment_of(C, r_V, line):
    return np.concatenate([image(C, r_V, line[:3]), image(C, r_V, line[3:])])


def scene(seed=0):
    rng = np.random.default_rng(seed)
    r_V = np.array([3.0, -4.0, -30.0])
    C = camera(r_V, rng.uniform(-5.0, 5.0, 3))
    return rng, C, r_V, rng.uniform(-8.0, 8.0, 6)


def residuals(x, C, r_V, segment, cfg):
    out, J, ordered, s = np.zeros(1, SIGHT)[0], np.zeros((2, 3)), np.zeros(4), np.zeros(2)
    assert sight(x, C, r_V, cfg["near"], out, np.zeros(3))
    slopes(C, out, J)
    turned = in_order(out, segment, ordered, s)
    residual, H = np.zeros(4), np.zeros((4, 6))
    linearise(out, ordered, s, residual, H)
    return residual, H, turned


@pytest.mark.parametrize("seed", range(4))
def test_a_perfect_match_leaves_nothing(seed):
    """With the printed (2.37) e_2 would be the length of the segment."""
    _, C, r_V, x = scene(seed)
    residual, _, _ = residuals(x, C, r_V, segment_of(C, r_V, x), settings())
    assert residual == pytest.approx(np.zeros(4), abs=1e-14)


@pytest.mark.parametrize("seed", range(4))
def test_distances_are_the_textbook_ones_in_either_order(seed):
    rng, C, r_V, x = scene(seed)
    segment = segment_of(C, r_V, x) + 0.02 * rng.normal(size=4)
    residual, _, _ = residuals(x, C, r_V, segment, settings())
    p, q = image(C, r_V, x[:3]), image(C, r_V, x[3:])
    u = (q - p) / np.linalg.norm(q - p)
    n = np.array([-u[1], u[0]])
    for i, (end, place) in enumerate(((segment[:2], p), (segment[2:], q))):
        assert residual[i] == pytest.approx(n @ (end - p), abs=1e-14)
        assert residual[i + 2] == pytest.approx(u @ (end - place), abs=1e-14)
    other, _, turned = residuals(x, C, r_V, np.roll(segment, 2), settings())
    assert turned and other == pytest.approx(residual, abs=1e-15)


@pytest.mark.parametrize("seed", range(6))
def test_the_slopes_are_those_of_finite_differences(seed):
    rng, C, r_V, x = scene(seed)
    segment, h = segment_of(C, r_V, x) + 0.02 * rng.normal(size=4), 1e-5
    _, H, _ = residuals(x, C, r_V, segment, settings())
    for j in range(6):
        step = h * np.eye(6)[j]
        ahead, back = (residuals(x + d, C, r_V, segment, settings())[0] for d in (step, -step))
        assert -(ahead - back) / (2 * h) == pytest.approx(H[:, j], abs=1e-8)


def test_a_line_is_cut_off_at_the_near_plane_and_its_distances_stay_right():
    r_V = np.array([0.0, 0.0, -10.0])
    C = camera(r_V, [1.0, 0.0, -10.0])  # looks north, level
    x = np.array([-5.0, 2.0, -9.0, 20.0, 3.0, -8.0])
    out = np.zeros(1, SIGHT)[0]
    assert sight(x, C, r_V, 0.5, out, np.zeros(3))
    assert out["q"][0, 0] == pytest.approx(0.5)
    assert out["t"] == pytest.approx([5.5 / 25.0, 1.0])
    part = np.concatenate([x[:3] + share * (x[3:] - x[:3]) for share in (0.5, 0.9)])
    residual, H, _ = residuals(x, C, r_V, segment_of(C, r_V, part), settings())
    assert residual[:2] == pytest.approx([0.0, 0.0], abs=1e-14)
    h = 1e-6
    for j in range(6):
        step = h * np.eye(6)[j]
        d = [
            residuals(x + s, C, r_V, segment_of(C, r_V, part), settings())[0] for s in (step, -step)
        ]
        assert -(d[0] - d[1])[:2] / (2 * h) == pytest.approx(H[:2, j], abs=1e-7)
    assert not sight(x - np.tile([30.0, 0, 0], 2), C, r_V, 0.5, out, np.zeros(3))
    end_on = np.array([10.0, 0.0, -10.0, 20.0, 0.0, -10.0])
    assert not sight(end_on, C, r_V, 0.5, out, np.zeros(3))


@pytest.mark.parametrize("estimator", [FOUR, D_ONLY])
def test_the_update_is_kalman_s(estimator):
    rng, C, r_V, x = scene(2)
    root = 0.1 * rng.normal(size=(6, 6))
    P, y = root @ root.T + 1e-4 * np.eye(6), x.copy()
    segment = segment_of(C, r_V, x) + SIGMA * rng.normal(size=4)
    residual, H, _ = residuals(x, C, r_V, segment, settings())
    rows = 4 if estimator == FOUR else 2
    H, residual = H[:rows], residual[:rows]
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + SIGMA**2 * np.eye(rows))
    expected, covariance = x + K @ residual, P - K @ H @ P
    cfg, work = settings(estimator), np.zeros(1, SCRATCH)[0]
    assert update(y, P, C, r_V, segment, np.ones(2), cfg, work)
    assert y == pytest.approx(expected, abs=1e-10)
    assert P == pytest.approx(covariance, abs=1e-10)


def test_an_end_that_is_none_has_no_residual_along_the_line():
    _, C, r_V, x = scene(3)
    P = 0.01 * np.eye(6)
    half = np.concatenate([x[:3], 0.5 * (x[:3] + x[3:])])
    segment, work = segment_of(C, r_V, half), np.zeros(1, SCRATCH)[0]
    for true_end in ([1.0, 0.0], [1.0, 1.0]):  # told so, or too far off to be believed
        y, Q = x.copy(), P.copy()
        update(y, Q, C, r_V, segment, np.array(true_end), settings(), work)
        assert y == pytest.approx(x, abs=1e-9)
        _, H, turned = residuals(x, C, r_V, segment, settings())
        assert not turned
        seen, unseen = (H[i] @ Q @ H[i] / (H[i] @ P @ H[i]) for i in (2, 3))
        assert seen < 0.5 and unseen > 0.9


def test_a_new_line_lies_at_zero_altitude_uncertain_along_its_rays():
    _, C, r_V, _ = scene(1)
    ground = np.array([5.0, 2.0, 0.0, -3.0, 6.0, 0.0])
    x, P = np.zeros(6), np.zeros((6, 6))
    assert begin(x, P, C, r_V, segment_of(C, r_V, ground), settings(), np.zeros(3))
    assert x == pytest.approx(ground, abs=1e-9)
    for i in (0, 3):
        ray = ground[i : i + 3] - r_V
        depth, ray = (C @ ray)[0], ray / np.linalg.norm(ray)
        block = P[i : i + 3, i : i + 3]
        assert ray @ block @ ray == pytest.approx(25.0)
        across = np.cross(ray, [1.0, 0.0, 0.0])
        across /= np.linalg.norm(across)
        assert across @ block @ across == pytest.approx((SIGMA * depth) ** 2)
    assert not P[:3, 3:].any()


def test_no_line_starts_at_the_horizon_or_from_below_ground():
    r_V, x, P = np.array([0.0, 0.0, -10.0]), np.zeros(6), np.zeros((6, 6))
    C = camera(r_V, [1.0, 0.0, -10.0])
    segment = np.array([0.0, 0.3, 0.1, 0.04])  # the second ray is too flat
    assert not begin(x, P, C, r_V, segment, settings(), np.zeros(3))
    steep = np.array([0.0, 0.3, 0.1, 0.3])
    assert not begin(x, P, C, -r_V, steep, settings(), np.zeros(3))
    assert not begin(x, P, C, r_V, steep, settings(range_max=20.0), np.zeros(3))
    assert not x.any() and not P.any()
    assert begin(x, P, C, r_V, steep, settings(), np.zeros(3))


@pytest.mark.parametrize(("end", "share"), [(0, -0.4), (1, 0.3)])
def test_sliding_is_the_linear_map_and_adds_what_the_place_is_uncertain_by(end, share):
    rng, _, _, x = scene(4)
    root = rng.normal(size=(6, 6))
    P, T = root @ root.T, np.eye(6)
    mine, other = slice(3 * end, 3 * end + 3), slice(3 - 3 * end, 6 - 3 * end)
    T[mine, mine] = (1 - share) * np.eye(3)
    T[mine, other] = share * np.eye(3)
    along = x[other] - x[mine]
    added = np.zeros((6, 6))
    added[mine, mine] = 0.04 * np.outer(along, along) / (along @ along)
    expected, covariance = T @ x, T @ P @ T.T + added
    slide(x, P, end, share, 0.04, np.zeros((6, 6)))
    assert x == pytest.approx(expected, abs=1e-12)
    assert P == pytest.approx(covariance, abs=1e-10)


@pytest.mark.parametrize("estimator", [FOUR, D_ONLY])
def test_a_line_seen_from_all_sides_is_consistent(estimator):
    """NEES of its place across itself over many runs, from a prior that is true."""
    runs, images, nees = 60, 12, []
    rng, cfg, work = np.random.default_rng(5), settings(estimator), np.zeros(1, SCRATCH)[0]
    for _ in range(runs):
        truth = rng.uniform(-6.0, 6.0, 6)
        P = np.diag(rng.uniform(0.05, 0.3, 6)) ** 2
        x = truth + np.sqrt(np.diag(P)) * rng.normal(size=6)
        for k in range(images):
            angle = 2 * math.pi * k / images
            r_V = np.array([20 * math.cos(angle), 20 * math.sin(angle), -30.0])
            C = camera(r_V, [0.0, 0.0, 0.0])
            segment = segment_of(C, r_V, truth) + SIGMA * rng.normal(size=4)
            update(x, P, C, r_V, segment, np.ones(2), cfg, work)
        u = (truth[3:] - truth[:3]) / np.linalg.norm(truth[3:] - truth[:3])
        Q = np.kron(np.eye(2), np.linalg.svd(u[None])[2][1:])
        error = Q @ (x - truth)
        nees.append(error @ np.linalg.solve(Q @ P @ Q.T, error))
    low, high = stats.chi2.ppf([1e-3, 1 - 1e-3], 4 * runs) / runs
    assert low < np.mean(nees) < high
