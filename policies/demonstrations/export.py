"""`robosim export`: demonstrations as transitions in one HDF5 file, in the layout that Minari reads episodes from."""

import json
import os
import sys
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

import mpm
from policies.demonstrations.reading import Shown, acted, actions_in, paths_in, start_in
from policies.learning.environments import made
from policies.learning.files import write
from policies.learning.presets import in_file


def export(task: str, demos: Path, out: Path, *, obs: str = "flat", hold: int = 10) -> int:
    """Act every demonstration out among grains, from the start that it was made from, and keep what is seen; returns 0.

    The file has a group `episode_k` for each, with observations (T + 1, ...), actions (T, n), rewards, terminations and
    truncations (T,), and as attributes id, seed, total_steps and the score; on top total_episodes, total_steps and what
    makes the environment.
    """
    try:
        import h5py
    except ImportError as error:
        raise mpm.InvalidValue('robosim export needs h5py: pip install ".[learn]"') from error

    env = made(task, obs=obs, action_repeat=hold)
    out.parent.mkdir(parents=True, exist_ok=True)
    if out.is_dir() or not os.access(out.parent, os.W_OK):  # before any work
        raise mpm.InvalidValue(f"--out {out}: a folder, or in one that cannot be written; give another file")
    inner: Any = env.unwrapped
    task = inner.TASK
    decisions, dimensions = -(-inner.task.steps // hold), inner.task.action.dimensions
    episodes = []
    for path in tqdm(paths_in(demos), desc="acting out", file=sys.stderr):
        actions = actions_in(path, decisions, hold, dimensions, task)
        seed, start = start_in(path)
        episodes.append((path.name, seed, list(acted(env, actions, start, seed))))
    kwargs = {"obs": obs, "action_repeat": hold}
    if in_file(inner.source):
        spec: dict[str, Any] = {"id": "robosim/Task-v0", "kwargs": {"task": inner.source, **kwargs}}
    else:
        spec = {"id": f"robosim/{task}-v0", "kwargs": kwargs}

    def written(place: Path) -> None:
        with h5py.File(place, "w") as file:
            file.attrs["total_episodes"] = len(episodes)
            file.attrs["total_steps"] = sum(len(shown) for _, _, shown in episodes)
            file.attrs["env_spec"] = json.dumps(spec)
            for k, (name, seed, shown) in enumerate(episodes):
                put(file.create_group(f"episode_{k}"), k, name, seed, shown)

    write(out, written)
    env.close()
    scores = [shown[-1].info["tcs"] for _, _, shown in episodes]
    print(f"{out}: {len(episodes)} episodes, scores {min(scores):.2f} to {max(scores):.2f}")
    return 0


def put(group: Any, k: int, name: str, seed: int, shown: list[Shown]) -> None:
    """One episode into its group."""
    group.attrs.update({"id": k, "seed": seed, "total_steps": len(shown), "demonstration": name,
                        "tcs": shown[-1].info["tcs"], "is_success": bool(shown[-1].info["is_success"])})
    seen = [shown[0].observation, *(step.next_observation for step in shown)]
    if isinstance(seen[0], dict):
        below = group.create_group("observations")
        for key in seen[0]:
            below.create_dataset(key, data=np.stack([one[key] for one in seen]), compression="gzip")
    else:
        group.create_dataset("observations", data=np.stack(seen), compression="gzip")
    group.create_dataset("actions", data=np.stack([step.action for step in shown]))
    group.create_dataset("rewards", data=np.array([step.reward for step in shown]))
    cut = np.array([step.info["TimeLimit.truncated"] for step in shown])
    group.create_dataset("terminations", data=np.array([step.done for step in shown]) & ~cut)
    group.create_dataset("truncations", data=cut)
