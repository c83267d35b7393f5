"""Gymnasium vector environments as vectorized environments of Stable-Baselines3."""

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.vec_env import VecEnv

import mpm


class SB3VecEnv(VecEnv):
    """A Gymnasium vector environment for Stable-Baselines3.
    `SB3VecEnv(gymnasium.make_vec("robosim:robosim/SpoonPour-v0", num_envs=8))`
    mode: the environment's autoreset mode, which only a subclass that starts episodes itself has another one of. Raises
    mpm.InvalidValue for an environment that does not reset in the same step (AutoresetMode.SAME_STEP), as robosim's do.
    """

    def __init__(self, vector: gymnasium.vector.VectorEnv, mode: AutoresetMode = AutoresetMode.SAME_STEP) -> None:
        if vector.metadata.get("autoreset_mode") is not mode:
            raise mpm.InvalidValue(f"SB3VecEnv: autoreset_mode = {vector.metadata.get('autoreset_mode')}; accepted: "
                                   f"{mode}")
        self.vector = vector
        super().__init__(vector.num_envs, vector.single_observation_space, vector.single_action_space)

    def reset(self) -> Any:
        """Reset all environments with the seeds and options set before; returns observations (n, ...)."""
        options = self._options[0] or None
        if any((other or None) != options for other in self._options):
            raise mpm.InvalidValue("SB3VecEnv: options differ between environments; accepted: the same for all")
        observations, infos = self.vector.reset(seed=list(self._seeds), options=options)  # pyright: ignore[reportArgumentType]
        self.reset_infos = [select_info(infos, e) for e in range(self.num_envs)]
        self._reset_seeds()
        self._reset_options()
        return observations

    def step_async(self, actions: np.ndarray) -> None:
        """Set the actions (n, dimensions) of the next step."""
        self._actions = actions

    def step_wait(self) -> tuple[Any, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Step; returns observations (n, ...), rewards (n,), dones (n,) and infos.
        The info of an episode that is done is that of its last step, with its last observation as
        "terminal_observation"."""
        observations, rewards, terminated, truncated, infos = self.vector.step(self._actions)
        dones = terminated | truncated
        rows = []
        for e in range(self.num_envs):
            row = select_info(infos, e)
            if dones[e]:
                final_observation, final_info = row.pop("final_obs"), row.pop("final_info")
                self.reset_infos[e] = row
                row = final_info | {"terminal_observation": final_observation}
            row["TimeLimit.truncated"] = bool(truncated[e] and not terminated[e])
            rows.append(row)
        return observations, rewards.astype(np.float32), dones, rows

    def close(self) -> None:
        """Close the vector environment."""
        self.vector.close()

    def get_attr(self, attr_name: str, indices: int | Sequence[int] | None = None) -> list[Any]:
        """Return an attribute that all environments share, such as `render_mode`."""
        return [getattr(self.vector, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: int | Sequence[int] | None = None) -> None:
        """Raise mpm.InvalidValue: environments of a batch have no attributes of their own."""
        raise mpm.InvalidValue(f"SB3VecEnv: {attr_name} cannot be set; give it as an option of gymnasium.make_vec")

    def env_method(self, method_name: str, *method_args: Any, indices: int | Sequence[int] | None = None,
                   **method_kwargs: Any) -> list[Any]:
        """Raise mpm.InvalidValue: environments of a batch have no methods of their own."""
        raise mpm.InvalidValue(f"SB3VecEnv: {method_name} cannot be called on one environment of a batch; make a "
                               f"single environment with gymnasium.make")

    def env_is_wrapped(self, wrapper_class: type[gymnasium.Wrapper],
                       indices: int | Sequence[int] | None = None) -> list[bool]:
        """Return False for each: wrappers of Stable-Baselines3 (VecMonitor) wrap the whole batch."""
        return [False for _ in self._get_indices(indices)]



def select_info(infos: dict[str, Any], e: int) -> dict[str, Any]:
    """Return the info of environment `e` from the infos of a vector environment."""
    row = {}
    for key, value in infos.items():
        if key.startswith("_") or not infos.get(f"_{key}", np.ones(e + 1, bool))[e]:
            continue
        row[key] = select_info(value, e) if isinstance(value, dict) else value[e]
    return row
