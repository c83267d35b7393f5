"""Training on several sub-tasks that are simulated together."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import torch
from exact_sums import compare_exactly

import mpm
from policies.learning.environments import make_environment
from policies.learning.options import TrainingOptions
from policies.learning.presets import Actor, Preset, load_preset
from policies.methods.train import train
from policies.runs.episode_batch import EpisodeBatch
from policies.runs.training import Training
from robosim.config.settings import Setting
from robosim.episode.play import play

TASK, REPEAT = "SpoonTranslate", 200  # five decisions an episode
OPTIONS = {"learning_rate": 1e-3, "batch_size": 8, "learning_starts": 0, "policy_kwargs": {"net_arch": [16]}}


def make_preset(method: str = "sac", episodes: int = 6, **changes) -> Preset:
    return load_preset(method).model_copy(update={"episodes": episodes, "obs": "moments", "options": OPTIONS,
                                                  **changes})


def make_training(out, preset: Preset, n: int = 2, **options) -> Training:
    return Training("x", preset, TASK, out,
                    TrainingOptions(seed=4, n_envs=n, action_repeat=REPEAT, checkpoint_every=2, evaluate_every=100,
                                    **options))


@pytest.mark.slow
@pytest.mark.parametrize("starts", ["nominal", "random"])
def test_each_episode_is_that_of_one_environment(tmp_path, starts):
    compare_exactly("test_episode_batch", str(tmp_path), starts)


def compared(folder, starts):
    """Start, return and score of every row, when its actions are played alone from its start; in the order of the run's
    episodes, and as many as were asked for, which three environments do not divide."""
    training = make_training(Path(folder), make_preset(episodes=4), 3, starts=starts)
    recorded = []
    training.env.on_end = recorded.append
    training.learn()
    assert [episode.row["episode"] for episode in recorded] == [0, 1, 2, 3]
    env = make_environment(TASK, obs="moments", action_repeat=REPEAT)
    for episode in recorded:
        total, info = play(env, episode.actions, seed=episode.row["start"],
                           options={"nominal": True} if starts == "nominal" else None)
        assert total == pytest.approx(episode.row["return"], abs=1e-6)
        assert info["tcs"] == pytest.approx(episode.row["tcs"], abs=1e-6)
        assert len(episode.actions) == episode.row["decisions"] == 5
    assert len({episode.row["start"] for episode in recorded}) == 4
    assert len({round(episode.row["return"], 9) for episode in recorded}) > 1


@pytest.mark.slow
@pytest.mark.parametrize("actor", [None, Actor(imitation=0.1)])
def test_an_interrupted_run_of_a_batch_continues_to_the_same_bits(tmp_path, actor):
    """Interrupted after four of six episodes of two environments; continued with other global random states."""
    preset = make_preset(actor=actor)
    whole = make_training(tmp_path / "whole", preset)
    whole.learn()
    interrupted = make_training(tmp_path / "interrupted", preset)
    interrupted.preset = preset.model_copy(update={"episodes": 5})
    interrupted.learn()
    interrupted.folder.close()
    np.random.seed(99)  # noqa: NPY002
    torch.manual_seed(99)
    again = make_training(tmp_path / "interrupted", preset)
    again.learn()
    assert again.env.count == whole.env.count == 6
    weights = [run.model.policy.parameters() for run in (again, whole)]
    assert all(torch.equal(*pair) for pair in zip(*weights, strict=True))
    assert again.model._n_updates == whole.model._n_updates == 28  # two for each pair of decisions, but the last
    times = ("seconds", "simulating", "updating")
    rows = [[{key: value for key, value in row.items() if key not in times} for row in one.folder.rows]
            for one in (whole, again)]
    assert rows[0] == rows[1] and len(rows[0]) == 6


@pytest.mark.long
def test_a_checkpoint_within_episodes_continues_to_the_same_bits(tmp_path):
    """The state of a batch, taken in the middle of its episodes."""
    training = make_training(tmp_path, make_preset(episodes=100))
    batch, rng = training.env, np.random.default_rng(0)
    actions = rng.uniform(-1, 1, (9, 2, 3)).astype(np.float32)
    batch.reset()
    for action in actions[:3]:
        batch.step(action)
    state = batch.state()

    def go_on():
        return [(observations.tobytes(), rewards.tolist(), dones.tolist(), [info.get("tcs") for info in infos])
                for observations, rewards, dones, infos in map(batch.step, actions[3:])]

    expected, ended = go_on(), batch.count
    batch.count = 0
    batch.load(state)
    assert go_on() == expected and batch.count == ended == 2
    with pytest.raises(mpm.InvalidValue, match="checkpoint of 1 environments; accepted: 2"):
        batch.load({**state, "environments": state["environments"][:1]})


@pytest.mark.slow
def test_a_run_with_demonstrations_ends_with_its_times(tmp_path):
    """Four environments, demonstrations in half of each batch; the status says where the time went."""
    np.savez(tmp_path / "demonstration_0.npz", actions=np.zeros((5, 3)), action_repeat=np.array(REPEAT))
    settings = [Setting(("obs",), "moments"), Setting(("options",), OPTIONS)]
    options = TrainingOptions(demos=tmp_path, n_envs=4, action_repeat=REPEAT, evaluate_every=4)
    assert train("dg_sac", TASK, tmp_path / "run", options, episodes=8, settings=settings) == 0
    status = json.loads((tmp_path / "run" / "status.json").read_text())
    assert status["state"] == "finished" and status["episodes"] == 8
    parts = [status[f"{name}_s"] for name in ("simulating", "updating", "evaluating", "rest")]
    assert min(parts[:3]) > 0 and sum(parts) == pytest.approx(status["seconds"])
    rows = list(csv.DictReader((tmp_path / "run" / "episodes.csv").read_text().splitlines()))
    assert [int(row["episode"]) for row in rows] == list(range(8)) and len({row["start"] for row in rows}) == 8
    assert len((tmp_path / "run" / "evaluations.csv").read_text().splitlines()) == 3
    assert json.loads((tmp_path / "run" / "manifest.json").read_text())["n_envs"] == 4


@pytest.mark.parametrize(("task", "preset", "named"), [
    ("Pendulum-v1", make_preset(obs="flat"), "task Pendulum-v1"), (TASK, load_preset("bc"), "learner BC"),
    (TASK, load_preset("residual"), "residual 0.1")])
def test_what_has_no_batch_is_refused(tmp_path, task, preset, named):
    np.savez(tmp_path / "demonstration_0.npz", actions=np.zeros((100, 3)))
    demos = tmp_path if preset.needs_demonstrations else None
    with pytest.raises(mpm.InvalidValue, match=f"--n-envs 2 with .*{named}"):
        Training("x", preset, task, tmp_path / "run", TrainingOptions(n_envs=2, demos=demos))
    assert not (tmp_path / "run").exists()


@pytest.mark.long
def test_environments_of_a_batch_may_end_apart(tmp_path):
    """One that diverges begins the run's next episode at once, while the other goes on; both keep their numbers."""
    training = make_training(tmp_path, make_preset(episodes=10))
    recorded = []
    batch: EpisodeBatch = training.env
    batch.on_end = recorded.append
    batch.reset()
    for k in range(6):
        if k == 2:
            batch.vector.batches[0].episodes[0].diverge(RuntimeError("too fast"))
        batch.step(np.zeros((2, 3), np.float32))
    assert [(episode.row["episode"], episode.row["decisions"]) for episode in recorded] == [(0, 3), (1, 5)]
    assert recorded[0].row["diverged"] == "too fast" and not recorded[1].row["diverged"]
    assert [record.index for record in batch._records] == [2, 3]
