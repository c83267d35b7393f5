"""Environments in the processes that others start: Gymnasium's, Stable-Baselines3's and PyTorch's, forked or not."""

import json
import subprocess
import sys
from typing import Any

import pytest

MAKE = """import json, numpy as np, gymnasium, robosim
ID, OPTIONS = "robosim/SpoonTranslate-v0", {"obs": "moments"}

def make():
    import robosim  # also in a process that has not run this script
    return gymnasium.make(ID, **OPTIONS)

def step(env, shape=()):
    action = np.full((*shape, *env.action_space.shape[-1:]), 0.1, np.float32)
    return env.reset(seed=3)[0], env.step(action)[0]

def print_observations(*observations):
    print(json.dumps([np.asarray(observation).tolist() for observation in observations]))
"""
GYMNASIUM = MAKE + """
vector = gymnasium.make_vec(ID, num_envs=1, vectorization_mode="async", **OPTIONS)
first, second = step(vector, (1,))
vector.close()
print_observations(first[0], second[0], *step(make()))
"""
BASELINES = MAKE + """
import sys
from stable_baselines3.common.vec_env import SubprocVecEnv
alone = step(make())
vector = SubprocVecEnv([make] * 2, start_method=None if sys.argv[1] == "default" else sys.argv[1])
vector.seed(3)
first, second = vector.reset(), vector.step(np.full((2, len(vector.action_space.low)), 0.1, np.float32))[0]
vector.close()
print_observations(first[0], second[0], *alone)
"""
TORCH = MAKE + """
from torch.utils.data import DataLoader, Dataset

env = make()
alone = step(env)

class Rollouts(Dataset):
    def __init__(self, is_parents):
        self.is_parents = is_parents

    def __len__(self):
        return 1

    def __getitem__(self, _):
        return np.stack(step(env if self.is_parents else make()))

((first, second),) = (item[0].numpy() for item in DataLoader(Rollouts(False), num_workers=1))
try:
    list(DataLoader(Rollouts(True), num_workers=1))
except Exception as error:
    assert type(error).__name__ == "BackendError" and 'context="spawn"' in str(error), error
else:
    raise SystemExit("the parent's environment was accepted")
print_observations(first, second, *alone)
"""


def check(script: str, *arguments: str) -> None:
    """Run a script; its first two observations are those of an environment in its own process, the last two."""
    done = subprocess.run([sys.executable, "-c", script, *arguments], capture_output=True, text=True, timeout=900)
    assert done.returncode == 0, done.stderr
    observations: list[Any] = json.loads(done.stdout.splitlines()[-1])
    assert observations[:2] == observations[2:] and observations[0] != observations[1]


@pytest.mark.long
def test_gymnasium_forks_environments() -> None:
    """After it has made one in the process that it forks from."""
    check(GYMNASIUM)


@pytest.mark.slow
@pytest.mark.parametrize("start_method", ["default", "fork"])
def test_stable_baselines_starts_environments(start_method: str) -> None:
    pytest.importorskip("stable_baselines3")
    check(BASELINES, start_method)


@pytest.mark.slow
def test_a_worker_of_a_data_loader_makes_environments() -> None:
    """It cannot use the environment of the process that it was forked from, and says so."""
    pytest.importorskip("torch")
    check(TORCH)
