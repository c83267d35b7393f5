"""The motions that were learnt for sub-tasks, each carried off to where the one before has ended."""

from pathlib import Path
from typing import NamedTuple
from zipfile import BadZipFile

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from robosim.config.rehearsal import RehearsalConfig
from robosim.config.resources import trained
from robosim.envs.carrier import Carrier
from robosim.errors import ConfigError
from robosim.rehearsal.pose_sequences import SAMPLING
from robosim.tasks.actions import ActionScaling
from robosim.tasks.task import TaskConfig, load_task


class Motion(NamedTuple):
    """Poses of a tool, SAMPLING apart: positions (n, 3) [m], quaternions (n, 4)."""

    places: np.ndarray
    turns: np.ndarray


class Part(NamedTuple):
    """A sub-task's motion and how far [m] (3,) it was carried off from where it was learnt."""

    name: str
    task: TaskConfig
    motion: Motion
    offset: np.ndarray


def shipped(config: RehearsalConfig, name: str) -> Path:
    """File of a sub-task's motion: of the rehearsal's folder of motions, or the one that ships; raises ConfigError
    where there is none."""
    if config.motions is not None:
        path = Path(config.motions) / f"{name}.npz"
        if not path.is_file():
            raise ConfigError(f"motions {config.motions}: holds no {name}.npz; accepted: a folder with a motion of "
                              f"each of {', '.join(config.learned)}")
        return path
    path = trained(name)
    if path is None:
        raise ConfigError(f"no learnt motion ships for {name}; accepted: `robosim train` it, and give a folder with "
                          f"its best.npz as {name}.npz")
    return path


def motion_of(path: Path, name: str, task: TaskConfig) -> Motion:
    """The motion of a file for a sub-task, from its nominal start to where it has done its work; raises ConfigError for
    a file that is none."""
    scale, carrier = ActionScaling(task), Carrier(task)
    poses = [carrier.restart(task.start.pose)]
    try:
        with np.load(path, allow_pickle=False) as stored:
            # until release 0.1 action_repeat was called hold
            actions = stored["actions"]
            action_repeat = int(stored["action_repeat" if "action_repeat" in stored else "hold"])
            whole = -(-task.steps // action_repeat)
            decisions = int(stored["needed"]) if "needed" in stored and task.kind == "pour" else whole
        for action in actions[:decisions]:
            poses += [carrier.command(*scale.velocities(action)) for _ in range(action_repeat)]
    except (ValueError, KeyError, EOFError, BadZipFile, ConfigError) as error:
        raise ConfigError(f"{path}: not a motion of {name}: {error}") from error
    given, times = task.step_dt * np.arange(len(poses)), np.arange(0.0, task.step_dt * (len(poses) - 0.5), SAMPLING)
    places = np.array([p.position for p in poses])
    turns = Slerp(given, Rotation.from_quat(np.array([p.quaternion for p in poses]), scalar_first=True))
    return Motion(np.column_stack([np.interp(times, given, column) for column in places.T]),
                  turns(np.minimum(times, given[-1])).as_quat(scalar_first=True))


def chain(config: RehearsalConfig) -> list[Part]:
    """The motions of a rehearsal, the first at the rehearsal's own container, each other where the last has ended."""
    parts: list[Part] = []
    for name in config.learned:
        task = load_task(name)
        if task.tool != config.tool:
            raise ConfigError(f"learned: {name} moves a {task.tool}; the rehearsal's tool is {config.tool}")
        motion = motion_of(shipped(config, name), name, task)
        if parts:
            last = parts[-1]
            offset = (last.motion.places[-1] + last.offset - motion.places[0]) * [1, 1, 0]
        else:
            offset = first_offset(config, name, task)
        parts.append(Part(name, task, motion, offset))
    return parts


def first_offset(config: RehearsalConfig, name: str, task: TaskConfig) -> np.ndarray:
    """From where the first motion was learnt to where the rehearsal's material is; raises ConfigError where that is
    not of the motion's kind."""
    if task.container is not None and task.container_place is not None:
        own = config.containers.get(task.container)
        if own is None or task.container != config.source or own.yaw_deg != task.container_place.yaw_deg:
            raise ConfigError(f"learned: {name} was learnt over a filled container {task.container!r} with yaw_deg "
                              f"{task.container_place.yaw_deg:g}; accepted: one like it in containers")
        return np.array(own.position) - np.array(task.container_place.position)
    if task.start.pile is not None:
        if config.pile is None:
            raise ConfigError(f"learned: {name} was learnt on a pile; accepted: a `pile` on the table")
        return (np.array(config.pile.centre) - np.array(task.start.pile.centre)) * [1, 1, 0]
    if config.tool_fill_height is None:
        raise ConfigError(f"learned: {name} begins with a full {task.tool}; accepted: a tool_fill_height, or a motion "
                          f"that fills it first")
    return np.zeros(3)


def placed(config: RehearsalConfig) -> RehearsalConfig:
    """The rehearsal with its empty container, or its area, where the last learnt motion delivers; a script's stays."""
    if config.trajectory == "script":
        return config
    last = chain(config)[-1]
    x, y, _ = map(float, np.array(last.task.target.centre) + last.offset)
    containers = {name: box.model_copy(update={"position": (x, y, box.position[2])}) if name == config.sink else box
                  for name, box in config.containers.items()}
    area = config.area and config.area.model_copy(update={"centre": (x, y, config.area.centre[2])})
    return config.model_copy(update={"containers": containers, "area": area})
