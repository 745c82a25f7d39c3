"""What every step of every task shares, as compiled loops over lane records seen as plain numbers.

Checking actions, opening a step, rewards, divergence, time limits, observation rows.
"""

from __future__ import annotations

import math

from visenvs.core.compile import kernel
from visenvs.core.outcome import DIVERGED, RUNNING, TIME_LIMIT

HEADER = [("seed", "u8"), ("episode", "i8"), ("step", "i8"), ("outcome", "i8")]
STEP, OUTCOME = 2, 3  # places in the header
ROUNDING = 1e-6  # how far outside its box an action may lie


@kernel
def begin(integers, floats, costs, actions):
    """Check the actions of all running lanes, then open their next step: count it, clear the costs.

    Returns the index of the first lane whose action is not finite or leaves [-1, 1], with no lane
    touched, or -1.
    """
    limit = 1.0 + ROUNDING
    for i in range(integers.shape[0]):
        if integers[i, OUTCOME] == RUNNING:
            for j in range(actions.shape[1]):
                if not abs(actions[i, j]) <= limit:
                    return i
    open_step(integers, floats, costs)
    return -1


@kernel
def begin_chosen(integers, floats, costs, mask, count, actions):
    """The same for actions that are the numbers of choices: of `count`, those with 1 in the mask.

    `mask` (count,) or (0,) holds the places of the lane record that tell what may be taken.
    """
    for i in range(integers.shape[0]):
        if integers[i, OUTCOME] == RUNNING:
            chosen = actions[i, 0]
            if not 0.0 <= chosen < count or chosen != math.floor(chosen):
                return i
            if mask.shape[0] > 0 and not floats[i, mask[int(chosen)]] > 0.5:
                return i
    open_step(integers, floats, costs)
    return -1


@kernel
def open_step(integers, floats, costs):
    """Count the step of every running lane and clear all costs."""
    for i in range(integers.shape[0]):
        if integers[i, OUTCOME] == RUNNING:
            integers[i, STEP] += 1
        for j in range(costs.shape[0]):
            floats[i, costs[j]] = 0.0


@kernel
def settle(integers, floats, costs, slots, max_steps, terms, rewards, rows):
    """Finish a step: rewards, divergence, time limit, rows. Returns how many lanes have ended."""
    ended = 0
    for i in range(integers.shape[0]):
        reward = 0.0
        for j in range(costs.shape[0]):
            terms[i, j] = 0.0 - floats[i, costs[j]]
            reward += terms[i, j]
        finite = reward
        for j in range(slots.shape[0]):
            finite += 0.0 * floats[i, slots[j]["source"]]
        if not math.isfinite(finite):
            integers[i, OUTCOME] = DIVERGED
            reward = 0.0
            for j in range(costs.shape[0]):
                floats[i, costs[j]] = 0.0
                terms[i, j] = 0.0
        elif integers[i, OUTCOME] == RUNNING and max_steps > 0 and integers[i, STEP] >= max_steps:
            integers[i, OUTCOME] = TIME_LIMIT
        rewards[i] = reward
        ended += integers[i, OUTCOME] != RUNNING
    write_rows(floats, slots, rows)
    return ended


@kernel
def write_rows(floats, slots, rows):
    """Rows from lane records seen as float64 (n, k): clipped, scaled, 0 where not finite."""
    for i in range(rows.shape[0]):
        for j in range(slots.shape[0]):
            slot = slots[j]
            value = floats[i, slot["source"]]
            if not math.isfinite(value):
                value = 0.0
            rows[i, j] = min(max(value, slot["low"]), slot["high"]) * slot["gain"]
