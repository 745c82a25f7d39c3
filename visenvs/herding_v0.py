"""Herding as a PettingZoo environment: aircraft `aircraft_0`, ... that share the arena.

`herding_v0.parallel_env("firmware", aircraft=4)` has all agents act at once; `env` and `raw_env`
are the same by conversion to agents that act in turn. A step lasts until any aircraft is free to
choose; one that is busy may only go on.
"""

from __future__ import annotations

from functools import partial

from visenvs.envs.herding import ENV_ID
from visenvs.faces import team

parallel_env = partial(team.parallel_env, ENV_ID, prefix="aircraft_")
raw_env = partial(team.raw_env, ENV_ID, prefix="aircraft_")
env = partial(team.env, ENV_ID, prefix="aircraft_")
