"""What touches what must not touch: the tool and the containers, the robot and its surroundings."""

from collections.abc import Collection
from functools import cache

import mujoco
import numpy as np
import trimesh

from mpm import Pose
from mpm.geometry.sampled_sdf import Lattice
from robosim.config.rehearsal import RehearsalConfig
from robosim.scene.build import inner_size
from robosim.scene.fill import tool_sdf
from robosim.scene.frames import body_pose, container_pose
from robosim.shapes.container import container_shell
from robosim.shapes.tool import WALL

RIGID_PARTICLES = 20_000
"""Static particles on the surface of each container: 2 mm apart."""
ROUGH = 1e-5
"""[m] by which the search for candidates is wider than the tool's box: single precision is off by less."""
SLOPE = 1e-3
"""[m] to both sides of a point over which the slope of the tool's distance is taken: a spacing of its lattice."""
ROBOT = ("link1", "link2", "link3", "link4", "link5", "link6", "link7", "palm", "f1", "f2", "fm")
"""Starts of the names of the bodies that must touch neither table nor containers; link0 stands on the table."""


@cache
def tool_distance(tool: str) -> Lattice:
    """Signed distance of a real tool in its own frame. It is read on the host alone: scenes may share it."""
    return tool_sdf(tool, WALL)


class RigidParticles:
    """Static particles of the containers, looked up in the tool's signed distance."""

    def __init__(self, config: RehearsalConfig) -> None:
        self._sdf = tool_distance(config.tool)
        places = []
        for name, container in config.containers.items():
            shell = container_shell(inner_size(name))
            points = trimesh.sample.sample_surface(shell, RIGID_PARTICLES, seed=0)[0]
            places.append(container_pose(container).apply(points))
        self._places = np.concatenate(places)
        self._rough = np.ascontiguousarray(self._places.T, np.float32)
        """The same in single precision (3, n), to find the few that lie in the tool's box."""
        low, high = self._sdf.bounds if isinstance(self._sdf, Lattice) else (-self._sdf.radius, self._sdf.radius)
        self._low, self._high = np.broadcast_to(low, 3) - ROUGH, np.broadcast_to(high, 3) + ROUGH
        self._rim = self._places[:, 2].max()
        self.count, self.depth = 0, 0.0
        """Particles inside the tool, summed over all steps; the deepest [m]."""

    def _near(self, pose: Pose, margin: float) -> np.ndarray:
        """Particles (n, 3) [m], in the frame of a tool at a pose, that may be closer to it than `margin` [m]: elsewhere
        the distance is larger, because the box of its lattice holds the tool."""
        if pose.position[2] - self._sdf.radius - margin >= self._rim:
            return np.empty((0, 3))
        turn = pose.matrix.T
        origin, inside = turn @ pose.position, np.ones(len(self._places), bool)
        for x, low, high in zip(turn.astype(np.float32) @ self._rough, self._low + origin, self._high + origin):
            inside &= (x > np.float32(low - margin)) & (x < np.float32(high + margin))
        return pose.inverse().apply(self._places[inside])

    def look(self, pose: Pose) -> None:
        """Count the particles inside a tool at a pose."""
        near = self._near(pose, 0.0)
        if len(near):
            distance = self._sdf.distance(near)
            self.count += int(np.sum(distance < 0))
            self.depth = max(self.depth, float(-distance.min()))

    def push(self, pose: Pose, margin: float) -> np.ndarray:
        """Displacement (3,) [m] that takes a tool at a pose away from the particle closest to it, to a distance of
        `margin` [m]; zero where none is closer."""
        near = self._near(pose, margin)
        distance = self._sdf.distance(near) if len(near) else np.array([margin])
        closest = int(distance.argmin())
        if distance[closest] >= margin:
            return np.zeros(3)
        ends = near[closest] + SLOPE * np.concatenate([np.eye(3), -np.eye(3)])
        slope = np.subtract(*self._sdf.distance(ends).reshape(2, 3))
        length = np.linalg.norm(slope)
        if length == 0.0:  # as far from one side as from the other
            return np.zeros(3)
        return -(margin - distance[closest]) * (pose.matrix @ slope) / length


class Touches:
    """Counts, over all steps since `restart`, of MuJoCo's contacts between tool and containers, and between robot (or
    the tool) and surroundings."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, tool: str, containers: Collection[str]) -> None:
        self.tool_container = self.robot_surroundings = 0
        self._model, self._data = model, data
        self._tool = model.body(tool).id
        names = [model.body(i).name for i in range(model.nbody)]
        self._robot = np.array([n.startswith(ROBOT) for n in names])
        self._table = np.array([n == "table" for n in names])
        self._is_container = np.array([n in containers for n in names])

    def restart(self) -> None:
        """From zero."""
        self.tool_container = self.robot_surroundings = 0

    def count(self) -> None:
        """Add this step's contacts."""
        bodies = self._model.geom_bodyid[self._data.contact.geom]
        pairs = np.concatenate([bodies, bodies[:, ::-1]])
        tool, robot = pairs[:, 0] == self._tool, self._robot[pairs[:, 0]]
        table, container = self._table[pairs[:, 1]], self._is_container[pairs[:, 1]]
        self.tool_container += int(np.sum(tool & container))
        self.robot_surroundings += int(np.sum(robot & (table | container) | tool & table))


class Contacts:
    """A rehearsal's counts over all steps: those of `Touches`, and container particles inside the tool.

    What a scene does not ask for (`tool_container`) is neither made nor looked up.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, config: RehearsalConfig) -> None:
        self._data, self._tool = data, model.body(config.tool).id
        self._touches = Touches(model, data, config.tool, config.containers)
        looked_up = config.containers and "sdf" in config.tool_container
        self._particles = RigidParticles(config) if looked_up else None

    @property
    def robot_surroundings(self) -> int:
        """Contacts of the robot with table and containers, and of the tool with the table."""
        return self._touches.robot_surroundings

    @property
    def tool_container(self) -> int:
        """Contacts of tool and containers: MuJoCo's own, and container particles inside the tool."""
        return self._touches.tool_container + (self._particles.count if self._particles else 0)

    @property
    def tool_container_depth(self) -> float:
        """How deep [m] a container was in the tool; 0 where nobody looked."""
        return self._particles.depth if self._particles else 0.0

    def count(self) -> None:
        """Add this step's contacts."""
        self._touches.count()
        if self._particles:
            self._particles.look(body_pose(self._data, self._tool))
