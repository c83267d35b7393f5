"""Collision monitoring: contacts of tool and containers, of the robot with its surroundings, and with itself."""

from collections.abc import Collection

import mujoco
import numpy as np

from robosim.robot.mjspec import body_ids_below
from robosim.scene.compiled import Scene


class ContactCounter:
    """MuJoCo's contacts of the robot, summed over all steps since the last `restart`.
    The base, which stands where it stands, is no part of the robot here. containers: names of the containers' bodies.
    """

    def __init__(self, scene: Scene, data: mujoco.MjData, containers: Collection[str]) -> None:
        self._data, self._bodies, bodies = data, scene.model.geom_bodyid, np.arange(scene.model.nbody)
        is_tool, is_own = bodies == scene.tool, np.isin(bodies, scene.robot_bodies())
        is_arm = is_own & ~np.isin(bodies, body_ids_below(scene.model, scene.wrist))
        is_robot = is_own & (scene.model.body_weldid > 0)
        is_container = np.array([scene.model.body(int(b)).name in containers for b in bodies])
        sums = np.zeros((2, len(bodies), len(bodies), 3), int)
        """What a contact of two bodies adds to the three sums, where the tool stands by itself, and where it is held.
        """
        for is_held, table in enumerate(sums):
            others = np.outer(is_robot & (is_held | ~is_tool), ~is_own & ~is_container)
            table[..., 0] = np.outer(is_tool, is_container)
            table[..., 1] = np.outer(is_robot & ~is_tool, is_container) | others
            table[..., 2] = np.outer(is_robot & ~is_arm, is_arm)
        self._sums = sums + sums.swapaxes(1, 2)
        self._sums[..., 2] += np.outer(is_arm, is_arm)
        self.restart()

    def restart(self) -> None:
        """Set the sums to zero."""
        self.load({"tool_container": 0, "surroundings": 0, "itself": 0})

    def state(self) -> dict[str, int]:
        """Return the sums."""
        return {"tool_container": self.tool_container_contacts, "surroundings": self.robot_surroundings_contacts,
                "itself": self.robot_self_contacts}

    def load(self, state: dict[str, int]) -> None:
        """Take over what `state` returned."""
        self.tool_container_contacts = state["tool_container"]
        """Contacts of the tool with containers."""
        self.robot_surroundings_contacts = state["surroundings"]
        """Contacts of arm, hand and tool with table, floor and obstacles, and of arm and hand with containers."""
        self.robot_self_contacts = state["itself"]
        """Contacts between parts of the arm, and of hand and tool with the arm."""

    def count(self, is_held: bool = True) -> None:
        """Add the contacts of the present step; is_held: whether the hand holds the tool, or it stands by itself."""
        if self._data.ncon:
            first, second = self._bodies[self._data.contact.geom.T]
            sums = self._sums[int(is_held), first, second].sum(0).tolist()
            self.tool_container_contacts += sums[0]
            self.robot_surroundings_contacts += sums[1]
            self.robot_self_contacts += sums[2]
