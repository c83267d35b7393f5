"""`robosim export`: demonstrations as transitions in one HDF5 file, in the layout of Minari's datasets."""

import json
import os
import sys
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from tqdm import tqdm

import mpm
from policies.demonstrations.reading import demonstration_paths, read_actions, read_start
from policies.learning.bundled import is_task_file
from policies.learning.environments import Transition, make_environment, run_episode
from policies.learning.files import write


def export(task: str, demos: Path, out: Path, *, obs: str = "flat", action_repeat: int = 10) -> int:
    """Play every demonstration among grains, from its own start, and write its transitions to an HDF5 file; return 0.

    The file is main_data.hdf5 of a Minari dataset (https://minari.farama.org/content/dataset_standards); Minari also
    reads the spaces from a metadata.json next to it, which is not written. Layout: a group `episode_k` for each, with
    observations (T + 1, ...), actions (T, n), rewards, terminations and truncations (T,), and attributes id, seed,
    total_steps, demonstration and score; on top the attributes total_episodes, total_steps and env_spec.

    Raises:
        mpm.InvalidValue: h5py is not installed, or a path or demonstration is wrong.
    """
    try:
        import h5py
    except ImportError as error:
        raise mpm.InvalidValue('robosim export needs h5py: pip install ".[learn]"') from error

    env = make_environment(task, obs=obs, action_repeat=action_repeat)
    out.parent.mkdir(parents=True, exist_ok=True)
    if out.is_dir() or not os.access(out.parent, os.W_OK):  # before any work
        raise mpm.InvalidValue(f"--out {out}: a folder, or in one that cannot be written; give another file")
    episodes = play_demonstrations(env, demos, action_repeat)
    spec = env_spec(env.unwrapped, {"obs": obs, "action_repeat": action_repeat})

    def write_episodes(path: Path) -> None:
        with h5py.File(path, "w") as file:
            file.attrs["total_episodes"] = len(episodes)
            file.attrs["total_steps"] = sum(len(episode.transitions) for episode in episodes)
            file.attrs["env_spec"] = json.dumps(spec)
            for k, episode in enumerate(episodes):
                write_episode(file.create_group(f"episode_{k}"), k, episode)

    write(out, write_episodes)
    env.close()
    scores = [episode.transitions[-1].info["tcs"] for episode in episodes]
    print(f"{out}: {len(episodes)} episodes, scores {min(scores):.2f} to {max(scores):.2f}")
    return 0


class PlayedDemonstration(NamedTuple):
    """A demonstration and its transitions."""

    name: str
    """Of its file."""
    seed: int
    transitions: list[Transition]


def play_demonstrations(env: gymnasium.Env, demos: Path, action_repeat: int) -> list[PlayedDemonstration]:
    """Play the demonstrations of a folder, or of one file, in an environment."""
    inner: Any = env.unwrapped
    decisions, dimensions = -(-inner.task.steps // action_repeat), inner.task.action.dimensions
    episodes = []
    for path in tqdm(demonstration_paths(demos), desc="playing", file=sys.stderr):
        actions = read_actions(path, decisions, action_repeat, dimensions, inner.TASK)
        seed, options = read_start(path)
        episodes.append(PlayedDemonstration(path.name, seed, list(run_episode(env, actions, seed=seed,
                                                                              options=options))))
    return episodes


def env_spec(env: Any, options: dict[str, Any]) -> dict[str, Any]:
    """Return id and keyword arguments with which `gymnasium.make` makes a sub-task's environment."""
    if is_task_file(env.source):
        return {"id": "robosim/Task-v0", "kwargs": {"task": env.source, **options}}
    return {"id": f"robosim/{env.TASK}-v0", "kwargs": options}


def write_episode(group: Any, k: int, episode: PlayedDemonstration) -> None:
    """Write one episode into its group of an HDF5 file."""
    steps = episode.transitions
    group.attrs.update({"id": k, "seed": episode.seed, "total_steps": len(steps), "demonstration": episode.name,
                        "tcs": steps[-1].info["tcs"], "is_success": bool(steps[-1].info["is_success"])})
    observations = [steps[0].observation, *(step.next_observation for step in steps)]
    if isinstance(observations[0], dict):
        parts = group.create_group("observations")
        for key in observations[0]:
            parts.create_dataset(key, data=np.stack([one[key] for one in observations]), compression="gzip")
    else:
        group.create_dataset("observations", data=np.stack(observations), compression="gzip")
    group.create_dataset("actions", data=np.stack([step.action for step in steps]))
    group.create_dataset("rewards", data=np.array([step.reward for step in steps]))
    truncated = np.array([step.info["TimeLimit.truncated"] for step in steps])
    group.create_dataset("terminations", data=np.array([step.done for step in steps]) & ~truncated)
    group.create_dataset("truncations", data=truncated)
