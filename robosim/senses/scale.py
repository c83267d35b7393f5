"""A balance under receiver, container or target: what it shows lags, drifts, and is rounded to its readability."""

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

import mpm
from robosim.dosing.balance import Balance
from robosim.scene.models import container_shape
from robosim.senses.term import NOTHING, SenseScene, Sight, Term, box, check_option
from robosim.shapes import tool_shape
from robosim.tasks.task import FAR, TaskConfig

CAPACITY = 2.2
"""Largest mass [kg] that is shown."""


class ScaleTerm(Term):
    """Mass on a balance under the task's receiver or container, or else under its target on the table.

    lag: time constant [s] of its filter; a balance that settles within 1 s shows 99 % of a change after 4.6 lags.
    readability [kg]: step of the display. repeatability [kg]: standard deviation before rounding. drift [kg/s]: that
    of the slope with which the zero moves. The defaults are assumed, of a laboratory's precision balance of 0.01 g."""

    name, unit = "scale", "kg"
    all_grains = True

    def __init__(self, scene: SenseScene, lag: float = 0.2, readability: float = 1e-5, repeatability: float = 1e-5,
                 drift: float = 0.0) -> None:
        given = {"lag": lag, "repeatability": repeatability, "drift": drift}
        self._own = {name: check_option("scale", name, given[name], *pair) for name, pair in self.DRAWN.items()}
        self._readability = check_option("scale", "readability", readability, 0.0, 1.0)
        where = weighed_region(scene.task)
        assert where
        self._region, self._pose = where
        self._inside_tool = tool_shape(scene.task.tool).interior
        self.space = box([-CAPACITY], [CAPACITY])

    @classmethod
    def missing(cls, scene: SenseScene) -> str:
        return "" if weighed_region(scene.task) else "a task with a container, or with a target on the table"

    DRAWN: ClassVar[dict[str, tuple[float, float]]] = {"lag": (0.0, 10.0), "repeatability": (0.0, 1.0),
                                                       "drift": (0.0, 1.0)}

    def begin(self, sight: Sight, drawn: Mapping[str, float] = NOTHING) -> Any:
        return Balance.start(sight.time, self._mass(sight)) | self._own | dict(drawn)

    def measure(self, sight: Sight, memory: Any, rng: np.random.Generator) -> np.ndarray:
        balance = Balance(memory["lag"], self._readability, memory["repeatability"], memory["drift"])
        return np.clip([balance.read(memory, sight.time, self._mass(sight), rng)], -CAPACITY, CAPACITY)

    def _mass(self, sight: Sight) -> float:
        """Return the mass [kg] of the grains above the balance that the tool does not hold.
        Those that still fall count, too: a steady stream's momentum, rate x speed, presses as its weight in the air."""
        x = sight.grains[:, :3].astype(float)
        is_on = self._region.holds((sight.setting.place @ self._pose).inverse().apply(x))
        is_on &= ~self._inside_tool.holds(sight.pose.inverse().apply(x))
        return sight.setting.grain_mass * int(is_on.sum())


def weighed_region(task: TaskConfig) -> tuple[mpm.Region, mpm.Pose] | tuple[()]:
    """Return the region whose grains a balance carries, and its pose in the world; empty where there is none."""
    if task.receiver is not None:
        receiver = task.containers[task.receiver]
        shape = container_shape(task.receiver, receiver)
        (x, y, z), (a, b, c) = shape.region.centre, shape.region.half
        return mpm.Region((x, y, z - c + FAR), (a, b, FAR), shape.is_round), receiver.pose
    for name, container in task.containers.items():
        return container_shape(name, container).region, container.pose
    if task.target.centre[2] - task.target.half[2] > 0.0:
        return ()
    return task.target.region, mpm.Pose(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
