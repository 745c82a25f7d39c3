"""The exact posterior against a dense quadrature that uses all images at once."""

import numpy as np
import pytest

from visenvs.estimation.grid import GRID, POINTS, SCRATCH, begin, close_in, moments, update

NAMES = (
    "prior_range",
    "prior_deviation",
    "sigma_range",
    "sigma_angle",
    "min_range",
    "half_width",
    "p_detect",
)
DENSE = np.linspace(25.0 - 18.0, 25.0 + 18.0, 20_001)  # abscissae within 3 standard deviations


def settings(sigma_range=0.3, sigma_angle=0.0, min_range=0.3, half_width=1e9, p_detect=1.0):
    values = (25.0, 6.0, sigma_range, sigma_angle, min_range, half_width, p_detect)
    return np.array([values], [(name, "f8") for name in NAMES])[0]


class Filter:
    """The kernels on their own record."""

    def __init__(self, z, place, cfg):
        self.record, self.cfg = np.zeros(1, GRID), cfg
        self.scratch = np.zeros(1, SCRATCH)
        begin(self.record[0], z, np.array(place, float), cfg)

    def use(self, z, place, seen=True):
        update(self.record[0], seen, z, np.array(place, float), self.cfg, self.scratch[0])

    def belief(self, place=(0.0, 0.0)):
        rhat, P = np.zeros(2), np.zeros((2, 2))
        moments(self.record[0], np.array(place, float), rhat, P)
        return rhat, P


def dense(images, cfg):
    """Mean and covariance of (x, y) by quadrature over x; `images` are (z, own x, own y).

    Given x each image measures y with e = z (x - own x) + own y of variance r, so that y is normal
    with precision sum 1/r. The density of all z given x, with nothing known of y, is
    prod((x - own x) / sqrt r) / sqrt(sum 1/r) exp(-sum (e - mean)^2 / 2 r); the first image has no
    say on x.
    """
    log, weight, first = -0.5 * ((DENSE - 25.0) / 6.0) ** 2, 0.0, 0.0
    residuals, scales, total = [], [], 0.0
    for z, own_x, own_y in images:
        X = DENSE - own_x
        r = cfg["sigma_range"] ** 2 + (cfg["sigma_angle"] * X) ** 2
        residuals.append(z * X + own_y)
        scales.append(r)
        with np.errstate(invalid="ignore", divide="ignore"):
            log = log + np.where(X > cfg["min_range"], np.log(X), -np.inf) - 0.5 * np.log(r)
        weight, total = weight + 1.0 / r, total + (z * X + own_y) / r
        if len(residuals) == 1:
            first = np.log(X)
    mean = total / weight
    for e, r in zip(residuals, scales, strict=True):
        log = log - 0.5 * (e - mean) ** 2 / r
    log = log - first - 0.5 * np.log(weight)
    w = np.exp(log - log.max())
    w[[0, -1]] *= 0.5
    w /= w.sum()
    x, y = w @ DENSE, w @ mean
    dx, dy = DENSE - x, mean - y
    xy = w @ (dx * dy)
    return np.array([x, y]), np.array([[w @ dx**2, xy], [xy, w @ (dy**2 + 1.0 / weight)]])


def compare(belief, expected, tolerance):
    """Errors in standard deviations of the exact posterior."""
    (rhat, P), (mean, covariance) = belief, expected
    root = np.linalg.cholesky(covariance)
    assert np.abs(np.linalg.solve(root, rhat - mean)).max() < tolerance
    white = np.linalg.solve(root, np.linalg.solve(root, P).T)
    assert np.abs(white - np.eye(2)).max() < tolerance


def flight(seed, cfg, stop=3.0, steps=100):
    """Images (z, own x, own y) of a weaving flight to `stop` m before a target from the prior."""
    rng = np.random.default_rng(seed)
    target = np.array([25.0 + 6.0 * np.clip(rng.normal(), -3, 3), 2.0 * rng.normal()])
    weave, phase = rng.uniform(0.5, 3.0), rng.uniform(0.0, 6.0)
    for k in range(steps + 1):
        part = k / steps
        own = part * (target - (stop, 0.0))
        own[1] += weave * (1.0 - part) * np.sin(0.1 * k + phase)
        X, Y = target - own
        sd = np.hypot(cfg["sigma_range"] / X, cfg["sigma_angle"])
        yield Y / X + sd * rng.normal(), *own


def fly(images, cfg, tolerance):
    """Compare every fourth belief of a flight, and the last ones; returns the filter."""
    used, ours = [], None
    for k, (z, *own) in enumerate(images):
        used.append((z, *own))
        if ours is None:
            ours = Filter(z, own, cfg)
        else:
            ours.use(z, own)
        if k % 4 == 0 or k > 95:
            compare(ours.belief(), dense(used, cfg), tolerance)
    return ours


@pytest.mark.parametrize(
    ("seed", "sigma_angle"), [(1, 0.0), (2, 0.0), (3, 0.0), (4, 0.01), (5, 0.02)]
)
def test_every_belief_of_a_flight_is_that_of_a_dense_quadrature(seed, sigma_angle):
    cfg = settings(sigma_angle=sigma_angle)
    ours = fly(flight(seed, cfg), cfg, 5e-5)
    assert np.sqrt(ours.belief()[1][0, 0]) < 1.5  # from 6: the grid has closed in


@pytest.mark.parametrize("seed", [1, 3, 4])
def test_a_posterior_cut_off_by_the_minimum_range_is_within_a_hundredth(seed):
    """The density jumps to zero between two points there."""
    cfg = settings()
    ours = fly(flight(seed, cfg, stop=1.0), cfg, 1e-2)
    assert np.sqrt(ours.belief()[1][0, 0]) < 0.6  # from 6: the grid has closed in


@pytest.mark.kernel
def test_beliefs_are_relative_to_the_vehicle():
    ours = Filter(0.1, (0.0, 0.0), settings())
    here, there = ours.belief(), ours.belief((3.0, -2.0))
    assert there[0] == pytest.approx(here[0] - (3.0, -2.0))
    assert there[1] == pytest.approx(here[1])


@pytest.mark.kernel
def test_an_image_that_tells_much_more_than_the_prior_is_resolved():
    """Seen from far aside the range is known to 1 mm at once, a thousandth of the first spacing."""
    cfg = settings(sigma_range=1e-3)
    images = [(0.0, 0.0, 0.0), (1.0, 4.0, -20.0)]
    ours = Filter(*[images[0][0], images[0][1:]], cfg)
    ours.use(images[1][0], images[1][1:])
    mean, covariance = ours.belief()
    assert mean == pytest.approx([24.0, 0.0], abs=1e-3)
    assert covariance[0, 0] == pytest.approx(2e-6, rel=0.02)
    assert ours.record["step"][0] < 1e-3


@pytest.mark.kernel
def test_what_is_seen_lies_ahead_and_what_is_not_seen_does_not():
    """The own position is where the prior puts the target, and no camera misses what it sees."""
    place = (25.0, 0.0)
    ahead, behind = (Filter(0.0, (0.0, 0.0), settings()) for _ in range(2))
    ahead.use(0.0, place)
    behind.use(0.0, place, seen=False)
    alive = ahead.record["log_weight"][0] > -20
    x = ahead.record["low"][0] + ahead.record["step"][0] * np.arange(POINTS)
    assert (x[alive] > 25.3).all()
    assert behind.belief()[0][0] < 25.0 - 0.7 * 6.0 + 0.5
    blind = Filter(0.0, (0.0, 0.0), settings(p_detect=0.0))
    before = blind.belief()
    blind.use(0.0, place, seen=False)
    assert blind.belief()[0].tolist() == before[0].tolist()


@pytest.mark.kernel
def test_the_impossible_changes_nothing():
    """A target seen from beyond every place where it can be."""
    ours = Filter(0.0, (0.0, 0.0), settings())
    before = ours.record.copy()
    ours.use(0.1, (60.0, 0.0))
    assert ours.record.tobytes() == before.tobytes()


@pytest.mark.kernel
def test_a_finer_grid_keeps_what_is_smooth():
    """Cubics in the index go through unchanged, and so do the places of the points."""
    record, before = np.zeros(1, GRID), np.zeros(1, GRID)
    x = np.linspace(-1.0, 1.0, POINTS)
    record["low"], record["step"] = -1.0, 2.0 / (POINTS - 1)
    record["log_weight"], record["mean"], record["variance"] = -(x**2), x**3 - x, 1.0 + x**2
    close_in(record[0], 20, 35, before[0])
    finer = record["low"][0] + record["step"][0] * np.arange(POINTS)
    assert finer[[0, -1]] == pytest.approx(x[[19, 36]])
    assert record["log_weight"][0] == pytest.approx(-(finer**2))
    assert record["mean"][0] == pytest.approx(finer**3 - finer)
    assert record["variance"][0] == pytest.approx(1.0 + finer**2)
