"""Formation flight as a PettingZoo environment: N followers `follower_0`, ... in a tree of leaders.

`formation_v0.parallel_env("team", followers=5)` has all agents act at once; `env` and `raw_env` are
the same by conversion to agents that act in turn.
"""

from __future__ import annotations

from functools import partial

from visenvs.envs.formation import ENV_ID
from visenvs.faces import team

parallel_env = partial(team.parallel_env, ENV_ID, prefix="follower_")
raw_env = partial(team.raw_env, ENV_ID, prefix="follower_")
env = partial(team.env, ENV_ID, prefix="follower_")
