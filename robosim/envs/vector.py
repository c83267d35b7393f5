"""Several environments at once, each in a process of its own: `gymnasium.make_vec("robosim/SpoonPour-v0", num_envs=4)`.

Processes are spawned, never forked: the backend of the field does not survive a fork. Hence a script that makes one
needs the usual `if __name__ == "__main__":`.
"""

from functools import partial
from typing import Any

import gymnasium
from gymnasium.vector import AsyncVectorEnv, AutoresetMode

from robosim.errors import ConfigError


class GrainVectorEnv(AsyncVectorEnv):
    """Environments of one sub-task in step; one that ends begins anew in the same step.

    options go to every environment. The last observation of an episode is in `infos["final_obs"]`.
    """

    def __init__(self, name: str, num_envs: int, **options: Any) -> None:
        if num_envs < 1:
            raise ConfigError(f"num_envs = {num_envs}; accepted: a whole number from 1 on")
        options.pop("max_episode_steps", None)  # the task's own horizon holds
        super().__init__([partial(one, name, options)] * num_envs, context="spawn",
                         autoreset_mode=AutoresetMode.SAME_STEP)


def one(name: str, options: dict[str, Any]) -> gymnasium.Env:
    """One of the environments, in its process."""
    import robosim  # noqa: F401  (registers the ids there)

    return gymnasium.make(f"robosim/{name}-v0", **options)
