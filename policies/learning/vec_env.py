"""A Gymnasium vector environment as Stable-Baselines3 wants it."""

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.vec_env import VecEnv

import mpm


class VectorFace(VecEnv):
    """`VectorFace(gymnasium.make_vec("robosim:robosim/SpoonPour-v0", num_envs=8))`: the same environments for SB3.

    The vector environment begins its episodes anew in the same step, as those of robosim do.
    """

    def __init__(self, vector: gymnasium.vector.VectorEnv) -> None:
        if vector.metadata.get("autoreset_mode") is not AutoresetMode.SAME_STEP:
            raise mpm.InvalidValue(f"VectorFace: autoreset_mode = {vector.metadata.get('autoreset_mode')}; accepted: "
                                   f"{AutoresetMode.SAME_STEP}")
        self.vector = vector
        super().__init__(vector.num_envs, vector.single_observation_space, vector.single_action_space)

    def reset(self) -> Any:
        """Start all episodes, with the seeds and options given before."""
        options = self._options[0] or None
        if any((other or None) != options for other in self._options):
            raise mpm.InvalidValue("VectorFace: options differ between environments; accepted: the same for all")
        seen, infos = self.vector.reset(seed=list(self._seeds), options=options)  # pyright: ignore[reportArgumentType]
        self.reset_infos = [one_of(infos, e) for e in range(self.num_envs)]
        self._reset_seeds()
        self._reset_options()
        return seen

    def step_async(self, actions: np.ndarray) -> None:
        """Take actions (n, dimensions)."""
        self._actions = actions

    def step_wait(self) -> tuple[Any, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Observations, rewards, ends, infos; of an episode that ended the info of its end, and its last observation
        as "terminal_observation"."""
        seen, rewards, ended, cut, infos = self.vector.step(self._actions)
        over = ended | cut
        rows = []
        for e in range(self.num_envs):
            row = one_of(infos, e)
            if over[e]:
                last, final = row.pop("final_obs"), row.pop("final_info")
                self.reset_infos[e] = row
                row = final | {"terminal_observation": last}
            row["TimeLimit.truncated"] = bool(cut[e] and not ended[e])
            rows.append(row)
        return seen, rewards.astype(np.float32), over, rows

    def close(self) -> None:
        """End the environments."""
        self.vector.close()

    def get_attr(self, attr_name: str, indices: int | Sequence[int] | None = None) -> list[Any]:
        """An attribute that all environments share, such as `render_mode`."""
        return [getattr(self.vector, attr_name)] * len(self._chosen(indices))

    def set_attr(self, attr_name: str, value: Any, indices: int | Sequence[int] | None = None) -> None:
        """Environments of one field have no attributes of their own."""
        raise mpm.InvalidValue(f"VectorFace: {attr_name} cannot be set; give it as an option of gymnasium.make_vec")

    def env_method(self, method_name: str, *method_args: Any, indices: int | Sequence[int] | None = None,
                   **method_kwargs: Any) -> list[Any]:
        """Environments of one field have no methods of their own."""
        raise mpm.InvalidValue(f"VectorFace: {method_name} cannot be called on single environments; make one alone")

    def env_is_wrapped(self, wrapper_class: type[gymnasium.Wrapper],
                       indices: int | Sequence[int] | None = None) -> list[bool]:
        """Never: SB3's Monitor goes around the whole (VecMonitor)."""
        return [False] * len(self._chosen(indices))

    def _chosen(self, indices: int | Sequence[int] | None) -> list[int]:
        return list(self._get_indices(indices))


def one_of(infos: dict[str, Any], e: int) -> dict[str, Any]:
    """The info of one environment among those of a vector."""
    row = {}
    for key, value in infos.items():
        if key.startswith("_") or not infos.get(f"_{key}", np.ones(e + 1, bool))[e]:
            continue
        row[key] = one_of(value, e) if isinstance(value, dict) else value[e]
    return row
