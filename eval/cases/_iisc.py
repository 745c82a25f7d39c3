"""What Tables II to IX of the IISc report share: its two scenes, who flies them, success bands.

Entries of a table with the law `dgg` or `ngg`:

- truth: the report's filter, and safety spheres tracked by the obstacles' true places. No vehicle
  knows these, but the published figures seem to need it; the law's name ends in `told`.
- estimate: the same by estimates only.
- truth-overlap: `truth` with the rule for overlapping spheres (4.5)-(4.6); only with two obstacles.
- known: obstacles and target known without error.
- best: inverse-range UKF, cone test on velocity or target direction, aims at 1.03 radii (chosen on
  other seeds); only with `dgg`.
- latch: the same at 1 radius, and what was critical stays so until it is abeam; only with `dgg`.
- hug: the same filter, always along the tangent of what is ahead; only with `dgg`.

All keep the pre-run of 10 s without control.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.registry import load
from visenvs.core.config import override
from visenvs.core.lanes import Lanes
from visenvs.core.registry import load_task

from ..rollout import PUBLIC_SEEDS, decide
from . import Row
from ._avoidance import mean

ENVIRONMENT = "visenvs/Avoidance-v0"
SCENES = {"one": "iisc-1", "two": "iisc-2"}
WIDTHS = (0.1, 0.2, 0.3, 0.4)  # of S-1 to S-4, radii (Table I)
NEAR = 10.0  # largest miss of the target, m (Table I)
STRAIGHT_ON = 60.0  # s after the flight in which it could still come nearer to the target
SAME = 1e-9  # m
Values = NDArray[np.float64]
Change = tuple[str, Any]
Bands = tuple[tuple[float, float | None], ...]


class Entry(NamedTuple):
    """Who flies: the name of a law, of which {} is `dgg` or `ngg`, and settings changed."""

    law: str
    changes: tuple[Change, ...] = ()


ENTRIES = {
    "truth": Entry("{}-told", (("observation", "told"),)),
    "estimate": Entry("{}"),
    "known": Entry("{}", (("estimator", "truth"),)),
}
OVERLAP = {"truth-overlap": Entry("{}-overlap-told", ENTRIES["truth"].changes)}
OURS = {
    "best": Entry("dgg-target-x1.03", (("estimator", "inverse-ukf"),)),
    "latch": Entry("dgg-target-latch", (("estimator", "inverse-ukf"),)),
    "hug": Entry("hug", (("estimator", "inverse-ukf"),)),
}


def within(points: float, *centres: float) -> Bands:
    """Bands so many percentage points about the centres."""
    return tuple((centre - points, centre + points) for centre in centres)


def at_least(*lows: float) -> Bands:
    """Bands without an upper end."""
    return tuple((low, None) for low in lows)


BANDS: dict[tuple[str, str], Bands] = {
    ("one", "truth"): within(5.0, 53.0, 75.0, 83.0, 89.0),
    ("one", "estimate"): within(5.0, 18.0, 33.0, 49.0, 64.0),
    ("one", "known"): within(4.0, 79.0, 86.0, 91.0, 94.0),
    ("one", "best"): at_least(94.0, 95.0, 97.0, 97.5),
    ("two", "best"): at_least(89.0, 94.5, 95.5, 96.5),
    ("one", "hug"): at_least(98.0, 99.0, 99.0, 99.0),
    ("two", "hug"): at_least(98.0, 99.0, 99.0, 99.0),
}


def setting(scene: str) -> Any:
    """The configuration of a scene."""
    return load_task(ENVIRONMENT).scenarios[SCENES[scene]]


def flight(scene: str, law: str, episodes: int, changes: tuple[Change, ...]) -> Iterator[Any]:
    """Lane records of flights on the first public seeds: at the start, then after every step."""
    task, config = load_task(ENVIRONMENT), override(setting(scene), dict(changes))
    policy = load(law, task, config).policy
    lanes = Lanes(task, config, episodes)
    lanes.reset(list(PUBLIC_SEEDS[:episodes]))
    start, state = np.ones(episodes, bool), None
    yield lanes.records
    while not lanes.done.all():
        actions, state = decide(policy, lanes.rows, state, start)
        lanes.step(actions)
        start = np.zeros(episodes, bool)
        yield lanes.records


class Flown(NamedTuple):
    """Closest approaches: to the obstacles (n, obstacles), radii; to the target (n,), m."""

    closest: Values
    miss: Values


@cache
def fly(scene: str, law: str, episodes: int, changes: tuple[Change, ...]) -> Flown:
    """Fly, and measure as Table I does.

    The report fits a parabola through three samples of the distance to the target (5.1)-(5.5); here
    the path is straight between samples, and after the flight, which ends in the target's plane.
    """
    goal, miss = np.array(setting(scene).waypoint), np.full(episodes, np.inf)
    before, now, records = None, np.zeros((episodes, 3)), None
    for records in flight(scene, law, episodes, changes):
        now = records["r_V_N"] - goal
        if before is not None:
            miss = np.minimum(miss, approach(before, now))
        before = now
    assert records is not None
    miss = np.minimum(miss, approach(now, now + STRAIGHT_ON * records["v_V_N"]))
    count = int(records["count"][0])
    return Flown((records["closest"] / np.maximum(records["radius"], 1.0))[:, :count], miss)


def approach(a: Values, b: Values) -> Values:
    """Least distance of the origin from the straight lines from a to b, (n, 3), m."""
    along = b - a
    square = np.maximum(np.sum(along * along, axis=1), 1e-12)
    share = np.clip(-np.sum(a * along, axis=1) / square, 0.0, 1.0)
    return np.linalg.norm(a + share[:, None] * along, axis=1)


def success(closest: Values, miss: Values, width: float) -> NDArray[np.bool_]:
    """Who came within `width` radii of the spheres (n, obstacles), and near the target."""
    return (np.abs(closest - 1.0) <= width).all(axis=1) & (miss < NEAR)


def band_rows(at: str, flown: Flown, paper: tuple[float, ...] | None, bands: Bands) -> list[Row]:
    """S-1 to S-4, percent of the flights."""
    out: list[Row] = []
    for i, width in enumerate(WIDTHS):
        low, high = bands[i] if bands else (None, None)
        share = 100.0 * success(*flown, width)
        out.append(mean(f"{at}/S{i + 1}", share, paper[i] if paper else None, low, high))
    return out


def entry_rows(
    case: str, scene: str, law: str, episodes: int, paper: Mapping[str, tuple[float, ...]]
) -> list[Row]:
    """Every entry of a table. The published figures stand beside `truth`, that of all obstacles.

    Args:
        paper: S-1 to S-4 of "all" obstacles and, where there are two, of each ("1", "2").
    """
    entries = ENTRIES | (OVERLAP if scene == "two" else {}) | (OURS if law == "dgg" else {})
    out: list[Row] = []
    for name, (pattern, changes) in entries.items():
        flown = fly(scene, pattern.format(law), episodes, changes)
        published = paper if name in ("truth", *OVERLAP) else {}
        bands = BANDS.get((scene, name), ())
        out += band_rows(f"{case}/{name}", flown, published.get("all"), bands)
        for label in sorted(published.keys() - {"all"}):
            one = Flown(flown.closest[:, [int(label) - 1]], flown.miss)
            out += band_rows(f"{case}/{name}/obstacle_{label}", one, published[label], ())
    return [*out, *equal_rows(case, scene, episodes)]


def equal_rows(case: str, scene: str, episodes: int) -> list[Row]:
    """How far apart flights under `dgg` and `ngg` ever are, m: one law in two notations.

    Of `known` it is only reported: rows of actions are of single precision, so that the last bit of
    a double now and then becomes 1e-7 of a command, and no noise asks for a new one soon.
    """
    out: list[Row] = []
    for name in ENTRIES:
        apart, high = difference(scene, name, episodes), None if name == "known" else SAME
        out.append(Row(f"{case}/{name}/dgg_to_ngg_m", 0.0, apart, 0.0, episodes, None, high))
    return out


@cache
def difference(scene: str, name: str, episodes: int) -> float:
    """Largest difference of a coordinate between flights under the two laws, m."""
    pattern, changes = ENTRIES[name]
    both = (flight(scene, pattern.format(law), episodes, changes) for law in ("dgg", "ngg"))
    # neither law changes the speed along x, and so the number of steps
    return max(float(np.abs(a["r_V_N"] - b["r_V_N"]).max()) for a, b in zip(*both, strict=True))
