"""Runs: killed ones go on, the best is kept, what does not fit is refused; sweeps of them."""

import json
import subprocess
import sys
import time

import gymnasium
import numpy as np
import pytest

import mpm

torch = pytest.importorskip("torch")
from policies.demonstrations.reading import read, start_in  # noqa: E402
from policies.learning.presets import Preset, known, load_preset  # noqa: E402
from policies.methods.train import train  # noqa: E402
from policies.runs import checkpoint  # noqa: E402
from policies.runs.episodes import Episode, Episodes  # noqa: E402
from policies.runs.run_folder import RunFolder  # noqa: E402
from policies.runs.sweep import SweepFile, planned  # noqa: E402
from policies.runs.training import Training  # noqa: E402

torch.set_num_threads(1)
SMALL = {"learning_rate": 1e-3, "batch_size": 32, "learning_starts": 0, "policy_kwargs": {"net_arch": [32, 32]}}
"""Options of a learner that is quick."""


def preset(**changes) -> Preset:
    return load_preset("sac").model_copy(update={"episodes": 4, "options": SMALL, **changes})


@pytest.mark.parametrize("learner", ["SAC", "PPO"])
def test_a_run_that_is_cut_goes_on_to_the_same_bits(tmp_path, learner):
    """Cut after two of four episodes, where the checkpoint is, and gone on with in another process's stead."""
    options = SMALL if learner == "SAC" else {"n_steps": 200, "batch_size": 50, "learning_rate": 1e-3}
    from policies.runs import training as module

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "EVERY", 2)
        chosen = preset(learner=learner, options=options)
        whole = Training("x", chosen, "Pendulum-v1", tmp_path / "whole", seed=1)
        whole.learn()
        cut = Training("x", chosen, "Pendulum-v1", tmp_path / "cut", seed=1)
        cut.preset = chosen.model_copy(update={"episodes": 3})
        cut.learn()
        with pytest.raises(mpm.InvalidValue, match="another process"):
            Training("x", chosen, "Pendulum-v1", tmp_path / "cut", seed=1)
        cut.folder.close()
        np.random.seed(99)  # noqa: NPY002  (nothing may hang on what this process did before)
        torch.manual_seed(99)
        again = Training("x", chosen, "Pendulum-v1", tmp_path / "cut", seed=1)
        again.learn()
    assert again.env.count == whole.env.count == 4
    for one, other in zip(again.model.policy.parameters(), whole.model.policy.parameters(), strict=True):
        assert torch.equal(one, other)
    keys = ("episode", "return", "decisions")
    assert [[row[key] for key in keys] for row in again.folder.rows] == [
        [row[key] for key in keys] for row in whole.folder.rows]


def test_the_best_is_kept_over_a_resume(tmp_path):
    """A worse episode after going on does not replace what was found before."""
    def row(k, total):
        return Episode({"episode": k, "return": total, "seconds": 1.0, "simulating": 0.5, "diverged": ""},
                       np.full((5, 1), total))

    told = {"task": "t", "material": "m", "method": "x", "seed": 0, "fingerprint": "f"}
    folder = RunFolder(tmp_path, told)
    assert folder.add(row(0, 1.0), 10) and not folder.add(row(1, 0.5), 10)
    checkpoint.save(folder.checkpoint, None, rows=folder.rows, best=folder.best)
    _, state = checkpoint.load(folder.checkpoint, None, None)
    folder.close()
    later = RunFolder(tmp_path, told)
    later.rows, later.best = state["rows"], state["best"]
    assert not later.add(row(2, 0.7), 10)
    with np.load(tmp_path / "best.npz") as best:
        assert float(best["return"]) == 1.0 and np.all(best["actions"] == 1.0)


def test_what_does_not_fit_is_refused(tmp_path):
    with pytest.raises(mpm.InvalidValue, match="accepted: bc, cmaes"):
        train("dgsac", "Pendulum-v1", tmp_path)
    with pytest.raises(mpm.InvalidValue, match="NoSuchTask"):
        train("sac", "NoSuchTask", tmp_path)
    with pytest.raises(mpm.InvalidValue, match="--demos"):
        train("dg_sac", "Pendulum-v1", tmp_path)
    np.savez(tmp_path / "demonstration_0.npz", actions=np.zeros((100, 6)))
    with pytest.raises(mpm.InvalidValue, match=r"shape \(100, 6\)"):
        train("dg_sac", "Pendulum-v1", tmp_path / "run", demos=tmp_path)
    with pytest.raises(mpm.InvalidValue, match="takes no demonstrations"):
        train("sac", "Pendulum-v1", tmp_path / "run", demos=tmp_path)
    np.savez(tmp_path / "demonstration_0.npz", actions=np.zeros((10, 3)))
    with pytest.raises(mpm.InvalidValue, match="10 actions"):
        read(tmp_path, 100, 10, 3)
    assert not (tmp_path / "run").exists()
    told = {"task": "t", "material": "m", "method": "x", "seed": 0, "fingerprint": "f"}
    RunFolder(tmp_path / "a", told).close()
    with pytest.raises(mpm.InvalidValue, match="seed 0, now 1"):
        RunFolder(tmp_path / "a", {**told, "seed": 1})
    RunFolder(tmp_path / "a", {**told, "seed": 1}, force=True).close()
    with pytest.raises(mpm.InvalidValue, match=r"preset.options.gamma 0.9, now 0.8; give") as refused:
        RunFolder(tmp_path / "b", {**told, "preset": {"options": {"gamma": 0.9, "tau": 0.1}}}).close()
        RunFolder(tmp_path / "b", {**told, "preset": {"options": {"gamma": 0.8, "tau": 0.1}}})
    assert "tau" not in str(refused.value)


def test_demonstrations_of_another_task_or_start_are_refused(tmp_path):
    """A motion says what it was made for; one that is corrected has to begin where it was made."""
    file = tmp_path / "demonstration_0.npz"
    np.savez(file, actions=np.zeros((100, 3)), task=np.array("SpoonTranslate"), seed=np.array(7),
             nominal=np.array(False))
    assert start_in(file) == (7, {"nominal": False})
    with pytest.raises(mpm.InvalidValue, match="made for SpoonTranslate; accepted: one for SpoonPour"):
        read(tmp_path, 100, 10, 3, "SpoonPour")
    with pytest.raises(mpm.InvalidValue, match="demonstration_0.npz: made for a start aside"):
        train("residual", "SpoonTranslate", tmp_path / "run", demos=tmp_path)
    assert not (tmp_path / "run").exists()
    np.savez(tmp_path / "demonstration_1.npz", actions=np.zeros((100, 3)), seed=np.array(8), nominal=np.array(True),
             task=np.array("SpoonTranslate"))
    again = Training("demo", load_preset("demo"), "robosim/SpoonTranslate-v0", tmp_path / "run", demos=tmp_path)
    assert list(again.sequences) == ["demonstration_1.npz"]  # the one that begins where episodes do
    assert again.folder.manifest["task"] == "SpoonTranslate"
    again.folder.close()
    (tmp_path / "demonstration_1.npz").unlink()
    np.savez(file, actions=np.zeros((100, 3)))
    assert start_in(file) == (0, {"nominal": True}) and list(read(tmp_path, 100, 10, 3, "SpoonPour")) == [file.name]


@pytest.mark.parametrize(("method", "obs"), [("bc", "dict"), ("gail", "dict"), ("pointnet_sac", "positions"),
                                             ("sets_sac", "moments"), ("rlpd", "dict")])
def test_what_a_method_cannot_see_is_refused(tmp_path, method, obs):
    with pytest.raises(mpm.InvalidValue, match=f"obs {obs}; accepted"):
        train(method, "SpoonTranslate", tmp_path / "run", obs=obs)


@pytest.mark.parametrize("method", ["ppo", "bc", "gail", "residual", "cmaes", "demo"])
def test_numbers_that_would_do_nothing_are_refused(method):
    """Shares of batches where no batch holds demonstrations; a run that an earlier version wrote them down for is still
    the same run."""
    right = load_preset(method).model_dump()
    wrong = {**right, "demonstrations": {"size": 50, "fraction": 0.5, "updates": 1}}
    with pytest.raises(ValueError, match="accepted: with SAC"):
        Preset(**wrong)
    assert known(wrong) == right


def test_files_with_mistakes_are_told_in_a_line(tmp_path):
    """The key, and those that there are; a sub-task that does not exist, before anything runs."""
    file = tmp_path / "mine.yaml"
    file.write_text("description: mine\nlearner: SAC\nepisods: 3\n")
    with pytest.raises(mpm.InvalidValue, match="unknown key 'episods'; accepted: description, .*episodes") as told:
        load_preset(str(file))
    assert "pydantic" not in str(told.value) and "\n" not in str(told.value)
    whole = {"methods": ["sac"], "seeds": [0], "out": tmp_path}
    for task in ("SpoonPuor", "shovel"):
        with pytest.raises(mpm.InvalidValue, match=f"tasks {task}; accepted: BottlePickPour, .*Pendulum-v1"):
            planned(SweepFile(tasks=["SpoonPour", task], **whole))
    assert len(planned(SweepFile(tasks=["SpoonPour", "Pendulum-v1"], **whole))) == 2


def test_a_sweep_sees_other_options(tmp_path):
    """A run that is finished with other words, such as another material, is not the one that is asked for."""
    def state(*options: str) -> str:
        return planned(SweepFile(tasks=["SpoonPour"], methods=["sac"], seeds=[0], options=list(options),
                                 out=tmp_path))[0].state

    folder = tmp_path / "SpoonPour" / "sac" / "seed_0"
    words = f"train sac SpoonPour --seed 0 --out {folder}"
    assert state() == "new"
    folder.mkdir(parents=True)
    (folder / "status.json").write_text('{"state": "finished"}')
    (folder / "manifest.json").write_text(json.dumps({"preset": load_preset("sac").model_dump(),
                                                      "command": f"robosim {words}"}))
    assert state() == "finished" and state("--material", "sugar") == "another"
    preset = {**load_preset("sac").model_dump(), "obs": "moments"}
    (folder / "manifest.json").write_text(json.dumps({"preset": preset, "command": f"robosim {words} --obs moments"}))
    assert state("--obs", "moments") == "finished" and state() == "another"


@pytest.mark.slow
def test_a_killed_command_goes_on(tmp_path):
    """SIGKILL after the first checkpoint; the same command ends with the table of one that was left alone."""
    def run(out, kill: bool):
        words = [sys.executable, "-m", "robosim", "train", "sac", "Pendulum-v1", "--episodes", "14", "--out",
                 str(out)]
        process = subprocess.Popen(words, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
        while kill and process.poll() is None:
            if (out / "checkpoint.zip").is_file():
                process.kill()
            time.sleep(0.02)
        return process.wait()

    assert run(tmp_path / "whole", False) == 0
    assert run(tmp_path / "cut", True) != 0
    assert run(tmp_path / "cut", False) == 0
    tables = [(tmp_path / name / "episodes.csv").read_text().splitlines() for name in ("whole", "cut")]
    cut = [[line.split(",")[:3] for line in lines] for lines in tables]  # returns, too
    assert cut[0] == cut[1] and len(cut[0]) == 15


@pytest.mark.slow
def test_a_sweep_that_is_killed_twice_ends_whole(tmp_path):
    """Two tasks, two methods, two seeds; SIGKILL to the sweep only: what it left behind is waited for, not repeated."""
    file, out = tmp_path / "sweep.yaml", tmp_path / "runs"
    file.write_text(f"tasks: [Pendulum-v1, MountainCarContinuous-v0]\nmethods: [sac, ppo]\nseeds: [0, 1]\nepisodes: 2\n"
                    f"out: {out}\n")
    words = [sys.executable, "-m", "robosim", "sweep", str(file), "--jobs", "2"]
    for seconds in (8, 12):
        process = subprocess.Popen(words, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
        time.sleep(seconds)
        process.kill()
        process.wait()
    assert subprocess.run(words, capture_output=True, check=False).returncode == 0
    states = [json.loads(path.read_text()) for path in out.rglob("status.json")]
    assert len(states) == 8 and all(state["state"] == "finished" and state["episodes"] == 2 for state in states)
    before = {path: path.stat().st_mtime_ns for path in out.rglob("status.json")}
    assert subprocess.run(words, capture_output=True, check=False).returncode == 0
    assert before == {path: path.stat().st_mtime_ns for path in out.rglob("status.json")}


def test_decisions_that_were_needed():
    """Those up to the last one after which a reading changed; counted anew in every episode."""
    class Counted(gymnasium.Env):
        observation_space = action_space = gymnasium.spaces.Box(-1.0, 1.0, (1,))

        def reset(self, *, seed=None, options=None):
            super().reset(seed=seed)
            self.t = 0
            return np.zeros(1, np.float32), {}

        def step(self, action):
            self.t += 1
            told = {"tcs": 1.0, "is_success": True, "readings": {"delivered": min(self.t, self.last) / self.last}}
            return np.zeros(1, np.float32), 1.0, self.t == 10, False, told

    seen, env = [], Counted()
    episodes = Episodes(env, 0, None, seen.append)
    for env.last in (7, 3):
        episodes.reset()
        while not episodes.step(np.zeros(1))[2]:
            pass
    assert [episode.row["needed"] for episode in seen] == [7, 3]


def test_rows_of_an_older_run_go_into_one_table(tmp_path):
    """A run that is forced on after a column was added keeps its rows, without it."""
    folder = RunFolder(tmp_path, {"task": "t", "material": "m", "method": "x", "seed": 0, "fingerprint": "f"})
    folder.rows = [{"episode": 0, "return": 1.0, "seconds": 1.0, "simulating": 0.5, "diverged": ""}]
    folder.add(Episode({**folder.rows[0], "episode": 1, "needed": 4}, np.zeros((5, 1))), 10)
    lines = (tmp_path / "episodes.csv").read_text().splitlines()
    assert lines == ["episode,return,seconds,simulating,diverged,needed", "0,1.0,1.0,0.5,,", "1,1.0,1.0,0.5,,4"]
