"""Tasks with another fill, and with what is placed in another place."""

from typing import Any

import numpy as np

import mpm
from robosim.base.errors import ConfigError
from robosim.config.scene import ContainerConfig
from robosim.scene.models import container_shape
from robosim.tasks.task import TaskConfig


def filled(task: TaskConfig, fill: float) -> TaskConfig:
    """Return a task with as many grains that fill another volume: `fill` over the task's own."""
    if fill == 1.0:
        return task
    if task.container_place is not None:
        higher = task.container_place.fill_height * fill
        return task.model_copy(update={"container_place": task.container_place.model_copy(
            update={"fill_height": higher})})
    if task.start.pile is not None:
        x, y, z = task.start.pile.half
        centre = (*task.start.pile.centre[:2], task.start.pile.centre[2] + (fill - 1.0) * z)
        pile = task.start.pile.model_copy(update={"half": (x, y, z * fill), "centre": centre})
        return task.model_copy(update={"start": task.start.model_copy(update={"pile": pile})})
    field = task.field.model_copy(update={"grains_per_cell": task.field.grains_per_cell / fill})
    return task.model_copy(update={"field": field})


def check_fill(task: TaskConfig, fill: float, slope_deg: float) -> None:
    """Raise ConfigError for grains that stand higher than the rim of their container."""
    for name, container in task.containers.items():
        low, high = container_shape(name, container).bounds
        top = fill * container.fill_height + abs(np.tan(np.radians(slope_deg))) * 0.5 * (high[0] - low[0])
        if top > high[2] - low[2]:
            raise ConfigError(f"randomize: fill = {fill:g}, surface_slope_deg = {slope_deg:g}: the grains stand "
                              f"{top * 1e3:.0f} mm high in the {name}; accepted: up to {1e3 * (high[2] - low[2]):.0f} "
                              f"mm, its rim")


def pivot(task: TaskConfig) -> np.ndarray:
    """Return the point [m] (3,) that places are turned about."""
    middle = task.target.centre if task.container_place is None else task.container_place.position
    return np.array(middle, float)


def displacement(task: TaskConfig, x: float, y: float, yaw_deg: float) -> mpm.Pose:
    """Return the motion from a task's places to others: a turn about the pivot, then a shift [m] on the table."""
    half, centre = 0.5 * np.radians(yaw_deg), pivot(task)
    turn = mpm.Pose(np.zeros(3), np.array([np.cos(half), 0.0, 0.0, np.sin(half)]))
    return mpm.Pose(centre + [x, y, 0.0] - turn.apply(centre[None])[0], turn.quaternion)


def placed(task: TaskConfig, place: mpm.Pose) -> TaskConfig:
    """Return a task with its container, target, goal and bounds displaced; regions keep their axes."""
    def move(point: Any) -> tuple[float, ...]:
        return tuple(float(value) for value in place.apply(np.array(point, float)[None])[0])

    yaw = float(np.degrees(np.arctan2(place.matrix[1, 0], place.matrix[0, 0])))

    def turned(container: ContainerConfig) -> ContainerConfig:
        return container.model_copy(update={"position": move(container.position), "yaw_deg": container.yaw_deg + yaw})

    return task.model_copy(update={
        "goal": move(task.goal), "container_place": task.container_place and turned(task.container_place),
        **{name: region.model_copy(update={"centre": move(region.centre)})
           for name, region in (("target", task.target), ("bounds", task.bounds))}})
