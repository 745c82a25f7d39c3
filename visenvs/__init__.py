"""visenvs: vision-based UAV guidance with the filter in the loop, for Gymnasium and PettingZoo.

Importing this package registers every environment id and nothing more; kernels compile when used.
"""

from __future__ import annotations

from gymnasium.envs.registration import register, registry

from visenvs.core.registry import environment_files

__version__ = "0.1.0"

for _id in environment_files():
    if _id not in registry:
        register(
            id=_id,
            entry_point="visenvs.faces.single:LaneEnv",
            vector_entry_point="visenvs.faces.batch:LaneVectorEnv",
            kwargs={"env_id": _id},
        )
