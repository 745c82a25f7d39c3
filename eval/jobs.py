"""Which policies fly where: loaded and checked before anything flies, then flown one by one."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar, get_args

from agents import registry
from agents.policy import NotApplicable
from visenvs.core.config import Config, field_types, override, pick, to_json
from visenvs.core.lanes import Task
from visenvs.core.parallel import Workers, completed
from visenvs.core.registry import laws, load_task

from . import results
from .board import TRUTH
from .metrics import measure
from .rollout import Rollout, join, shards
from .shards import Flight, Store, fly_shard

Item = TypeVar("Item")

FITS_ANYWHERE = ("law", "blind")
LOCAL = Workers()
UNFINISHED = ".unfinished"  # folder of finished shards of unfinished evaluations


@dataclass(frozen=True, eq=False)
class Job:
    """One policy in one scenario.

    Attributes:
        policy: as typed.
        entry: the loaded policy, or None if it cannot fly here; `reason` then says why.
        told_truth: whether the truth stands in for the scenario's estimator.
    """

    task: Task
    scenario: str
    config: Config
    policy: str
    entry: registry.Entry | None
    reason: str = ""
    told_truth: bool = False

    @property
    def estimator(self) -> str:
        """Name of the estimator in the loop."""
        return getattr(self.config, "estimator", "none")

    @property
    def perception(self) -> str:
        """How pictures become measurements; points unless the environment says otherwise."""
        return getattr(self.config, "perception", "points")

    @property
    def lasting(self) -> bool:
        """Whether its shards may be kept: nobody knows when a user's own code changes."""
        return self.entry is not None and self.entry.kind != "custom"

    def flight(self, trust: bool) -> Flight:
        """The same in words that another process understands."""
        assert self.entry is not None
        return Flight(self.task.id, self.entry.config, self.policy, trust)

    def __str__(self) -> str:
        return f"{self.policy} ({self.estimator})"


@dataclass(frozen=True)
class Scene:
    """One scenario of one environment and who flies in it; the reference is among them.

    Attributes:
        asides: for the jobs of laws in the default scenario, the same in `task.aside`. A network's
            action is a share of the limits that it was trained with.
    """

    task: Task
    scenario: str
    reference: str
    jobs: tuple[Job, ...]
    asides: Mapping[Job, Job]


def plan_scene(
    env: str,
    scenario: str | None,
    estimator: str | None,
    policies: Sequence[str] | None,
    reference: str | None,
    trust: bool = False,
    perception: str | None = None,
) -> Scene:
    """Load every policy of a scene; a ValueError tells what is unknown or broken.

    Args:
        env: Gymnasium id.
        scenario: named preset, None for the first.
        estimator: of every policy; None for the scenario's own, and the laws once more on truth.
        policies: names, model files or `module:factory`; None for those that ship.
        reference: the policy to compare with, None for the task's own; flown too if it is not among
            the others.
        trust: whether code in model files may run.
        perception: of every policy, None for the scenario's own.
    """
    task = load_task(env)
    scenario = scenario or next(iter(task.scenarios))
    reference = reference or task.reference
    config = pick(f"scenario of {env}", scenario, task.scenarios)
    if estimator is not None:
        config = override(config, {"estimator": estimator})
    if perception is not None:
        config = override(config, {"perception": perception})
    specs = dict.fromkeys(
        [*(registry.names(task, config) if policies is None else policies), reference]
    )
    jobs = [_job(task, scenario, config, spec, trust) for spec in specs]
    if estimator is None and perception is None and _can_be_told_truth(config):
        told = override(config, {"estimator": TRUTH})
        able = [job.policy for job in jobs if job.entry is not None and job.policy in laws()]
        jobs += [_job(task, scenario, told, spec, trust, told_truth=True) for spec in able]
    asides: dict[Job, Job] = {}
    as_shipped = estimator is None and perception is None
    if task.aside and as_shipped and scenario == next(iter(task.scenarios)):
        there = task.scenarios[task.aside]
        asides = {
            job: _job(task, task.aside, there, job.policy, trust)
            for job in jobs
            if job.entry is not None and job.entry.kind in FITS_ANYWHERE and not job.told_truth
        }
    return Scene(task, scenario, reference, tuple(jobs), asides)


def fly(
    able: Mapping[Job, Sequence[int]],
    folder: Path,
    made: dict[str, Any],
    progress: Callable[[Job], None],
    where: Workers = LOCAL,
    trust: bool = False,
) -> dict[Job, Path]:
    """Fly jobs shard by shard, and save each result as soon as it is there.

    Shards that an earlier evaluation finished before it was broken off are not flown again.

    Args:
        able: the jobs that can fly, each with its seeds.
        folder: for the results.
        made: what made them, from `results.meta`.
        progress: called with the job of each shard that is finished.
        where: the backend; results do not depend on it.

    Returns:
        The file of each job that flew.

    Raises:
        KeyboardInterrupt: with a message that says what is finished and what is missing.
    """
    book, files = Book(able, folder / UNFINISHED, trust), dict[Job, Path]()

    def finish(job: Job) -> None:
        if (flown := book.whole(job)) is not None:
            files[job] = results.save(_result(job, flown), folder, made)
            book.close(job)

    try:
        for job in able:
            finish(job)
        for index, flown in completed(fly_shard, book.calls, where):
            job = book.enter(index, flown)
            progress(job)
            finish(job)
    except KeyboardInterrupt:
        missing = ", ".join(str(job) for job in able if job not in files)
        raise KeyboardInterrupt(
            f"{len(files)} of {len(able)} finished, kept in {folder}; missing: {missing}"
        ) from None
    return files


class Book:
    """Which shards of which jobs are flown, and which are still to be.

    Args:
        jobs: those that can fly, each with its seeds.
        folder: where finished shards of unfinished jobs are kept.
        trust: whether code in model files may run.

    Attributes:
        calls: arguments of `fly_shard` for every shard that is not there yet; environments take
            turns, so that two workers seldom compile the same kernels at the same time.
    """

    def __init__(self, jobs: Mapping[Job, Sequence[int]], folder: Path, trust: bool) -> None:
        self._store = Store(folder)
        self._shards: dict[Job, list[Rollout | None]] = {}
        self._paths: dict[Job, list[Path]] = {}
        left: dict[str, list[tuple[Job, int, Sequence[int]]]] = {}  # of each environment
        for job, seeds in jobs.items():
            flight, portions = job.flight(trust), shards(seeds)
            lasting = job.lasting and len(portions) > 1
            paths = [self._store.path(flight, portion) for portion in portions] if lasting else []
            found = [self._store.load(path) for path in paths] or [None] * len(portions)
            self._paths[job], self._shards[job] = paths, found
            missing = [(job, k, part) for k, part in enumerate(portions) if found[k] is None]
            left.setdefault(job.task.id, []).extend(missing)
        order = spread(list(left.values()))
        self._places = [(job, k) for job, k, _ in order]
        self.calls = [(job.flight(trust), portion) for job, _, portion in order]

    def enter(self, index: int, flown: Rollout) -> Job:
        """Keep what a call came to; returns whose it is."""
        job, k = self._places[index]
        self._shards[job][k] = flown
        if self._paths[job]:
            self._store.save(self._paths[job][k], flown)
        return job

    def whole(self, job: Job) -> Rollout | None:
        """All seeds of a job, once they are there."""
        parts = [part for part in self._shards[job] if part is not None]
        return join(parts) if len(parts) == len(self._shards[job]) else None

    def close(self, job: Job) -> None:
        """Forget the shards of a job whose result is saved."""
        for path in self._paths[job]:
            path.unlink(missing_ok=True)
        self._shards[job].clear()


def spread(lists: Sequence[Sequence[Item]]) -> list[Item]:
    """All items: the first of each list, then the others in their order, lists evenly mixed."""
    placed = [(i / len(items), item) for items in lists for i, item in enumerate(items)]
    return [item for _, item in sorted(placed, key=lambda pair: pair[0])]


def _job(
    task: Task, scenario: str, config: Config, spec: str, trust: bool, told_truth: bool = False
) -> Job:
    try:
        entry = registry.load(spec, task, config, trust=trust)
    except NotApplicable as reason:
        return Job(task, scenario, config, spec, None, str(reason), told_truth)
    return Job(task, scenario, config, spec, entry, told_truth=told_truth)


def _can_be_told_truth(config: Config) -> bool:
    choices = get_args(field_types(type(config)).get("estimator"))
    return TRUTH in choices and getattr(config, "estimator", TRUTH) != TRUTH


def _result(job: Job, flown: Rollout) -> results.Result:
    assert job.entry is not None
    information = job.entry.information
    return results.Result(
        env=job.task.id,
        scenario=job.scenario,
        estimator=job.estimator,
        perception=job.perception,
        policy=job.policy,
        label=f"{job.entry.name} ({TRUTH})" if job.told_truth else job.entry.name,
        summary=job.entry.summary,
        information=TRUTH if information == "belief" and job.estimator == TRUTH else information,
        config=to_json(job.entry.config),
        units=dict(job.task.metrics),
        us_per_decision=1e6 * flown.decision_seconds / flown.decisions if flown.decisions else None,
        episodes=measure(flown, job.task),
    )
