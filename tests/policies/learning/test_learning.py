"""Learning: the buffer, methods, and policies as files."""

import copy
import json
import pickle

import gymnasium
import numpy as np
import pytest

torch = pytest.importorskip("torch")
from sb3_contrib import TQC, CrossQ  # noqa: E402
from stable_baselines3 import DDPG, SAC, TD3  # noqa: E402

from policies.demonstrations.reading import acted, guide  # noqa: E402
from policies.learning.buffers import DemoReplayBuffer  # noqa: E402
from policies.learning.bundled import bundled_names  # noqa: E402
from policies.learning.network import export  # noqa: E402
from policies.learning.presets import load_preset  # noqa: E402
from policies.methods.train import train  # noqa: E402
from policies.runs.training import Training  # noqa: E402
from robosim.evaluation.policies import NetworkPolicy  # noqa: E402

torch.set_num_threads(1)
SMALL = {"learning_rate": 1e-3, "batch_size": 32, "learning_starts": 0, "policy_kwargs": {"net_arch": [32, 32]}}


def weights(model) -> np.ndarray:
    """All parameters of a model's policy."""
    return np.concatenate([p.detach().numpy().ravel() for p in model.policy.parameters()])


def make(kind, **options):
    return kind("MlpPolicy", gymnasium.make("Pendulum-v1"), seed=3, device="cpu", **copy.deepcopy(SMALL), **options)


@pytest.mark.parametrize("kind, steps", [(SAC, 200), *(pytest.param(kind, 2000, marks=pytest.mark.slow)
                                                       for kind in (SAC, TD3, DDPG, TQC, CrossQ))])
def test_without_demonstrations_it_is_the_method_itself(kind, steps):
    """The same parameters after as many updates as steps."""
    models = [make(kind, **options).learn(steps) for options in ({}, {"replay_buffer_class": DemoReplayBuffer})]
    assert models[0]._n_updates >= steps - 10
    assert np.abs(weights(models[0]) - weights(models[1])).max() < 1e-6


def filled(fraction: float, demos: int, own: int) -> DemoReplayBuffer:
    """A buffer whose rewards tell who added: 1 a demonstration, 0 the agent."""
    space = gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32)
    buffer = DemoReplayBuffer(500, space, space, demo_size=100, demo_fraction=fraction)
    for k in range(demos + own):
        row = np.full((1, 2), k / 1000.0, np.float32)
        told = (row, row, row, np.array([float(k < demos)]), np.array([False]), [{}])
        if k < demos:
            with buffer.demonstrating():
                buffer.add(*told)
        else:
            buffer.add(*told)
    return buffer


@pytest.mark.parametrize("fraction, demos, own, expected", [
    (0.5, 10, 20, 0.5), (0.25, 10, 20, 0.25), (0.0, 10, 20, 0.0), (1.0, 10, 20, 1.0), (0.5, 0, 20, 0.0),
    (0.5, 10, 0, 1.0), (0.0, 10, 0, 1.0)])
def test_batches_hold_the_share_of_demonstrations(fraction, demos, own, expected):
    """And all of one side while the other is empty; a buffer that was stored and loaded draws the same batches."""
    buffer = filled(fraction, demos, own)
    np.random.seed(0)  # noqa: NPY002
    batch = buffer.sample(64)
    assert float(batch.rewards.mean()) == expected
    assert batch.observations.shape == (64, 2)
    kept = pickle.dumps(buffer)
    assert len(kept) < 20_000  # not the room that was allocated
    again = pickle.loads(kept)
    np.random.seed(0)  # noqa: NPY002
    assert torch.equal(again.sample(64).observations, batch.observations)
    again.add(*[np.zeros((1, 2), np.float32)] * 3, np.zeros(1), np.zeros(1), [{}])
    assert again.size() == buffer.size() + 1


@pytest.mark.parametrize("kind", [SAC, TD3])
def test_a_policy_as_a_file_acts_as_it_does(tmp_path, kind):
    """To single precision, with observations scaled before the network and in the file's first layer."""
    model = make(kind)
    rng = np.random.default_rng(0)
    offset, factor = rng.standard_normal(3), rng.uniform(0.5, 2.0, 3)
    assert export(model.policy, tmp_path / "p.npz", (offset, factor))
    stored = dict(np.load(tmp_path / "p.npz"))
    for _ in range(20):
        seen = rng.standard_normal(3)
        x = seen
        for k, name in enumerate(stored["activations"]):
            x = NetworkPolicy.FUNCTIONS[str(name)](stored[f"weight_{k}"] @ x + stored[f"bias_{k}"])
        x = np.tanh(x) if stored["bound"] == "tanh" else np.clip(x, -1.0, 1.0)
        wanted, _ = model.predict(((seen - offset) * factor).astype(np.float32), deterministic=True)
        assert 2.0 * x == pytest.approx(wanted, abs=1e-4)  # the pendulum's torque is -2 to 2


def test_dictionaries_are_kept_too():
    """A space of several parts, with the demonstrations' share."""
    Box = gymnasium.spaces.Box
    space = gymnasium.spaces.Dict({"a": Box(-1.0, 1.0, (2, 3)), "b": Box(-1.0, 1.0, (1,))})
    buffer = DemoReplayBuffer(20, space, Box(-1.0, 1.0, (2,)), demo_size=20)
    one = {key: np.ones((1, *part.shape), np.float32) for key, part in space.items()}
    for k in range(4):
        told = (one, one, np.ones((1, 2)), np.array([float(k % 2)]), np.array([False]), [{}])
        if k % 2:
            with buffer.demonstrating():
                buffer.add(*told)
        else:
            buffer.add(*told)
    batch = pickle.loads(pickle.dumps(buffer)).sample(10)
    assert batch.observations["a"].shape == (10, 2, 3) and float(batch.rewards.mean()) == 0.5


def test_demonstrations_enter_with_updates():
    """Algorithm 3, lines 2 to 11: every transition is kept, scaled, and learnt from."""
    model = make(SAC, replay_buffer_class=DemoReplayBuffer)
    model.learn(0)
    actions = np.full((50, 1), 0.5, np.float32)
    before = weights(model)
    assert guide(model, acted(gymnasium.make("Pendulum-v1"), actions, None, 0), 1) == 50
    assert model.replay_buffer.demo.size() == 50 and model.replay_buffer.own.size() == 0
    assert model._n_updates == 50 and np.abs(weights(model) - before).max() > 1e-4
    assert np.allclose(model.replay_buffer.demo.actions[:50], 0.25)  # torque 0.5 of 2


@pytest.mark.parametrize("name", bundled_names("training"))
def test_every_method_of_the_folder_is_whole(name):
    """Its file is valid, and its learner's class knows its options."""
    chosen = load_preset(name)
    assert chosen.description and chosen.episodes > 0
    if chosen.learner in ("SAC", "TD3", "DDPG", "PPO", "GAIL") and chosen.encoder is None:
        from policies.learning.learner import build

        assert build(chosen, gymnasium.make("Pendulum-v1"), 0).policy is not None


@pytest.mark.slow
def test_soft_actor_critic_learns_the_pendulum(tmp_path):
    """20 000 steps at a rate of 1e-3: the mean of 100 episodes lies within -200 and -120."""
    chosen = load_preset("sac").model_copy(update={"episodes": 100})
    chosen = chosen.model_copy(update={"options": {**chosen.options, "learning_rate": 1e-3, "batch_size": 256}})
    training = Training("sac", chosen, "Pendulum-v1", tmp_path, seed=0)
    training.learn()
    env, totals = gymnasium.make("Pendulum-v1"), []
    for k in range(100):
        seen, over, total = env.reset(seed=1000 + k)[0], False, 0.0
        while not over:
            seen, reward, terminated, truncated, _ = env.step(training.model.predict(seen, deterministic=True)[0])
            total, over = total + float(reward), terminated or truncated
        totals.append(total)
    assert -200 < np.mean(totals) < -120


@pytest.mark.slow
@pytest.mark.parametrize("method", [name for name in bundled_names("training") if load_preset(name).graph is None])
def test_every_method_runs_on_grains(tmp_path, method):
    """A few episodes; the best actions, replayed, give the return that was trained with; the policy's file acts."""
    rng = np.random.default_rng(0)
    np.savez(tmp_path / "demonstration_0.npz", actions=rng.uniform(-0.3, 0.3, (50, 3)), hold=20)
    takes = load_preset(method).shown
    out = tmp_path / "run"
    episodes = 10 if method == "cmaes" else 3  # a generation
    assert train(method, "SpoonTranslate", out, demos=tmp_path if takes else None, episodes=episodes, hold=20) == 0
    status = json.loads((out / "status.json").read_text())
    assert status["state"] == "finished" and status["episodes"] >= 1
    assert status["replayed"]["return"] == pytest.approx(status["best_return"], abs=1e-9)
    if (out / "best_policy.npz").is_file():
        from robosim.evaluation.policies import make_policy, training_options

        stored = dict(np.load(out / "best_policy.npz"))
        options = training_options(str(out / "best_policy.npz"))
        env = gymnasium.make("robosim:robosim/SpoonTranslate-v0", **options).unwrapped
        seen = env.reset(seed=0)[0]
        action = make_policy(str(out / "best_policy.npz"), env, 0)()
        assert action.shape == (3,) and np.all(np.abs(action) <= 1.0) and np.abs(action).max() > 0
        assert stored["weight_0"].shape[1] == len(seen)
