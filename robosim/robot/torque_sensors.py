"""Joint torque sensors of the arm, and the external torque estimated from them."""

import mujoco
import numpy as np

from robosim.robot.model import Arm


class TorqueSensors:
    """Readings of the joint torque sensors of `scene.models`."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, joints: tuple[str, ...], arm: Arm) -> None:
        self._data, self._arm = data, arm
        self._axes = np.array([model.joint(name).axis for name in joints])
        self._addresses = np.array([model.sensor(f"{name}_torque").adr[0] for name in joints])

    def read(self) -> np.ndarray:
        """Read the torques [N m] (7,) on the links about their joints' axes.

        As of the last step's begin.
        """
        readings = self._data.sensordata[self._addresses[:, None] + np.arange(3)]
        return np.einsum("ij,ij->i", readings, self._axes)

    def estimate_external(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
        """Estimate the external torques [N m] (7,) on the joints.

        The model of arm, hand and empty tool, less the sensors. This is what a robot's controller reports as external
        torque; a load in the tool is external to it.
        """
        return self._arm.rigid_torque(q, qd, qdd) - self.read()
