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
        self._model, self._data = scene.model, data
        bodies = np.arange(scene.model.nbody)
        is_own = np.isin(bodies, scene.robot_bodies())
        self._is_tool = bodies == scene.tool
        self._is_arm = is_own & ~np.isin(bodies, body_ids_below(scene.model, scene.wrist))
        self._is_robot = is_own & (scene.model.body_weldid > 0)
        self._is_container = np.array([scene.model.body(int(b)).name in containers for b in bodies])
        self._is_other = ~is_own & ~self._is_container
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
        bodies = self._model.geom_bodyid[self._data.contact.geom]
        pairs = np.concatenate([bodies, bodies[:, ::-1]])
        first, second = pairs.T
        robot, container = self._is_robot[first], self._is_container[second]
        self.tool_container_contacts += int(np.sum(self._is_tool[first] & container))
        on_others = self._is_other[second] & (is_held | ~self._is_tool[first])
        self.robot_surroundings_contacts += int(np.sum(robot & (~self._is_tool[first] & container | on_others)))
        between_links = self._is_arm[bodies].all(1)
        of_hand = self._is_robot[first] & ~self._is_arm[first] & self._is_arm[second]
        self.robot_self_contacts += int(between_links.sum() + of_hand.sum())
