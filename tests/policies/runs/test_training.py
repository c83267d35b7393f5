"""Training runs: resuming, inputs that do not fit, seeds of episodes."""


import numpy as np
import pytest
import torch

import mpm
from policies.demonstrations.reading import read_demonstrations
from policies.learning.options import TrainingOptions
from policies.learning.presets import Actor, Preset, load_preset
from policies.methods.train import train
from policies.runs.training import Training
from robosim.base.errors import ConfigError

SMALL = {"learning_rate": 1e-3, "batch_size": 32, "learning_starts": 0, "policy_kwargs": {"net_arch": [32, 32]}}
"""Options of a learner that is quick."""


def make_preset(**changes) -> Preset:
    return load_preset("sac").model_copy(update={"episodes": 4, "options": SMALL, **changes})


@pytest.mark.parametrize(("learner", "decay", "actor"), [
    pytest.param("SAC", 1.0, None, marks=pytest.mark.slow), pytest.param("SAC", 0.1, None, marks=pytest.mark.slow),
    pytest.param("SAC", 1.0, Actor(imitation=0.1, imitation_growth=10), marks=pytest.mark.slow),
    ("PPO", 1.0, None)])
def test_an_interrupted_run_continues_to_the_same_bits(tmp_path, learner, decay, actor):
    """Interrupted after three of four episodes, with a checkpoint after two; continued with other random states.
    A learning rate that falls is at the same place of its fall, and an actor imitates the same episode."""
    options = SMALL if learner == "SAC" else {"n_steps": 200, "batch_size": 50, "learning_rate": 1e-3}
    preset = make_preset(learner=learner, options=options, decay=decay, actor=actor)
    whole, interrupted = (Training("x", preset, "Pendulum-v1", tmp_path / name, TrainingOptions(
        seed=1, checkpoint_every=2)) for name in ("whole", "interrupted"))
    whole.learn()
    report = interrupted.env.on_end

    def interrupt(episode) -> None:
        report(episode)
        if interrupted.env.count == 3:
            raise KeyboardInterrupt

    interrupted.env.on_end = interrupt
    with pytest.raises(KeyboardInterrupt):
        interrupted.learn()
    interrupted.folder.close()
    np.random.seed(99)  # noqa: NPY002  (the process that continues has another state)
    torch.manual_seed(99)
    again = Training("x", preset, "Pendulum-v1", tmp_path / "interrupted", TrainingOptions(seed=1, checkpoint_every=2))
    again.learn()
    assert again.env.count == whole.env.count == 4
    weights = [run.model.policy.parameters() for run in (again, whole)]
    assert all(torch.equal(*pair) for pair in zip(*weights, strict=True))
    keys = ("episode", "return", "decisions")
    assert [[row[key] for key in keys] for row in again.folder.rows] == [
        [row[key] for key in keys] for row in whole.folder.rows]


def test_arguments_that_do_not_fit_are_refused(tmp_path):
    np.savez(tmp_path / "demonstration_0.npz", actions=np.zeros((100, 6)))
    for method, task, demos, error, message in (
            ("dgsac", "Pendulum-v1", None, ConfigError, "valid: bc, dagger"),
            ("sac", "NoSuchTask", None, ConfigError, "NoSuchTask"),
            ("dg_sac", "Pendulum-v1", None, mpm.InvalidValue, "--demos"),
            ("dg_sac", "Pendulum-v1", tmp_path, mpm.InvalidValue, r"shape \(100, 6\)"),
            ("sac", "Pendulum-v1", tmp_path, mpm.InvalidValue, "takes no demonstrations")):
        with pytest.raises(error, match=message):
            train(method, task, tmp_path / "run", TrainingOptions(demos=demos))
    np.savez(tmp_path / "demonstration_0.npz", actions=np.zeros((10, 3)))
    with pytest.raises(mpm.InvalidValue, match="10 actions"):
        read_demonstrations(tmp_path, 100, 10, 3)
    assert not (tmp_path / "run").exists()


def test_demonstrations_of_another_task_or_start_are_refused(tmp_path):
    """A demonstration names its task; one that is replayed or corrected must begin where episodes do."""
    file = tmp_path / "demonstration_0.npz"
    np.savez(file, actions=np.zeros((100, 3)), task=np.array("SpoonTranslate"), seed=np.array(7),
             nominal=np.array(False))
    (read,) = read_demonstrations(tmp_path, 100, 10, 3)
    assert (read.seed, read.options) == (7, {"nominal": False})
    with pytest.raises(mpm.InvalidValue, match="made for SpoonTranslate; accepted: one for SpoonPour"):
        read_demonstrations(tmp_path, 100, 10, 3, "SpoonPour")
    with pytest.raises(mpm.InvalidValue, match="demonstration_0.npz: made for another start"):
        train("residual", "SpoonTranslate", tmp_path / "run", TrainingOptions(demos=tmp_path))
    assert not (tmp_path / "run").exists()
    np.savez(tmp_path / "demonstration_1.npz", actions=np.zeros((100, 3)), seed=np.array(8), nominal=np.array(True),
             task=np.array("SpoonTranslate"))
    again = Training("demo", load_preset("demo"), "robosim/SpoonTranslate-v0", tmp_path / "run",
                     TrainingOptions(demos=tmp_path))
    assert [one.name for one in again.demonstrations] == ["demonstration_1.npz"]  # begins where episodes do
    assert again.folder.manifest["task"] == "SpoonTranslate"
    again.folder.close()
    (tmp_path / "demonstration_1.npz").unlink()
    np.savez(file, actions=np.zeros((100, 3)))
    (read,) = read_demonstrations(tmp_path, 100, 10, 3, "SpoonPour")
    assert (read.name, read.seed, read.options) == (file.name, 0, {"nominal": True})


@pytest.mark.parametrize(("method", "obs"), [("bc", "dict"), ("gail", "dict"), ("pointnet_sac", "positions"),
                                             ("pointnet_sac", "moments")])
def test_layouts_that_a_method_cannot_observe_are_refused(tmp_path, method, obs):
    with pytest.raises(mpm.InvalidValue, match=f"obs {obs}; accepted"):
        train(method, "SpoonTranslate", tmp_path / "run", TrainingOptions(), obs=obs)
