"""The learned motions of a rehearsal in sequence, each translated to the end of the one before."""

from typing import NamedTuple

import numpy as np

from robosim.base.errors import ConfigError
from robosim.config.rehearsal import RehearsalConfig
from robosim.rehearsal.planning.bundled_motions import find_motion, load_motion
from robosim.rehearsal.planning.pose_sequences import PoseSequence
from robosim.tasks.task import TaskConfig, load_task


class SubTaskMotion(NamedTuple):
    """The motion of one sub-task in a rehearsal."""

    name: str
    task: TaskConfig
    motion: PoseSequence
    """As it was learned."""
    offset: np.ndarray
    """Translation (3,) [m] from where it was learned."""

    @property
    def poses(self) -> PoseSequence:
        """Where the rehearsal carries it out."""
        return PoseSequence(self.motion.positions + self.offset, self.motion.quaternions)


def load_sequence(config: RehearsalConfig) -> list[SubTaskMotion]:
    """Load the motions of a rehearsal's sub-tasks.

    The first begins at the rehearsal's material, each other where the one before ends, at its own height. Raises
    ConfigError for a motion that is missing or does not fit the rehearsal.
    """
    sequence: list[SubTaskMotion] = []
    for name in config.learned:
        task = load_task(name)
        if task.tool != config.tool:
            raise ConfigError(f"learned: {name} moves a {task.tool_name}; the rehearsal's tool is {config.tool_name}")
        motion = load_motion(find_motion(config, name), name, task)
        if sequence:
            last = sequence[-1]
            offset = (last.motion.positions[-1] + last.offset - motion.positions[0]) * [1, 1, 0]
        else:
            offset = _compute_first_offset(config, name, task)
        sequence.append(SubTaskMotion(name, task, motion, offset))
    return sequence


def place_target(config: RehearsalConfig) -> RehearsalConfig:
    """Move the target of a rehearsal to where its last learned motion delivers.

    The target is a container or an area. The rehearsal of a script is returned unchanged. Raises ConfigError as
    `load_sequence` does.
    """
    if config.trajectory == "script":
        return config
    last = load_sequence(config)[-1]
    x, y, _ = map(float, np.array(last.task.target.centre) + last.offset)
    containers = {name: box.model_copy(update={"position": (x, y, box.position[2])}) if name in config.sinks else box
                  for name, box in config.containers.items()}
    area = config.area and config.area.model_copy(update={"centre": (x, y, config.area.centre[2])})
    return config.model_copy(update={"containers": containers, "area": area})


def _compute_first_offset(config: RehearsalConfig, name: str, task: TaskConfig) -> np.ndarray:
    """Translation (3,) [m] from where the first motion was learned to where the rehearsal's material is."""
    if task.container is not None:
        own, learned = config.containers.get(task.container), task.containers[task.container]
        if own is None or task.container not in config.sources or own.yaw_deg != learned.yaw_deg:
            raise ConfigError(f"learned: {name} was learned over a filled container {task.container!r} with yaw_deg "
                              f"{learned.yaw_deg:g}; accepted: one like it in containers")
        return np.array(own.position) - np.array(learned.position)
    if task.pile is not None:
        if config.pile is None:
            raise ConfigError(f"learned: {name} was learned on a pile; accepted: a `pile` on the table")
        return (np.array(config.pile.centre) - np.array(task.pile.centre)) * [1, 1, 0]
    if config.tool_fill_height is None:
        raise ConfigError(f"learned: {name} begins with a full {task.tool_name}; accepted: a tool_fill_height, or a "
                          f"motion that fills it first")
    return np.zeros(3)
