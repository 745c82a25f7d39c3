"""How an episode can end."""

from __future__ import annotations

from enum import IntEnum


class Outcome(IntEnum):
    """The state of a lane: running, or the reason why it ended.

    `terminated` is every end but `TIME_LIMIT`; `truncated` is `TIME_LIMIT`.
    """

    RUNNING = 0
    SUCCESS = 1
    MISS = 2
    COLLISION = 3
    LOST = 4
    OUT_OF_BOUNDS = 5
    DIVERGED = 6
    TIME_LIMIT = 7


RUNNING = int(Outcome.RUNNING)
SUCCESS = int(Outcome.SUCCESS)
MISS = int(Outcome.MISS)
COLLISION = int(Outcome.COLLISION)
LOST = int(Outcome.LOST)
DIVERGED = int(Outcome.DIVERGED)
TIME_LIMIT = int(Outcome.TIME_LIMIT)
