"""Demonstrations in one HDF5 file: Minari's layout, and the environment's own numbers."""

import json
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

import mpm
from policies.demonstrations.export import export

h5py = pytest.importorskip("h5py")
ACTION_REPEAT, STEPS = 250, 4
STEP_DATASETS = {"actions": (STEPS, 3), "rewards": (STEPS,), "terminations": (STEPS,), "truncations": (STEPS,)}
"""Datasets of an episode's group in Minari's layout, with a row a step; observations have one more.

Source: https://minari.farama.org/content/dataset_standards/, section HDF5 format.
"""


def write_demonstrations(folder: Path) -> list[np.ndarray]:
    """Write two random demonstrations, the second from the nominal start; return their actions."""
    rng = np.random.default_rng(0)
    motions = [rng.uniform(-0.2, 0.2, (STEPS, 3)).astype(np.float32) for _ in range(2)]
    for k, actions in enumerate(motions):
        np.savez(folder / f"demonstration_{k}.npz", actions=actions, action_repeat=ACTION_REPEAT, seed=7 + k,
                 nominal=k == 1)
    return motions


def test_a_file_holds_what_the_environment_returns(tmp_path: Path) -> None:
    """Episode by episode against the environment, made from the file's own specification and stepped by hand."""
    motions, out = write_demonstrations(tmp_path), tmp_path / "below" / "all.hdf5"
    assert export("SpoonTranslate", tmp_path, out, obs="moments", action_repeat=ACTION_REPEAT) == 0
    with h5py.File(out) as file:
        spec = json.loads(file.attrs["env_spec"])
        env = gymnasium.make(f"robosim:{spec['id']}", **spec["kwargs"])
        assert (env.unwrapped.TASK, env.unwrapped.action_repeat) == ("SpoonTranslate", ACTION_REPEAT)
        for k, actions in enumerate(motions):
            group = file[f"episode_{k}"]
            observation, _ = env.reset(seed=7 + k, options={"nominal": k == 1})
            assert np.array_equal(group["observations"][0], observation) and np.array_equal(group["actions"], actions)
            for t, action in enumerate(actions):
                observation, reward, terminated, truncated, info = env.step(action)
                assert np.array_equal(group["observations"][t + 1], observation) and group["rewards"][t] == reward
                assert (group["terminations"][t], group["truncations"][t]) == (terminated, truncated)
                assert (terminated, truncated) == (t == STEPS - 1, False)
            assert group.attrs["tcs"] == info["tcs"] and group.attrs["is_success"] == info["is_success"]


@pytest.mark.parametrize("obs", ["moments", "dict"])
def test_a_file_has_the_layout_of_minari(tmp_path: Path, obs: str) -> None:
    """Groups, datasets, their lengths and types, and attributes, field by field; a Dict space is a group of arrays."""
    write_demonstrations(tmp_path)
    out = tmp_path / "all.hdf5"
    assert export("SpoonTranslate", tmp_path, out, obs=obs, action_repeat=ACTION_REPEAT) == 0
    space = gymnasium.make("robosim:robosim/SpoonTranslate-v0", obs=obs).observation_space
    with h5py.File(out) as file:
        assert set(file) == {"episode_0", "episode_1"}
        assert (file.attrs["total_episodes"], file.attrs["total_steps"]) == (2, 2 * STEPS)
        for k in range(2):
            group = file[f"episode_{k}"]
            assert set(group) == {"observations", *STEP_DATASETS}
            assert {name: group[name].shape for name in STEP_DATASETS} == STEP_DATASETS
            assert group["rewards"].dtype.kind == "f"
            assert group["terminations"].dtype == group["truncations"].dtype == bool
            assert (group.attrs["id"], group.attrs["seed"], group.attrs["total_steps"]) == (k, 7 + k, STEPS)
            check_observations(group["observations"], space)


def check_observations(stored: Any, space: gymnasium.Space) -> None:
    """One array, or a group of one for each part of a Dict space, with STEPS + 1 rows of the space's shape and type."""
    if isinstance(space, gymnasium.spaces.Dict):
        assert set(stored) == set(space)
        for key, part in space.items():
            check_observations(stored[key], part)
        return
    assert stored.shape == (STEPS + 1, *space.shape) and stored.dtype == space.dtype
    assert all(space.contains(row) for row in stored[:])


def test_what_cannot_be_exported_is_refused(tmp_path: Path) -> None:
    with pytest.raises(mpm.InvalidValue, match="no demonstration_"):
        export("SpoonTranslate", tmp_path, tmp_path / "a.hdf5")
    with pytest.raises(mpm.InvalidValue, match="SpoonStir.*accepted: Bottle"):
        export("SpoonStir", tmp_path, tmp_path / "a.hdf5")
