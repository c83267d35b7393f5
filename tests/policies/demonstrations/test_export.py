"""Demonstrations in one file for other libraries: the layout, and the numbers of the environment itself."""

import json
from pathlib import Path

import gymnasium
import numpy as np
import pytest

import mpm
from policies.demonstrations.export import export

h5py = pytest.importorskip("h5py")
HOLD = 250


def test_a_file_holds_what_the_environment_says(tmp_path: Path) -> None:
    """Two demonstrations from two starts, episode by episode, against the environment stepped by hand."""
    rng, given = np.random.default_rng(0), []
    for k in range(2):
        given.append(rng.uniform(-0.2, 0.2, (4, 3)).astype(np.float32))
        np.savez(tmp_path / f"demonstration_{k}.npz", actions=given[k], hold=HOLD, seed=7 + k, nominal=k == 1)
    out = tmp_path / "below" / "all.hdf5"
    assert export("SpoonTranslate", tmp_path, out, obs="moments", hold=HOLD) == 0
    env = gymnasium.make("robosim:robosim/SpoonTranslate-v0", obs="moments", action_repeat=HOLD)
    with h5py.File(out) as file:
        assert (file.attrs["total_episodes"], file.attrs["total_steps"]) == (2, 8)
        assert json.loads(file.attrs["env_spec"])["kwargs"] == {"obs": "moments", "action_repeat": HOLD}
        for k, actions in enumerate(given):
            group = file[f"episode_{k}"]
            seen, _ = env.reset(seed=7 + k, options={"nominal": k == 1})
            assert np.array_equal(group["observations"][0], seen) and np.array_equal(group["actions"], actions)
            for t, action in enumerate(actions):
                seen, reward, terminated, truncated, info = env.step(action)
                assert np.array_equal(group["observations"][t + 1], seen) and group["rewards"][t] == reward
                assert (group["terminations"][t], group["truncations"][t]) == (terminated, truncated) == (t == 3, False)
            assert group.attrs["tcs"] == info["tcs"] and group.attrs["total_steps"] == 4


def test_what_cannot_be_exported_is_said(tmp_path: Path) -> None:
    with pytest.raises(mpm.InvalidValue, match="no demonstration_"):
        export("SpoonTranslate", tmp_path, tmp_path / "a.hdf5")
    with pytest.raises(mpm.InvalidValue, match="Spoon"):
        export("SpoonStir", tmp_path, tmp_path / "a.hdf5")
