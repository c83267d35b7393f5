"""Demonstrations on their way into learning: read, checked, acted out among grains."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple
from zipfile import BadZipFile

import numpy as np

import mpm


class Shown(NamedTuple):
    """A transition of a demonstration."""

    observation: Any
    next_observation: Any
    action: np.ndarray
    reward: float
    done: bool
    info: dict[str, Any]


def read(folder: Path, decisions: int, hold: int, dimensions: int, task: str = "") -> dict[str, np.ndarray]:
    """Actions (decisions, dimensions) of every demonstration_*.npz of a folder, or of one file, by name; raises
    mpm.InvalidValue for none, or for one that does not belong to the task."""
    return {path.name: actions_in(path, decisions, hold, dimensions, task) for path in paths_in(folder)}


def paths_in(folder: Path) -> list[Path]:
    """Every finished demonstration_*.npz of a folder, or the one file; raises mpm.InvalidValue for none."""
    paths = sorted(folder.glob("demonstration_*.npz")) if folder.is_dir() else [folder]
    paths = [path for path in paths if ".unfinished" not in path.name]
    if not paths or not all(path.is_file() for path in paths):
        raise mpm.InvalidValue(f"--demos {folder}: no demonstration_*.npz in it; `robosim demo TASK --out {folder}` "
                               f"makes them")
    return paths


def start_in(path: Path) -> tuple[int, dict[str, bool]]:
    """Seed and options of the reset that a demonstration begins with: the task's own start, where its file does not
    say."""
    with np.load(path, allow_pickle=False) as stored:
        seed = int(stored.get("start", stored.get("seed", 0)))
        return seed, {"nominal": bool(stored.get("nominal", True))}


def actions_in(path: Path, decisions: int, hold: int, dimensions: int, task: str = "") -> np.ndarray:
    """Actions of one file, for decisions of `hold` steps."""
    try:
        with np.load(path, allow_pickle=False) as stored:
            actions = np.asarray(stored["actions"], np.float32)
            held = int(stored["hold"]) if "hold" in stored else hold
            made_for = str(stored["task"]) if "task" in stored else task
    except (OSError, ValueError, KeyError, EOFError, BadZipFile) as error:
        raise mpm.InvalidValue(f"{path}: not a .npz file with an array `actions`: {error}") from error
    if task and made_for != task:
        raise mpm.InvalidValue(f"{path}: made for {made_for}; accepted: one for {task}")
    if held % hold:
        raise mpm.InvalidValue(f"{path}: its actions are held for {held} steps; accepted: a multiple of {hold}")
    if actions.ndim != 2 or actions.shape[1] != dimensions or not np.all(np.abs(actions) <= 1.0):
        raise mpm.InvalidValue(f"{path}: actions have shape {actions.shape}; accepted: (n, {dimensions}), from -1 to "
                               f"1, as this task has them")
    actions = np.repeat(actions, held // hold, axis=0)
    if len(actions) < decisions:
        raise mpm.InvalidValue(f"{path}: {len(actions)} actions of {hold} steps; accepted: {decisions}, as this task "
                               f"has them")
    return actions[:decisions]


def acted(env: Any, actions: np.ndarray, options: dict[str, Any] | None, seed: int) -> Iterator[Shown]:
    """What an environment answers to a demonstration, from its start to its end."""
    observation, _ = env.reset(seed=seed, options=options)
    for action in actions:
        following, reward, terminated, truncated, info = env.step(action)
        info["TimeLimit.truncated"] = truncated and not terminated
        yield Shown(observation, following, action, float(reward), terminated or truncated, info)
        if terminated or truncated:
            return
        observation = following


def guide(model: Any, shown: Iterator[Shown], updates: int) -> int:
    """Put transitions into the demonstrations of a model's buffer, with so many updates after each (Algorithm 3, lines
    2 to 11); returns how many there were."""
    count = 0
    for step in shown:
        with model.replay_buffer.demonstrating():
            arrays = (model.policy.scale_action(step.action[None]), np.array([step.reward], np.float32),
                      np.array([step.done]))
            model.replay_buffer.add(batched(step.observation), batched(step.next_observation), *arrays, [step.info])
        if updates:
            model.train(updates, model.batch_size)
        count += 1
    return count


def batched(observation: Any) -> Any:
    """An observation with a leading index."""
    if isinstance(observation, dict):
        return {key: np.asarray(value)[None] for key, value in observation.items()}
    return np.asarray(observation)[None]
