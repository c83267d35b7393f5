"""Tasks with another fill, and with what is placed in another place."""

from collections.abc import Callable
from typing import Any

import numpy as np

import mpm
from robosim.base.errors import ConfigError
from robosim.config.scene import ContainerConfig
from robosim.scene.models import container_shape
from robosim.tasks.task import TaskConfig

ROOM = 0.07
"""By how much [m] the places of "hard" are farther off than those of "wide", for which the tasks have space."""


def filled(task: TaskConfig, fill: float) -> TaskConfig:
    """Return a task with as many grains that fill another volume: `fill` over the task's own."""
    if fill == 1.0:
        return task
    if task.sources:
        return with_sources(task, lambda own: own.model_copy(update={"fill_height": own.fill_height * fill}))
    if task.pile is not None:
        x, y, z = task.pile.half
        centre = (*task.pile.centre[:2], task.pile.centre[2] + (fill - 1.0) * z)
        return task.model_copy(update={"pile": task.pile.model_copy(update={"half": (x, y, z * fill),
                                                                            "centre": centre})})
    field = task.field.model_copy(update={"grains_per_cell": task.field.grains_per_cell / fill})
    return task.model_copy(update={"field": field})


def with_sources(task: TaskConfig, change: Callable[[ContainerConfig], ContainerConfig]) -> TaskConfig:
    """Return a task with its filled containers changed."""
    return task.model_copy(update={"containers": {
        name: change(own) if name in task.sources else own for name, own in task.containers.items()}})


def check_fill(task: TaskConfig, fill: float, slope_deg: float) -> None:
    """Raise ConfigError for grains that stand higher than the rim of their container."""
    for name in task.sources:
        container = task.containers[name]
        low, high = container_shape(name, container).bounds
        top = fill * container.fill_height + abs(np.tan(np.radians(slope_deg))) * 0.5 * (high[0] - low[0])
        if top > high[2] - low[2]:
            raise ConfigError(f"randomize: fill = {fill:g}, surface_slope_deg = {slope_deg:g}: the grains stand "
                              f"{top * 1e3:.0f} mm high in the {name}; accepted: up to {1e3 * (high[2] - low[2]):.0f} "
                              f"mm, its rim")


def hardened(task: TaskConfig) -> TaskConfig:
    """Return a task with a target of half the length and width, and space for places that are up to 0.1 m off.
    A receiver stays as it is. Box of the tool and region of the grains grow by ROOM on every side but z."""
    room = task.field.cell * np.ceil(ROOM / task.field.cell - 1e-9) * np.array([1.0, 1.0, 0.0])

    def grown(section: Any, low: str, high: str) -> Any:
        ends = {name: tuple(map(float, getattr(section, name) + room * sign)) for name, sign in ((low, -1), (high, 1))}
        return section.model_copy(update=ends)

    x, y, z = task.target.half
    half = task.target.half if task.receiver else (0.5 * x, 0.5 * y, z)
    return task.model_copy(update={"action": grown(task.action, "lower", "upper"),
                                   "field": grown(task.field, "region_lower", "region_upper"),
                                   "target": task.target.model_copy(update={"half": half})})


def displacement(task: TaskConfig, x: float, y: float, yaw_deg: float) -> mpm.Pose:
    """Return the motion to other places: a turn about the container or else the target, then a shift [m]."""
    centre = np.array(task.containers[task.container].position if task.container else task.target.centre, float)
    half = 0.5 * np.radians(yaw_deg)
    turn = mpm.Pose(np.zeros(3), np.array([np.cos(half), 0.0, 0.0, np.sin(half)]))
    return mpm.Pose(centre + [x, y, 0.0] - turn.apply(centre[None])[0], turn.quaternion)


def placed(task: TaskConfig, place: mpm.Pose) -> TaskConfig:
    """Return a task with its container, target, goal and bounds displaced; regions keep their axes."""
    def move(point: Any) -> tuple[float, ...]:
        return tuple(float(value) for value in place.apply(np.array(point, float)[None])[0])

    yaw = float(np.degrees(np.arctan2(place.matrix[1, 0], place.matrix[0, 0])))

    def turned(container: ContainerConfig) -> ContainerConfig:
        return container.model_copy(update={"position": move(container.position), "yaw_deg": container.yaw_deg + yaw})

    return with_sources(task, turned).model_copy(update={
        "goal": move(task.goal),
        **{name: region.model_copy(update={"centre": move(region.centre)})
           for name, region in (("target", task.target), ("bounds", task.bounds))}})
