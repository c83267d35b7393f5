"""What touches what must not touch: the tool and the containers, the robot and its surroundings."""

import mujoco
import numpy as np
import trimesh

from robosim.config import RehearsalConfig
from robosim.frames import body_pose
from robosim.tool_shapes import spoon_components

TOOL_POINTS = 1500
"""Points on the tool's real surface that are looked up in the containers' walls."""
TOOL_WALL = 0.0015
"""Real wall [m] of the tool."""
CONTAINER_WALL = 0.006
"""Real wall and floor [m] of the containers."""
ROBOT = ("link1", "link2", "link3", "link4", "link5", "link6", "link7", "palm", "f1", "f2", "fm")
"""Starts of the names of the bodies that must touch neither table nor containers; link0 stands on the table."""


class Contacts:
    """Counts, over all steps, of contacts between tool and containers and between robot and surroundings."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, config: RehearsalConfig) -> None:
        self.tool_container, self.robot_surroundings = 0, 0
        self._model, self._data = model, data
        self._tool = model.body(config.tool).id
        parts = trimesh.util.concatenate(spoon_components(TOOL_WALL))
        self._points = trimesh.sample.sample_surface(parts, TOOL_POINTS, seed=0)[0]
        self._containers = [(model.body(n).id, model.site(f"{n}_inside").size) for n in config.containers]
        names = [model.body(i).name for i in range(model.nbody)]
        self._robot = np.array([n.startswith(ROBOT) for n in names])
        self._table = np.array([n == "table" for n in names])
        self._scenery = np.array([n == "table" or n in config.containers for n in names])
        self._is_container = np.array([n in config.containers for n in names])

    def count(self) -> None:
        """Add this step's contacts: MuJoCo's own, and tool points inside a container's wall."""
        bodies = self._model.geom_bodyid[self._data.contact.geom]
        pairs = np.concatenate([bodies, bodies[:, ::-1]])
        self.tool_container += int(np.sum((pairs[:, 0] == self._tool) & self._is_container[pairs[:, 1]]))
        tool_on_table = (pairs[:, 0] == self._tool) & self._table[pairs[:, 1]]
        self.robot_surroundings += int(np.sum(self._robot[pairs[:, 0]] & self._scenery[pairs[:, 1]] | tool_on_table))
        self.tool_container += self._points_in_walls()

    def _points_in_walls(self) -> int:
        world = body_pose(self._data, self._tool).apply(self._points)
        rim = max(self._data.xpos[body][2] + 2 * half[2] for body, half in self._containers)
        total = 0
        if world[:, 2].min() > rim:  # most of the time the tool is above everything
            return total
        for body, half in self._containers:
            y = body_pose(self._data, body).inverse().apply(world)
            outer = np.all(np.abs(y[:, :2]) < half[:2] + CONTAINER_WALL, axis=1) \
                & (y[:, 2] > -CONTAINER_WALL) & (y[:, 2] < 2 * half[2])
            cavity = np.all(np.abs(y[:, :2]) < half[:2], axis=1) & (y[:, 2] > 0)
            total += int(np.sum(outer & ~cavity))
        return total
