"""Reading demonstrations: their files, actions and starts, checked against the task and the method."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

import mpm
from mpm.array_files import read_arrays
from policies.learning.presets import SEARCH, Preset
from robosim.episode.play import Transition
from robosim.studies.policies.make import MAX_REPEAT

MAX_SEED = 2**63 - 1
"""Largest seed: files hold them as 64-bit integers."""


class Demonstration(NamedTuple):
    """A motion, with the seed and the options of the reset that it begins with."""

    name: str
    """Of its file."""
    actions: np.ndarray
    """(decisions, dimensions)"""
    seed: int
    options: dict[str, bool]


class PlayedDemonstration(NamedTuple):
    """A demonstration and its transitions."""

    name: str
    """Of its file."""
    seed: int
    transitions: list[Transition]
    pictures: np.ndarray | None = None
    """Before each action (decisions, height, width, 3), RGB; None where none were drawn."""


def read_demonstrations(folder: Path, decisions: int, action_repeat: int, dimensions: int,
                        task: str = "") -> list[Demonstration]:
    """Read every demonstration of a folder, or of one file; raises mpm.InvalidValue for none, or one that does not fit.
    """
    return [Demonstration(path.name, read_actions(path, decisions, action_repeat, dimensions, task), *read_start(path))
            for path in demonstration_paths(folder)]


def demonstration_paths(folder: Path) -> list[Path]:
    """Return every finished demonstration_*.npz of a folder, or the one file; raises mpm.InvalidValue for none."""
    paths = sorted(folder.glob("demonstration_*.npz")) if folder.is_dir() else [folder]
    paths = [path for path in paths if ".unfinished" not in path.name]
    if not paths or not all(path.is_file() for path in paths):
        raise mpm.InvalidValue(f"--demos {folder}: no demonstration_*.npz in it; `robosim demo TASK --out {folder}` "
                               f"makes them")
    return paths


def read_start(path: Path) -> tuple[int, dict[str, bool]]:
    """Return seed and options of the reset that a demonstration begins with.
    Files without a start begin at the task's own. Raises mpm.InvalidValue for a file that cannot be read."""
    stored = read_arrays(path, names=["start", "seed", "nominal"])
    seed = stored.integer("start" if "start" in stored else "seed", 0, 0, MAX_SEED)
    return seed, {"nominal": bool(stored.integer("nominal", 1, 0, 1))}


def read_actions(path: Path, decisions: int, action_repeat: int, dimensions: int, task: str = "") -> np.ndarray:
    """Return the actions (decisions, dimensions) of one file, repeated where its own action_repeat is longer.
    Raises mpm.InvalidValue for a file that is no motion, or does not fit the task."""
    try:
        stored = read_arrays(path)
        actions = stored["actions"]
        stored_repeat = stored.integer("action_repeat", action_repeat, 1, MAX_REPEAT)
        stored_task = stored.text("task", task)
    except (OSError, ValueError, KeyError) as error:
        raise mpm.InvalidValue(f"{path}: not a .npz file with an array `actions`: {error}") from error
    if task and stored_task != task:
        raise mpm.InvalidValue(f"{path}: made for {stored_task}; accepted: one for {task}")
    if stored_repeat % action_repeat:
        raise mpm.InvalidValue(f"{path}: action_repeat {stored_repeat}; accepted: a multiple of {action_repeat}")
    if actions.ndim != 2 or actions.shape[1] != dimensions or actions.dtype.kind not in "iuf" \
            or not np.all((actions >= -1.0) & (actions <= 1.0)):
        raise mpm.InvalidValue(f"{path}: actions have shape {actions.shape}; accepted: (n, {dimensions}), from -1 to "
                               f"1, as this task has them")
    repeat = stored_repeat // action_repeat
    actions = np.repeat(actions[:-(-decisions // repeat)].astype(np.float32), repeat, axis=0)
    if len(actions) < decisions:
        raise mpm.InvalidValue(f"{path}: {len(actions)} actions with action_repeat {action_repeat}; accepted: "
                               f"{decisions}, as this task has them")
    return actions[:decisions]


def load_demonstrations(preset: Preset, folder: Path | None, decisions: int, action_repeat: int, dimensions: int,
                        task: str) -> list[Demonstration]:
    """Load the demonstrations of a folder, or of one file, for a method; none for a method without.
    Raises mpm.InvalidValue where the method needs demonstrations and there are none, or the other way round, or a file
    does not fit the task."""
    if folder is None:
        if preset.needs_demonstrations:
            raise mpm.InvalidValue("this method learns from demonstrations; give their folder as --demos")
        return []
    if not preset.needs_demonstrations and preset.learner not in SEARCH:
        raise mpm.InvalidValue(f"--demos {folder}: this method takes no demonstrations; leave it out")
    return read_demonstrations(folder, decisions, action_repeat, dimensions, task)


def select_replayable(demonstrations: list[Demonstration], preset: Preset, starts: str) -> list[Demonstration]:
    """Return the demonstrations without those that a replay could not begin at the episodes' start.
    A method that plays motions as they are (replay: all; residual: the first) needs those made for its start; raises
    mpm.InvalidValue where none is left."""
    is_replay = preset.learner == "replay"
    played = demonstrations if is_replay else demonstrations[: int(preset.residual is not None)]
    elsewhere = [one.name for one in played if starts == "nominal" and not one.options["nominal"]]
    if elsewhere and len(elsewhere) == len(played):
        raise mpm.InvalidValue(f"--demos: {', '.join(elsewhere)}: made for another start than the task's own, where "
                               f"this method plays it; accepted: the first of `robosim demo --nominal`")
    return [one for one in demonstrations if one.name not in elsewhere] if is_replay else demonstrations
