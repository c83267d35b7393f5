"""Collision monitoring: contacts of tool and containers, and of the robot with its surroundings."""

from collections.abc import Collection

import mujoco
import numpy as np

from robosim.config.rehearsal import RehearsalConfig
from robosim.scene.container_clearance import ContainerSurface
from robosim.scene.frames import body_pose

ROBOT_BODIES = ("link1", "link2", "link3", "link4", "link5", "link6", "link7", "palm", "f1", "f2", "fm")
"""Prefixes of the names of the bodies that must touch neither table nor containers; link0 stands on the table."""


class ContactCounter:
    """MuJoCo's contacts, summed over all steps since the last `restart`.

    tool: name of the tool's body. containers: names of the containers' bodies.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, tool: str, containers: Collection[str]) -> None:
        self.tool_container_contacts = 0
        """Contacts of the tool with containers."""
        self.robot_surroundings_contacts = 0
        """Contacts of the robot with table and containers, and of the tool with the table."""
        self._model, self._data = model, data
        self._tool = model.body(tool).id
        names = [model.body(i).name for i in range(model.nbody)]
        self._is_robot = np.array([n.startswith(ROBOT_BODIES) for n in names])
        self._is_table = np.array([n == "table" for n in names])
        self._is_container = np.array([n in containers for n in names])

    def restart(self) -> None:
        """Set both sums to zero."""
        self.tool_container_contacts = self.robot_surroundings_contacts = 0

    def state(self) -> dict[str, int]:
        """Return both sums."""
        return {"tool_container": self.tool_container_contacts, "surroundings": self.robot_surroundings_contacts}

    def load(self, state: dict[str, int]) -> None:
        """Take over what `state` returned."""
        self.tool_container_contacts, self.robot_surroundings_contacts = state["tool_container"], state["surroundings"]

    def count(self) -> None:
        """Add the contacts of the present step."""
        bodies = self._model.geom_bodyid[self._data.contact.geom]
        pairs = np.concatenate([bodies, bodies[:, ::-1]])
        tool, robot = pairs[:, 0] == self._tool, self._is_robot[pairs[:, 0]]
        table, container = self._is_table[pairs[:, 1]], self._is_container[pairs[:, 1]]
        self.tool_container_contacts += int(np.sum(tool & container))
        self.robot_surroundings_contacts += int(np.sum(robot & (table | container) | tool & table))


class CollisionMonitor:
    """Collisions of a rehearsal: contacts, and container points inside the tool.

    Only what the rehearsal's `tool_container` lists is monitored.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, config: RehearsalConfig) -> None:
        self._data, self._tool = data, model.body(config.tool).id
        self._contacts = ContactCounter(model, data, config.tool, config.containers)
        has_surface = config.containers and "sdf" in config.tool_container
        self._surface = ContainerSurface(config) if has_surface else None

    @property
    def robot_surroundings_contacts(self) -> int:
        """Contacts of the robot with table and containers, and of the tool with the table."""
        return self._contacts.robot_surroundings_contacts

    @property
    def tool_container_contacts(self) -> int:
        """Contacts of tool and containers, and container points inside the tool."""
        return self._contacts.tool_container_contacts + (self._surface.penetrations if self._surface else 0)

    @property
    def tool_container_depth(self) -> float:
        """Largest depth [m] of a container point in the tool.

        Zero where this is not monitored.
        """
        return self._surface.depth if self._surface else 0.0

    def count(self) -> None:
        """Add the collisions of the present step."""
        self._contacts.count()
        if self._surface:
            self._surface.record_penetrations(body_pose(self._data, self._tool))
