"""Two filters of a ground robot: models, Bayes' rule, and what handing the heading over mends."""

import math

import numpy as np
import pytest
from scipy import stats

from visenvs.core.config import to_record
from visenvs.core.frames import wrap_angle
from visenvs.envs._herding_config import HerdingConfig
from visenvs.estimation import mmae
from visenvs.estimation.mmae import SPIN, STRAIGHT

pytestmark = pytest.mark.kernel

CFG = to_record(HerdingConfig())[0]
SIGMA = 0.02


def scratch():
    return np.zeros(1, mmae.SCRATCH)[0]


def covariance(seed):
    root = np.random.default_rng(seed).normal(size=(3, 3)) * [[0.1], [0.1], [0.3]]
    return root @ root.T


@pytest.mark.parametrize("heading", [0.0, 0.7, -2.5])
def test_the_straight_model_is_linearised_exactly(heading, derivative):
    """F = I + dt A of (27), against central differences of its own step."""

    def carried(x):
        y, P = np.array(x), np.zeros((3, 3))
        mmae.predict_straight(y, P, 0.1, 0.0, 0.0, CFG)
        return y

    x, P = np.array([1.0, -2.0, heading]), covariance(1)
    F = derivative(carried, x)
    expected = F @ P @ F.T + 0.1 * np.diag([0.04, 0.04, 0.25])
    assert carried(x)[:2] - x[:2] == pytest.approx(
        0.033 * np.array([math.cos(heading), math.sin(heading)])
    )
    mmae.predict_straight(x, P, 0.1, 0.04, 0.25, CFG)
    assert pytest.approx(expected, abs=1e-9) == P
    assert np.array_equal(P, P.T)


def test_half_a_turn_takes_the_spin_time():
    x, P = np.array([1.0, 2.0, 0.4]), np.zeros((3, 3))
    for _ in range(100):
        mmae.predict_spin(x, P, 0.01 * CFG["spin_time"], CFG)
    assert wrap_angle(x[2] - 0.4 - math.pi) == pytest.approx(0.0, abs=1e-9)
    assert x[:2].tolist() == [1.0, 2.0]


def test_the_density_is_the_normal_one():
    """(22): ln pdf, but for ln 2 pi."""
    x, P, place = np.array([0.3, -0.2, 1.0]), covariance(2), np.array([0.35, -0.1])
    S = P[:2, :2] + SIGMA**2 * np.eye(2)
    expected = stats.multivariate_normal(x[:2], S).logpdf(place) + math.log(2.0 * math.pi)
    K = P[:, :2] @ np.linalg.inv(S)
    state, after = x + K @ (place - x[:2]), P - K @ P[:2]
    assert mmae.update_place(x, P, place, SIGMA**2, scratch()) == pytest.approx(expected)
    assert x == pytest.approx(state)
    assert pytest.approx(after, abs=1e-12) == P


@pytest.mark.parametrize("p_spin", [0.01, 0.3, 0.9])
def test_probabilities_are_bayes(p_spin):
    """(21), kept within bounds."""
    x, P = np.array([[0.0, 0.0, 0.1], [0.02, 0.01, 0.0]]), np.array([covariance(3), covariance(4)])
    place = np.array([0.03, 0.0])
    pdf = [
        stats.multivariate_normal(x[m, :2], P[m, :2, :2] + SIGMA**2 * np.eye(2)).pdf(place)
        for m in range(2)
    ]
    expected = p_spin * pdf[SPIN] / (p_spin * pdf[SPIN] + (1 - p_spin) * pdf[STRAIGHT])
    found = mmae.update(x, P, p_spin, place, SIGMA**2, 0.01, 0.99, scratch())
    assert found == pytest.approx(min(max(expected, 0.01), 0.99))


def test_an_impossible_finding_leaves_the_probability_within_bounds():
    x, P = np.array([[50.0, 0.0, 0.0], [0.0, 0.0, 0.0]]), np.array([1e-4 * np.eye(3)] * 2)
    assert mmae.update(x, P, 0.01, np.zeros(2), 1e-4, 0.01, 0.99, scratch()) == 0.99
    x, P = np.array([[0.0, 0.0, 0.0], [50.0, 0.0, 0.0]]), np.array([1e-4 * np.eye(3)] * 2)
    assert mmae.update(x, P, 0.99, np.zeros(2), 1e-4, 0.01, 0.99, scratch()) == 0.01


def reversal(hand_over, seed, dt=1 / 15):
    """Time, p_spin, heading errors of the winner and of STRAIGHT about a spin at 4 s, (n, 4)."""
    rng, r, heading = np.random.default_rng(seed), np.zeros(2), 0.8
    x, P = np.array([[0.0, 0.0, 0.8]] * 2), np.array([np.diag([1e-3, 1e-3, 0.01])] * 2)
    p_spin, spun, out, work = mmae.LEAST, mmae.NEVER, [], scratch()
    for k in range(round(10 / dt)):
        t = (k + 1) * dt
        if 4.0 < t <= 4.0 + CFG["spin_time"]:
            heading += math.pi * dt / CFG["spin_time"]
        else:
            r += dt * CFG["speed"] * np.array([math.cos(heading), math.sin(heading)])
        mmae.predict(x, P, dt, CFG)
        spun += dt if spun >= 0 else 0.0
        place = r + SIGMA * rng.normal(size=2)
        p_spin = mmae.update(x, P, p_spin, place, SIGMA**2, mmae.LEAST, 1 - mmae.LEAST, work)
        if hand_over:
            spun = mmae.hand_over(x, P, p_spin, spun)
        model = SPIN if p_spin > 0.5 else STRAIGHT
        off = [abs(wrap_angle(x[m, 2] - heading)) for m in (model, STRAIGHT)]
        out.append((t, p_spin, *off))
    return np.array(out)


def test_a_spin_is_found_and_left_in_time_with_the_right_heading():
    runs = np.array([reversal(True, seed) for seed in range(20)])
    t, end = runs[0, :, 0], 4.0 + CFG["spin_time"]
    assert (runs[:, (t > 4.5) & (t < end), 1] > 0.5).mean() > 0.99
    assert (runs[:, (t > end + 0.6), 1] < 0.5).mean() > 0.99
    assert (runs[:, t < 4.0, 1] > 0.5).mean() < 0.01
    assert np.percentile(runs[:, t > end + 0.4, 2], 95) < math.radians(15.0)


def test_models_that_tell_each_other_nothing_keep_the_old_heading():
    runs = np.array([reversal(False, seed) for seed in range(20)])
    t, end = runs[0, :, 0], 4.0 + CFG["spin_time"]
    assert np.median(runs[:, (t > end + 0.4) & (t < end + 1.0), 3]) > math.radians(90.0)


def test_the_heir_takes_the_place_only_where_they_have_parted():
    x = np.array([[1.0, 0.0, 0.5], [1.01, 0.0, -2.0]])
    P = np.array([covariance(5), covariance(6)])
    near = x[1, :2].copy()
    mmae.inherit(x, P, STRAIGHT, SPIN, 0.03)
    assert x[1, 2] == 0.5 and np.array_equal(x[1, :2], near) and P[1, 2, 2] == P[0, 2, 2]
    assert np.linalg.eigvalsh(P[1]).min() > 0
    x[1, 0] = 1.04
    mmae.inherit(x, P, STRAIGHT, SPIN, 0.03)
    assert np.array_equal(x[1], x[0]) and np.array_equal(P[1], P[0])


def test_a_heading_is_used_as_the_textbook_does():
    """Joseph's form in either model, and Bayes' rule on their densities."""
    x = np.array([[1.0, 2.0, 0.3], [1.1, 1.9, 0.5]])
    P = np.stack([covariance(3), covariance(4)])
    before, prior, variance = (x.copy(), P.copy()), 0.2, 0.05
    p = mmae.update_heading(x, P, prior, 0.45, variance, 0.0, 1.0, scratch())
    H, density = np.array([[0.0, 0.0, 1.0]]), []
    for mode in range(2):
        S = float(before[1][mode, 2, 2] + variance)
        K = before[1][mode] @ H.T / S
        residual = 0.45 - before[0][mode, 2]
        assert x[mode] == pytest.approx(before[0][mode] + K[:, 0] * residual)
        kept = np.eye(3) - K @ H
        joseph = kept @ before[1][mode] @ kept.T + variance * K @ K.T
        assert P[mode] == pytest.approx(joseph, abs=1e-12)
        density.append(stats.norm.pdf(residual, scale=math.sqrt(S)))
    straight, spin = (1.0 - prior) * density[STRAIGHT], prior * density[SPIN]
    assert p == pytest.approx(spin / (straight + spin))


def test_a_heading_that_fits_no_model_is_a_mistake():
    x, P = np.zeros((2, 3)), np.stack([0.01 * np.eye(3)] * 2)
    before = x.copy(), P.copy()
    assert mmae.update_heading(x, P, 0.3, math.pi, 0.01, 0.0, 1.0, scratch()) == 0.3
    assert np.array_equal(x, before[0]) and np.array_equal(P, before[1])


def test_headings_are_compared_around_the_circle():
    x, P = np.full((2, 3), math.pi - 0.05), np.stack([0.01 * np.eye(3)] * 2)
    mmae.update_heading(x, P, 0.3, 0.05 - math.pi, 0.01, 0.0, 1.0, scratch())
    assert np.abs(wrap_angle(x[:, 2] - math.pi)) == pytest.approx([0.0, 0.0], abs=1e-12)
