"""Samples of the arm's own sensors: joints, joint torques and the wrist's force and torque."""

from typing import Any

import numpy as np

from robosim.cell.cell import Cell
from robosim.robot.joint_control import TorqueSensors

SUMS = ("torque", "external", "wrist")


class ArmSampler:
    """Takes a sample after each step: the means over an action, and joint angles and speeds at its end.
    torque: of the joints' sensors [N m] (n,). external: torques [N m] (n,) that the controller estimates from them.
    wrist: force [N] and torque [N m] (6,) of the wrist sensor in its own axes. The scene needs the sensors that
    `robosim.robot.assembly` adds."""

    def __init__(self, cell: Cell) -> None:
        self.cell = cell
        self._sensors = TorqueSensors(cell.model, cell.data, cell.arm)
        self._wrist = np.concatenate([cell.model.sensor(f"wrist_{kind}").adr[0] + np.arange(3)
                                      for kind in ("force", "torque")])
        self.restart()

    def restart(self) -> None:
        """Take the first sample of an episode, at rest."""
        self.begin_action()
        self._before = self.cell.q.copy(), self.cell.qd.copy()
        self.take()

    def begin_action(self) -> None:
        """Forget the samples taken so far."""
        n = len(self.cell.arm.joints)
        self._count = 0
        self.torque, self.external, self.wrist = np.zeros(n), np.zeros(n), np.zeros(6)

    def take(self) -> None:
        """Take a sample after a step of MuJoCo, whose sensors show the state at its begin."""
        data = self.cell.data
        acceleration = data.qacc[self.cell.scene.arm_dofs]
        sample = (self._sensors.read(), self._sensors.estimate_external(*self._before, acceleration),
                  data.sensordata[self._wrist])
        self._before = self.cell.q.copy(), self.cell.qd.copy()
        self._count += 1
        for name, value in zip(SUMS, sample):
            mean = getattr(self, name)
            setattr(self, name, mean + (value - mean) / self._count)

    def state(self) -> dict[str, Any]:
        """Return the means so far: arrays and plain values."""
        return {name: np.array(getattr(self, name)) for name in SUMS} | \
            {"count": self._count, "before": np.array(self._before)}

    def load(self, state: dict[str, Any]) -> None:
        """Take over what `state` returned."""
        for name in SUMS:
            setattr(self, name, np.array(state[name]))
        q, qd = np.array(state["before"])
        self._count, self._before = state["count"], (q, qd)
