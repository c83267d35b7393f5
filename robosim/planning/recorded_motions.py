"""Recorded motions of sub-tasks, from their files, and in sequence: each translated to the end of the one before.
The files are bundled with the package, or in the user's folder."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from mpm.array_files import read_arrays
from robosim.base.errors import ConfigError
from robosim.base.resources import trained
from robosim.config.rehearsal import RehearsalConfig
from robosim.tasks.actions import ActionScaling, move_pose
from robosim.tasks.task import TaskConfig, load_task

SAMPLING = 0.002
"""Time [s] between poses."""


class PoseSequence(NamedTuple):
    """World poses of the tool's frame, SAMPLING apart."""

    positions: np.ndarray
    """(n, 3) [m]"""
    quaternions: np.ndarray
    """(n, 4), (w, x, y, z)"""


class SubTaskMotion(NamedTuple):
    """The motion of one sub-task in a rehearsal."""

    name: str
    task: TaskConfig
    poses: PoseSequence
    """Where the rehearsal carries it out."""
    offset: np.ndarray
    """Translation (3,) [m] from where it was recorded."""


def load_sequence(config: RehearsalConfig) -> list[SubTaskMotion]:
    """Load the motions of a rehearsal's sub-tasks.
    The first begins at the rehearsal's material, each other where the one before ends, at its own height. Raises
    ConfigError for a motion that is missing or does not fit the rehearsal."""
    sequence: list[SubTaskMotion] = []
    for name in config.recorded:
        task = load_task(name)
        if task.tool != config.tool:
            raise ConfigError(f"recorded: {name} moves a {task.tool_name}; the rehearsal's tool is {config.tool_name}")
        motion = load_motion(find_motion(config, name), name, task)
        if sequence:
            offset = (sequence[-1].poses.positions[-1] - motion.positions[0]) * [1, 1, 0]
        else:
            offset = _compute_first_offset(config, name, task)
        poses = PoseSequence(motion.positions + offset, motion.quaternions)
        sequence.append(SubTaskMotion(name, task, poses, offset))
    return sequence


def place_target(config: RehearsalConfig) -> RehearsalConfig:
    """Move the target of a rehearsal to where its last recorded motion delivers.
    The target is a container or an area. The rehearsal of a script is returned unchanged. Raises ConfigError as
    `load_sequence` does."""
    if config.trajectory == "script":
        return config
    last = load_sequence(config)[-1]
    x, y, _ = map(float, np.array(last.task.target.centre) + last.offset)
    containers = {name: box.model_copy(update={"position": (x, y, box.position[2])}) if name in config.sinks else box
                  for name, box in config.containers.items()}
    area = config.area and config.area.model_copy(update={"centre": (x, y, config.area.centre[2])})
    return config.model_copy(update={"containers": containers, "area": area})


def _compute_first_offset(config: RehearsalConfig, name: str, task: TaskConfig) -> np.ndarray:
    """Translation (3,) [m] from where the first motion was recorded to where the rehearsal's material is."""
    if task.container is not None:
        own, recorded = config.containers.get(task.container), task.containers[task.container]
        if own is None or task.container not in config.sources or own.yaw_deg != recorded.yaw_deg:
            raise ConfigError(f"recorded: {name} was recorded over a filled container {task.container!r} with yaw_deg "
                              f"{recorded.yaw_deg:g}; accepted: one like it in containers")
        return np.array(own.position) - np.array(recorded.position)
    if task.pile is not None:
        if config.pile is None:
            raise ConfigError(f"recorded: {name} was recorded on a pile; accepted: a `pile` on the table")
        return (np.array(config.pile.centre) - np.array(task.pile.centre)) * [1, 1, 0]
    if config.tool_fill_height is None:
        raise ConfigError(f"recorded: {name} begins with a full {task.tool_name}; accepted: a tool_fill_height, or a "
                          f"motion that fills it first")
    return np.zeros(3)


def find_motion(config: RehearsalConfig, name: str) -> Path:
    """Find the file of a sub-task's motion, in the folder `motions` if there is one; raises ConfigError."""
    if config.motions is not None:
        path = Path(config.motions) / f"{name}.npz"
        if not path.is_file():
            raise ConfigError(f"motions {config.motions}: holds no {name}.npz; accepted: a folder with a motion of "
                              f"each of {', '.join(config.recorded)}")
        return path
    path = trained(name)
    if path is None:
        raise ConfigError(f"no bundled motion for {name}; accepted: `robosim train` it, and give a folder with its "
                          f"best.npz as {name}.npz")
    return path


def load_motion(path: Path, name: str, task: TaskConfig) -> PoseSequence:
    """Load a sub-task's motion, from its nominal start to the end of its work; raises ConfigError."""
    poses = _replay_actions(path, name, task)
    replayed = task.step_dt * np.arange(len(poses))
    times = np.arange(0.0, task.step_dt * (len(poses) - 0.5), SAMPLING)
    positions = np.array([p.position for p in poses])
    quaternions = np.array([p.quaternion for p in poses])
    rotations = Slerp(replayed, Rotation.from_quat(quaternions, scalar_first=True))
    return PoseSequence(np.column_stack([np.interp(times, replayed, column) for column in positions.T]),
                        rotations(np.minimum(times, replayed[-1])).as_quat(scalar_first=True))


def _replay_actions(path: Path, name: str, task: TaskConfig) -> list:
    """Tool poses, task.step_dt apart, under a file's actions.
    A pour ends after the actions that it needed; other motions are complete, so that the tool is level at the end."""
    scaling, poses = ActionScaling(task), [task.start.pose]
    try:
        stored = read_arrays(path)
        actions = np.atleast_1d(stored.numbers("actions"))
        repeat = stored.integer("action_repeat", None, 1, task.steps)
        count = -(-task.steps // repeat)
        if "poured" in task.reward:
            count = stored.integer("needed", count, 1, count)
        for action in actions[:count]:
            for _ in range(repeat):
                poses.append(move_pose(poses[-1], task, *scaling.velocities(action)))
        if len(poses) < 2:
            raise ConfigError("holds no action; accepted: one or more")
    except (OSError, ValueError, KeyError) as error:
        raise ConfigError(f"{path}: not a motion of {name}: {str(error).removeprefix(f'{path}: ')}") from None
    return poses
