"""Demonstrations as a Minari dataset, and its HDF5 file alone: the layout, and the environment's own numbers."""

import json
from pathlib import Path
from typing import Any

import gymnasium
import minari
import numpy as np
import pytest

import mpm
from policies.demonstrations.export import dataset_files, export, write_dataset
from policies.demonstrations.reading import PlayedDemonstration
from robosim.base.errors import ConfigError

h5py = pytest.importorskip("h5py")
ACTION_REPEAT, STEPS = 250, 4
STEP_DATASETS = {"actions": (STEPS, 3), "rewards": (STEPS,), "terminations": (STEPS,), "truncations": (STEPS,)}
"""Datasets of an episode's group in Minari's layout, with a row a step; observations have one more.
Source: https://minari.farama.org/content/dataset_standards/, section HDF5 format."""


def write_demonstrations(folder: Path) -> list[np.ndarray]:
    """Write two random demonstrations, the second from the nominal start; return their actions."""
    rng = np.random.default_rng(0)
    motions = [rng.uniform(-0.2, 0.2, (STEPS, 3)).astype(np.float32) for _ in range(2)]
    for k, actions in enumerate(motions):
        np.savez(folder / f"demonstration_{k}.npz", actions=actions, action_repeat=ACTION_REPEAT, seed=7 + k,
                 nominal=k == 1)
    return motions


@pytest.mark.long
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


@pytest.mark.long
@pytest.mark.parametrize("obs", ["moments", "dict"])
def test_minari_opens_a_dataset(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, obs: str) -> None:
    """By its name, with the environment's spaces; and its file has Minari's layout, field by field."""
    motions = write_demonstrations(tmp_path)
    out = tmp_path / "sets" / "translate-v2"
    assert export("SpoonTranslate", tmp_path, out, obs=obs, action_repeat=ACTION_REPEAT) == 0
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "sets"))
    assert list(minari.list_local_datasets()) == ["translate-v2"]
    dataset = minari.load_dataset("translate-v2")
    assert (dataset.total_episodes, dataset.total_steps, dataset.spec.version) == (2, 2 * STEPS, 2)
    env = dataset.recover_environment()
    assert (env.unwrapped.TASK, env.unwrapped.action_repeat) == ("SpoonTranslate", ACTION_REPEAT)
    assert dataset.observation_space == env.observation_space and dataset.action_space == env.action_space
    with h5py.File(out / "data" / "main_data.hdf5") as file:
        assert set(file) == {"episode_0", "episode_1"}
        assert (file.attrs["total_episodes"], file.attrs["total_steps"]) == (2, 2 * STEPS)
        for k, episode in enumerate(dataset):
            group = file[f"episode_{k}"]
            assert set(group) == {"observations", *STEP_DATASETS}
            assert {name: group[name].shape for name in STEP_DATASETS} == STEP_DATASETS
            assert group["rewards"].dtype.kind == "f"
            assert group["terminations"].dtype == group["truncations"].dtype == bool
            assert (group.attrs["id"], group.attrs["seed"], group.attrs["total_steps"]) == (k, 7 + k, STEPS)
            check_observations(group["observations"], env.observation_space)
            assert episode.id == k and np.array_equal(episode.actions, motions[k])
            assert np.array_equal(episode.rewards, group["rewards"])
            check_observations(episode.observations, env.observation_space)


def test_an_export_that_fails_leaves_no_dataset(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Not even the metadata of an earlier one, which would belong to other transitions."""
    files = dataset_files(tmp_path / "set")
    write_dataset(*files, [], {"dataset_id": "set", "env_spec": "{}"})
    assert all(path.is_file() for path in files)

    def full(*_: object) -> None:
        raise OSError("no space left")

    monkeypatch.setattr("policies.demonstrations.export.write_episode", full)
    with pytest.raises(OSError, match="no space"):
        write_dataset(*files, [PlayedDemonstration("a", 0, [])], {"dataset_id": "set", "env_spec": "{}"})
    assert [path.name for path in (tmp_path / "set" / "data").iterdir()] == ["main_data.hdf5"]


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
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "notes.txt").write_text("")
    for task, out, error, message in (
            ("SpoonTranslate", "mine", ConfigError, "holds other files, such as notes.txt"),
            ("SpoonTranslate", "a.hdf5", mpm.InvalidValue, "no demonstration_"),
            ("SpoonTranslate", "a b", mpm.InvalidValue, "cannot be called 'a b'; accepted: letters"),
            ("SpoonStir", "a.hdf5", ConfigError, "SpoonStir.*valid: Bottle")):
        with pytest.raises(error, match=message):
            export(task, tmp_path, tmp_path / out)
