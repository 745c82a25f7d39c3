"""Lateral excitation: against a direct transcription, at its conjugate point, and at its ends."""

import math

import numpy as np
import pytest
from scipy.linalg import null_space

from visenvs.core.config import override
from visenvs.core.registry import load_task
from visenvs.guidance.excitation import CONJUGATE, check_segment, follow_sine, optimal_path

pytestmark = pytest.mark.kernel

SIGMA, K = 2e-3, 2000.0  # w = 0.5 rad/s
ENDS = (3.0, -0.5, -4.0, 0.2)


def path(duration, times, ends=ENDS):
    return np.array([optimal_path(ends, duration, SIGMA, K, t) for t in times])


def transcription(n, duration, ends=ENDS):
    """Least eigenvalue of the cost over free nodes, and the stationary nodes Y_0 .. Y_n.

    Accelerations and the rates at the ends are central differences, with one more node beyond each.
    """
    h = duration / n
    D = (np.eye(n + 1, n + 3) - 2 * np.eye(n + 1, n + 3, 1) + np.eye(n + 1, n + 3, 2)) / h**2
    weights = np.full(n + 1, h)
    weights[[0, -1]] *= 0.5
    H = K**2 * D.T @ np.diag(weights) @ D
    H[1:-1, 1:-1] -= np.diag(weights) / SIGMA**2
    C = np.zeros((4, n + 3))
    C[0, 1] = C[2, -2] = 1.0
    C[[1, 1, 3, 3], [0, 2, -3, -1]] = np.array([-0.5, 0.5, -0.5, 0.5]) / h
    free = null_space(C)
    fixed = np.linalg.lstsq(C, ends, rcond=None)[0]
    reduced = free.T @ H @ free
    nodes = fixed - free @ np.linalg.solve(reduced, free.T @ H @ fixed)
    return np.linalg.eigvalsh(reduced)[0], nodes[1:-1]


def test_the_path_is_what_a_direct_transcription_finds():
    n, duration = 400, 8.0
    _, nodes = transcription(n, duration)
    exact = path(duration, np.linspace(0.0, duration, n + 1))[:, 0]
    assert nodes == pytest.approx(exact, abs=5e-3)
    assert np.abs(exact).max() > 4.0


def test_beyond_the_conjugate_point_no_path_is_a_minimum():
    assert math.cos(CONJUGATE) * math.cosh(CONJUGATE) == pytest.approx(1.0, abs=1e-12)
    assert transcription(400, 2.0 * 4.72)[0] > 0.0 > transcription(400, 2.0 * 4.74)[0]


def test_it_meets_its_ends_and_its_equation():
    duration = 9.0
    start, end = path(duration, (0.0, duration))
    assert [*start[:2], *end[:2]] == pytest.approx(ENDS, abs=1e-12)
    t, h = np.linspace(1.0, 8.0, 8), 1e-3
    before, here, after = (path(duration, t + d) for d in (-h, 0.0, h))
    assert here[:, 1] == pytest.approx((after - before)[:, 0] / (2 * h), abs=1e-5)
    assert here[:, 2] == pytest.approx((after - before)[:, 1] / (2 * h), abs=1e-5)
    fourth = (after - 2 * here + before)[:, 2] / h**2
    assert fourth == pytest.approx(here[:, 0] / (SIGMA * K) ** 2, abs=1e-5)


def test_between_ends_at_rest_on_the_offset_it_stays_there():
    assert path(8.0, np.linspace(0.0, 8.0, 5), (0.0, 0.0, 0.0, 0.0)).tolist() == [[0.0] * 3] * 5


def test_a_heavy_weight_leaves_the_cubic_of_least_effort():
    t = np.linspace(0.0, 8.0, 9)
    Y = [optimal_path((1.0, 0.0, -1.0, 0.0), 8.0, SIGMA, 1e9, s)[0] for s in t]
    assert Y == pytest.approx(1.0 - 2.0 * (3.0 * (t / 8) ** 2 - 2.0 * (t / 8) ** 3), abs=1e-5)


def test_longer_segments_swing_further():
    ends = (10.0, 0.0, 10.0, 0.0)
    reach = [np.abs(path(2 * z, np.linspace(0, 2 * z, 50), ends)).max() for z in (3, 4, 4.5, 4.7)]
    assert (np.diff(reach) > 0).all()
    assert reach[-1] > 200.0


def test_segments_without_a_least_cost_are_refused():
    with pytest.raises(ValueError, match=r"below 4\.7300, got 0\.5 rad/s x 9\.47 s = 4\.735"):
        check_segment(SIGMA, K, 9.47)
    assert check_segment(SIGMA, K, 9.46) == 0.5
    with pytest.raises(ValueError, match=r"write a duration below 9\.46 or a weight above 2234\.8"):
        optimal_path(ENDS, 10.0, SIGMA, K, 1.0)
    with pytest.raises(ValueError, match="above 0, got"):
        check_segment(SIGMA, -1.0, 8.0)


def test_a_sine_tells_its_own_derivatives():
    out, after = np.zeros(3), np.zeros(3)
    follow_sine(3.0, 20.0, 4.0, out)
    follow_sine(3.0, 20.0, 4.0 + 1e-6, after)
    assert out[0] == pytest.approx(3.0 * math.sin(0.4 * math.pi))
    assert (after - out)[:2] / 1e-6 == pytest.approx(out[1:], abs=1e-5)


def test_the_task_refuses_what_the_law_cannot_fly():
    config = load_task("visenvs/Formation-v0").scenarios["bearing-only"]
    with pytest.raises(ValueError, match=r"omega T must be below 4\.7300, got 0\.5 rad/s x 10 s"):
        override(config, {"meander_segment": 10.0})
