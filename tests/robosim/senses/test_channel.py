"""Terms on their way to a policy, and policies that work on them alone."""

import gymnasium
import numpy as np
import pytest
import torch
from grain_envs import make
from scipy.stats import wilcoxon
from stable_baselines3 import SAC
from stable_baselines3.common.callbacks import EvalCallback
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor

import mpm
import robosim  # noqa: F401  (registers the environments)
from robosim.base.errors import ConfigError
from robosim.envs.episode import NOTHING_COUNTED
from robosim.senses.senses import Channel, Timing
from robosim.senses.term import Sight, Term, box
from robosim.tasks.actions import DelayLine, delay_steps

POSE = mpm.Pose(np.zeros(3), np.array([1.0, 0, 0, 0]))


class Clock(Term):
    name, unit = "clock", "s"
    space = box([0.0], [100.0])

    def measure(self, sight, memory, rng):
        return np.array([sight.time])


def sight(time: float) -> Sight:
    return Sight(time, 0.0, POSE, NOTHING_COUNTED, np.zeros((0, 6), np.float32), np.zeros(6), 0.0)


def read(timing: Timing, times: np.ndarray, seed: int = 0) -> np.ndarray:
    channel, rng = Channel(Clock(), timing), np.random.default_rng(seed)
    memory = channel.begin(sight(times[0]))
    return np.array([channel.read(sight(t), memory, rng)[0] for t in times])


TIMES = 0.02 * np.arange(200)


def test_ideal_channel_changes_nothing():
    np.testing.assert_allclose(read(Timing(), TIMES), TIMES, rtol=1e-6)


@pytest.mark.parametrize("latency", [0.02, 0.05, 0.3])
def test_latency_delivers_what_was_measured_that_long_ago(latency: float):
    age = TIMES - read(Timing(latency=latency), TIMES)
    late = latency + 0.02 < TIMES
    assert (age[late] > latency - 1e-6).all() and (age[late] < latency + 0.02 + 1e-6).all()
    assert (read(Timing(latency=latency), TIMES)[latency - 1e-9 > TIMES] == 0.0).all()


def test_rate_holds_values_and_keeps_its_mean_rate():
    shown = read(Timing(rate=15.0), TIMES)
    assert len(np.unique(shown)) == pytest.approx(15.0 * TIMES[-1], abs=2)
    assert (TIMES - shown < 1.0 / 15.0 + 0.02).all()


def test_noise_and_dropout_have_their_size():
    error = read(Timing(noise=0.01), TIMES + 50.0) - TIMES - 50.0
    assert error.std() == pytest.approx(0.01, rel=0.2) and abs(error.mean()) < 0.003
    repeated = np.mean(np.diff(read(Timing(dropout=0.3), TIMES)) == 0.0)
    assert repeated == pytest.approx(0.3, abs=0.1)


def test_delay_line_shifts_commands_in_time():
    line, commands = DelayLine(7), [(np.full(3, k), np.full(3, -k)) for k in range(1, 6)]
    carried = [float(linear[0]) for velocity in commands for linear, _, n in line.push(velocity, 5) for _ in range(n)]
    assert carried == [0.0] * 7 + [k for k in range(1, 6) for _ in range(5)][:18]


@pytest.mark.parametrize("delay", [-0.1, 0.003, 11.0, float("nan")])
def test_delay_that_is_no_multiple_of_the_step_is_refused(delay: float):
    with pytest.raises(ConfigError, match="a multiple of 0.002 s"):
        delay_steps(delay, 0.002)


def test_delayed_actions_move_the_tool_later_by_their_delay_and_are_pending_until_then():
    actions, paths, ahead = (0.3 * np.random.default_rng(0).uniform(-1, 1, (10, 6))).astype(np.float32), [], []
    for delay in (0.0, 0.06):
        env = make("SpoonPour", obs=["tool", "pending"], action_delay=delay)
        seen = [env.reset(seed=0)[0], *(env.step(action)[0] for action in actions)]
        paths.append(np.array([one["tool"] for one in seen]))
        ahead.append(np.array([one["pending"][:3] for one in seen]) * env.task.action.speed * delay)
        env.close()
    np.testing.assert_allclose(paths[1][3:], paths[0][:8], atol=1e-6)
    np.testing.assert_allclose(ahead[1][:8], paths[1][3:, :3] - paths[1][:8, :3], atol=1e-6)
    assert not ahead[0].any() and ahead[1][1:].any()


class NoMotion:
    def __init__(self, dimensions: int) -> None:
        self._action = np.zeros((1, dimensions), np.float32)

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return self._action, state


def make_environment() -> Monitor:
    terms = ["tool", "wrist", {"name": "height_map", "pixels": (16, 16)}]
    return Monitor(gymnasium.make("robosim/SpoonTranslate-v0", obs=terms))


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::mpm.GrainsLeaveGrid")  # of a policy that has learned nothing yet
@pytest.mark.parametrize("seed", [0, 1])
def test_returns_of_a_sensed_policy_rise_above_no_motion(seed: int, tmp_path):
    """The best policy by trials on the way; the starts that are compared are others."""
    torch.set_num_threads(1)
    env, trial = make_environment(), make_environment()
    model = SAC("MultiInputPolicy", env, learning_rate=3e-4, gamma=0.95, learning_starts=300, seed=seed)
    model.learn(4000, EvalCallback(trial, eval_freq=250, best_model_save_path=str(tmp_path), verbose=0))
    returns = []
    for policy in (SAC.load(tmp_path / "best_model"), NoMotion(env.action_space.shape[0])):
        trial.reset(seed=1_000_000)
        rewards, _ = evaluate_policy(policy, trial, 20, deterministic=True, return_episode_rewards=True)
        returns.append(rewards)
    assert wilcoxon(*returns, alternative="greater").pvalue < 0.01
