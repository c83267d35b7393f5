"""Run folders and their episodes."""

from pathlib import Path

import gymnasium
import numpy as np
import pytest

import mpm
from policies.runs import checkpoint
from policies.runs.episodes import Episode, Episodes
from policies.runs.run_folder import RunFolder

MANIFEST = {"task": "t", "material": "m", "method": "x", "seed": 0, "fingerprint": "f", "n_envs": 1}


def test_the_best_motion_outlasts_a_resume(tmp_path):
    """A worse episode after the resume does not replace it."""
    def row(k, total):
        return Episode({"episode": k, "return": total, "seconds": 1.0, "simulating": 0.5, "diverged": ""},
                       np.full((5, 1), total))

    folder = RunFolder(tmp_path, MANIFEST)
    assert folder.add(row(0, 1.0), 10) and not folder.add(row(1, 0.5), 10)
    folder.checkpoint.write_bytes(checkpoint.pack(None, rows=folder.rows, best=folder.best_return))
    _, state = checkpoint.load(folder.checkpoint, None, None)
    folder.close()
    later = RunFolder(tmp_path, MANIFEST)
    later.rows, later.best_return = state["rows"], state["best"]
    assert not later.add(row(2, 0.7), 10)
    with np.load(tmp_path / "best.npz") as best:
        assert float(best["return"]) == 1.0 and np.all(best["actions"] == 1.0)


def test_a_checkpoint_of_another_user_executes_nothing(tmp_path, monkeypatch):
    class Evil:
        def __reduce__(self):
            return Path.touch, (tmp_path / "executed",)

    path, own = tmp_path / "checkpoint.zip", checkpoint.pack(None, evil=1)
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "another user's"))
    for content in (own, checkpoint.pack(None, evil=Evil())[:-1] + b"g", b""):
        path.write_bytes(content)
        with pytest.raises(mpm.InvalidValue, match="cannot be read"):
            checkpoint.load(path)
    assert not (tmp_path / "executed").exists() and (tmp_path / "another user's/robosim/checkpoint.key").stat(
        ).st_mode & 0o777 == 0o600
    path.write_bytes(checkpoint.pack(None, mine=1))
    (other := tmp_path / "other.zip").write_bytes(checkpoint.pack(None, evil=Evil()))
    monkeypatch.setattr(Path, "is_file", lambda path: False)  # as for one of two processes that make the key at once
    monkeypatch.setattr("hmac.compare_digest", lambda *both: both[0] == both[1] and other.replace(path))
    assert checkpoint.load(path)[1]["mine"] == 1 and not (tmp_path / "executed").exists()


def test_a_folder_of_another_run_is_refused(tmp_path):
    """With each entry in which it differs, unless forced."""
    RunFolder(tmp_path / "a", MANIFEST).close()
    with pytest.raises(mpm.InvalidValue, match="seed 0, now 1"):
        RunFolder(tmp_path / "a", {**MANIFEST, "seed": 1})
    RunFolder(tmp_path / "a", {**MANIFEST, "seed": 1}, force=True).close()
    with pytest.raises(mpm.InvalidValue, match=r"preset.options.gamma 0.9, now 0.8; give") as refused:
        RunFolder(tmp_path / "b", {**MANIFEST, "preset": {"options": {"gamma": 0.9, "tau": 0.1}}}).close()
        RunFolder(tmp_path / "b", {**MANIFEST, "preset": {"options": {"gamma": 0.8, "tau": 0.1}}})
    assert "tau" not in str(refused.value)


def test_needed_decisions():
    """Up to the last one that changed a reading, in each episode."""
    class Counting(gymnasium.Env):
        observation_space = action_space = gymnasium.spaces.Box(-1.0, 1.0, (1,))

        def reset(self, *, seed=None, options=None):
            super().reset(seed=seed)
            self.t = 0
            return np.zeros(1, np.float32), {}

        def step(self, action):
            self.t += 1
            info = {"tcs": 1.0, "is_success": True, "readings": {"delivered": min(self.t, self.last) / self.last}}
            return np.zeros(1, np.float32), 1.0, self.t == 10, False, info

    ended, env = [], Counting()
    episodes = Episodes(env, 0, None, ended.append)
    for env.last in (7, 3):
        episodes.reset()
        while not episodes.step(np.zeros(1))[2]:
            pass
    assert [episode.row["needed"] for episode in ended] == [7, 3]


def test_episodes_with_different_columns_share_a_table(tmp_path):
    """The rows of an earlier version, without a column that was added since."""
    folder = RunFolder(tmp_path, MANIFEST)
    folder.rows = [{"episode": 0, "return": 1.0, "seconds": 1.0, "simulating": 0.5, "diverged": ""}]
    folder.add(Episode({**folder.rows[0], "episode": 1, "needed": 4}, np.zeros((5, 1))), 10)
    lines = (tmp_path / "episodes.csv").read_text().splitlines()
    assert lines == ["episode,return,seconds,simulating,diverged,needed", "0,1.0,1.0,0.5,,", "1,1.0,1.0,0.5,,4"]
