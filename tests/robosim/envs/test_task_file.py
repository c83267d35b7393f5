"""A task file works in every command as a sub-task's name does."""

import json
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
import yaml
from bundled import read_bundled

import mpm
from policies.demonstrations.export import export
from policies.learning.environments import make_training_environment
from policies.learning.options import TrainingOptions
from policies.methods.train import train
from policies.runs.sweep_file import load_sweep, plan_runs
from robosim.base.errors import ConfigError, UnknownName
from robosim.base.resources import config_path
from robosim.envs import make
from robosim.studies.evaluation.evaluate import evaluate
from robosim.tasks.task import is_task, load_task

ACTION_REPEAT = 250
ACTION = np.array([0.1, 0.2, -0.1], np.float32)


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def write(name: str, basis: str, **keys: Any) -> str:
    """Write a bundled task with other top keys; return the file's name."""
    Path(name).write_text(yaml.safe_dump(read_bundled("tasks", basis) | keys))
    return name


def written(name: str) -> str:
    """A SpoonTranslate with another friction and a target elsewhere."""
    task = read_bundled("tasks", "SpoonTranslate")
    x, y, z = task["goal"]
    return write(name, "SpoonTranslate", field=task["field"] | {"tool_friction": 0.3}, goal=[x, y - 0.02, z])


@pytest.mark.long
def test_a_task_file_makes_its_environment() -> None:
    """The same numbers as the registered one that is given the file."""
    own = written("mine.yaml")
    with gymnasium.make("robosim/SpoonTranslate-v0", task=own, action_repeat=ACTION_REPEAT) as registered:
        begun, after = registered.reset(seed=3)[0], registered.step(ACTION)
    by_file = make_training_environment(own, "flat", ACTION_REPEAT)
    assert (by_file.unwrapped.TASK, by_file.unwrapped.source) == ("mine", own)
    assert by_file.unwrapped.task.field.tool_friction == 0.3
    assert np.array_equal(by_file.reset(seed=3)[0], begun)
    other = by_file.step(ACTION)
    assert np.array_equal(after[0], other[0]) and after[1] == other[1]


@pytest.mark.long
def test_a_new_sort_of_task_is_a_file() -> None:
    """A push with a term for contact and one for the shovel's turn, which none of the bundled tasks combines."""
    reward = {"contact": 0.001, "turn": {"scale": 2.0, "margin": 1.0, "angle_deg": -20}}
    env = make(write("sweep.yaml", "ShovelMove", reward=read_bundled("tasks", "ShovelMove")["reward"] | reward,
                     success={"delivered": 0.1, "turn_error_deg": 30}), action_repeat=ACTION_REPEAT)
    env.reset(seed=0, options={"nominal": True})
    terms = env.unwrapped.reward.terms  # pyright: ignore[reportAttributeAccessIssue]
    assert list(terms) == ["distance", "lost", "target", "contact", "turn"]
    over, touching, info = False, 0.0, {}
    while not over:
        _, _, over, _, info = env.step(np.array([0.0, 0.5, 0.0], np.float32))
        touching += info["reward_terms"]["contact"]
    assert touching > 0.0
    # the shovel has not turned: its error is the whole of what is asked for
    assert info["tcs_terms"]["turn"] == pytest.approx(2.0 * (1.0 - np.radians(20.0)), abs=1e-6)
    assert not info["is_success"]


@pytest.mark.parametrize(("section", "keys", "message"), [
    ("reward", {"collision": -0.1}, "reward.collision = -0.1 without a container; accepted: 0"),
    ("reward", {"poured": 0.1}, "reward.poured = 0.1, reward.lost = -.*; accepted: one of them"),
    ("success", {"turn_error_deg": 10}, "success.turn_error_deg = 10.0 without reward.turn; accepted: null")])
def test_parts_of_a_task_that_do_not_fit_are_named(section: str, keys: dict, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        load_task(write("mine.yaml", "ShovelMove", **{section: read_bundled("tasks", "ShovelMove")[section] | keys}))


def test_without_a_pile_the_blade_is_full() -> None:
    """As its interior is a place that grains are carried in."""
    assert load_task(write("mine.yaml", "ShovelMove", pile=None)).carried


@pytest.mark.slow
def test_a_vector_environment_of_a_task_file_behaves_as_one() -> None:
    own = written("mine.yaml")
    vector = gymnasium.make_vec("robosim/Task-v0", num_envs=2, workers=1, task=own, action_repeat=ACTION_REPEAT)
    alone, plain = make(own, action_repeat=ACTION_REPEAT), make("SpoonTranslate", action_repeat=ACTION_REPEAT)
    together, _ = vector.reset(seed=3)
    assert np.array_equal(together[0], alone.reset(seed=3)[0])
    plain.reset(seed=3)
    reward = alone.step(ACTION)[1]
    assert vector.step(np.stack([ACTION, ACTION]))[1][0] == reward != plain.step(ACTION)[1]  # the goal is elsewhere
    vector.close()


@pytest.mark.slow
def test_results_have_the_name_of_the_task_file(capsys: pytest.CaptureFixture[str]) -> None:
    """Training, evaluation and export; a sub-task refuses the motion, the file takes any that fits."""
    own, actions = written("mine.yaml"), np.full((4, 3), 0.1, np.float32)
    np.savez("demonstration_0.npz", actions=actions, action_repeat=ACTION_REPEAT, task="mine", seed=0, nominal=True)
    assert train("demo", own, Path("run"), TrainingOptions(demos=Path(), action_repeat=ACTION_REPEAT)) == 0
    assert json.loads(Path("run/manifest.json").read_text())["task"] == "mine"
    assert f"robosim evaluate {own} --policy run/best.npz" in capsys.readouterr().out
    assert evaluate(own, "run/best.npz", None, nominal=True) == 0
    with pytest.raises(ConfigError, match="actions for mine; accepted: for SpoonTranslate"):
        evaluate("SpoonTranslate", "run/best.npz", None)
    np.savez("other.npz", actions=actions, action_repeat=ACTION_REPEAT, task="SpoonTranslate")
    assert evaluate(own, "other.npz", None, nominal=True) == 0
    h5py = pytest.importorskip("h5py")
    assert export(own, Path("demonstration_0.npz"), Path("all.hdf5"), action_repeat=ACTION_REPEAT) == 0
    with h5py.File("all.hdf5") as file:
        spec = json.loads(file.attrs["env_spec"])
    assert gymnasium.make(spec["id"], **spec["kwargs"]).unwrapped.TASK == "mine"


def test_a_sweep_names_folders_after_a_task_file() -> None:
    own = written("mine.yaml")
    Path("sweep.yaml").write_text(f"tasks: [{own}, SpoonPour]\nmethods: [sac]\nseeds: [0]\nout: runs\n")
    runs = plan_runs(load_sweep(Path("sweep.yaml")))
    assert [run.out for run in runs] == [Path("runs/mine/sac/seed_0"), Path("runs/SpoonPour/sac/seed_0")]
    assert runs[0].arguments[:3] == ["train", "sac", own]
    Path("below").mkdir()
    Path("sweep.yaml").write_text(f"tasks: [{own}, {written('below/mine.yaml')}]\nmethods: [sac]\nseeds: [0]\n"
                                  f"out: runs\n")
    with pytest.raises(mpm.InvalidValue, match="share the folder"):
        plan_runs(load_sweep(Path("sweep.yaml")))


def test_task_files_differ_from_rehearsal_files() -> None:
    assert is_task(written("mine.yaml")) and is_task("SpoonPour")
    assert not is_task(str(config_path("rehearsals", "spoon", "rehearsal"))) and not is_task("spoon")


def test_what_is_no_task_is_refused() -> None:
    Path("sweep.yaml").write_text("tasks: [gone.yaml]\nmethods: [sac]\nseeds: [0]\nout: runs\n")
    with pytest.raises(ConfigError, match=r"task gone\.yaml: no such file; accepted: a \.yaml file of your own"):
        plan_runs(load_sweep(Path("sweep.yaml")))
    for name in ("gone.yaml", "SpoonStir"):
        with pytest.raises((ConfigError, UnknownName), match="SpoonPour"):
            evaluate(name, "zero", None)
    with pytest.raises(ConfigError, match=r"task None; accepted: a task's \.yaml file"):
        gymnasium.make("robosim/Task-v0")
