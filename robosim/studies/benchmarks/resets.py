"""Cost of a randomized reset against a nominal one, timed in turns, and functions compiled after the first reset."""

import statistics
import time
from typing import Any

import gymnasium
import numpy as np

from mpm.backend import ti
from robosim.envs.grain_env import GrainEnv
from robosim.envs.vector import GrainVectorEnv

SEEDS, TURNS, ENVIRONMENTS = 6, 8, 4
"""Episodes that are repeated, how often, and environments of a vector environment."""


def measure_resets(name: str, kind: str, seeds: int = SEEDS, turns: int = TURNS) -> dict[str, float]:
    """Time resets of a task's environments with randomize="nominal" and "wide": medians [ms] and their ratio.

    kind: "alone"; "arm": with the whole arm; "vector": ENVIRONMENTS that share a field, all reset at once. The same
    seeds are reset once before, untimed, and their starts have settled then. There is a step between two resets. Times
    are those of the processor, as resets wait for nothing and other processes disturb these least. Functions that
    Taichi compiles after the first reset and step of both are counted.
    """
    envs = {preset: _make(name, kind, preset) for preset in ("nominal", "wide")}
    for env in envs.values():
        _begin(env, 0)
    first = compiled_functions()
    times: dict[str, list[float]] = {preset: [] for preset in envs}
    for turn in range(turns + 1):
        for seed in range(seeds):
            for preset, env in envs.items():
                seconds = _begin(env, seed)
                if turn > 0:
                    times[preset].append(seconds)
    compiled = compiled_functions() - first
    for env in envs.values():
        env.close()
    nominal, wide = (1e3 * statistics.median(each) for each in times.values())
    label = f"{name}{'' if kind == 'alone' else f', {kind}'}"
    return {f"{label}: nominal reset [ms]": nominal, f"{label}: wide over nominal reset": wide / nominal,
            f"{label}: functions compiled later": compiled}


def compiled_functions() -> int:
    """Return the number of Taichi functions that this process has compiled or read from the cache so far."""
    runtime = ti.lang.impl.get_runtime()  # pyright: ignore[reportOptionalMemberAccess]
    return int(runtime.get_num_compiled_functions())


def _make(name: str, kind: str, preset: str) -> gymnasium.Env | GrainVectorEnv:
    if kind == "vector":
        return GrainVectorEnv(name, ENVIRONMENTS, workers=1, randomize=preset)
    return GrainEnv(task=name, arm=kind == "arm", randomize=preset)


def _begin(env: Any, seed: int) -> float:
    """Reset to a seed, and take a step afterwards; return the processor's time [s] for the reset."""
    begin = time.process_time()
    env.reset(seed=seed)
    seconds = time.process_time() - begin
    env.step(np.zeros(env.action_space.shape, np.float32))
    return seconds
