"""What the arm's joint torque sensors feel, and the external torque that its controller makes of it."""

import mujoco
import numpy as np

from robosim.robot.model import Arm


class TorqueSensors:
    """Readings of the joint torque sensors."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, joints: tuple[str, ...], arm: Arm) -> None:
        self._data, self._arm = data, arm
        self._axes = np.array([model.joint(name).axis for name in joints])
        self._places = np.array([model.sensor(f"{name}_torque").adr[0] for name in joints])

    def torques(self) -> np.ndarray:
        """Torques [N m] (7,) that the links feel about their joints' axes, as of the last step."""
        readings = self._data.sensordata[self._places[:, None] + np.arange(3)]
        return np.einsum("ij,ij->i", readings, self._axes)

    def external(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
        """Torques [N m] (7,) that something outside puts on the arm: model of arm, hand and empty tool less sensors.

        What a robot's controller reports as external torque; a load in the tool is external to it.
        """
        return self._arm.rigid_torque(q, qd, qdd) - self.torques()
