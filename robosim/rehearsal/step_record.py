"""What every step of a rehearsal stores, and the readings that are computed from it, many steps at once."""

import numpy as np

from robosim.cell.cell import Cell
from robosim.coupling.ledger import balance
from robosim.rehearsal.readings import Steps
from robosim.robot.assembly import WRIST_SITE
from robosim.robot.joint_control import TorqueSensors
from robosim.robot.model import Arm
from robosim.robot.timing import JointMotion, JointState

CAPACITY = 1000
"""Steps that are stored at most before their readings are computed."""


class StepRecord:
    """Numbers of the latest steps of a cell, in memory that is used again.
    motion: planned or recorded, whose tool poses are the commanded ones where a step has a time of it."""

    def __init__(self, cell: Cell, arm: Arm, motion: JointMotion) -> None:
        self._cell, self._arm, self._motion = cell, arm, motion
        self._sensors = TorqueSensors(cell.model, cell.data, arm)
        model, data, tool = cell.model, cell.data, cell.scene.tool
        self._wrist = [model.sensor(f"wrist_{name}").adr[0] + np.arange(3) for name in ("force", "torque")]
        before = {"qpos_before": data.qpos, "qvel_before": data.qvel}
        after = {"qpos": data.qpos, "qvel": data.qvel, "qacc": data.qacc, "sensors": data.sensordata,
                 "axes": data.site_xmat[model.site(WRIST_SITE).id], "position": data.xpos[tool],
                 "quaternion": data.xquat[tool], "sums": cell.plugin.sums}
        joints, six = np.zeros(len(arm.joints)), np.zeros(6)
        given = {"times": six[:3], "asked": joints, "torque": joints, "demanded": joints, "wrench": six,
                 "velocity_before": six, "velocity": six}
        self._rows = {name: np.zeros((CAPACITY, *array.shape)) for name, array in (before | after | given).items()}
        self._before, self._after = ([(self._rows[name], array) for name, array in part.items()]
                                     for part in (before, after))
        self.count = 0
        """Steps whose readings are still to be computed."""

    def begin(self) -> None:
        """Store what is as the step begins."""
        for rows, array in self._before:
            rows[self.count] = array
        self._cell.read_tool_velocity(self._rows["velocity_before"][self.count])

    def end(self, target: JointState, motion_time: float, torque: np.ndarray) -> None:
        """Store what is as the step ends.
        motion_time: that of the motion then [s]; NaN: the target is what is commanded."""
        k, own, cell = self.count, self._rows, self._cell
        for rows, array in self._after:
            rows[k] = array
        own["times"][k] = cell.data.time, motion_time, cell.plugin.is_missed
        own["asked"][k], own["torque"][k], own["demanded"][k] = target.q, torque, cell.servo.demanded_torque
        own["wrench"][k, :3], own["wrench"][k, 3:] = cell.plugin.wrench(cell.tool_name)
        cell.read_tool_velocity(own["velocity"][k])
        self.count += 1

    def compute(self) -> Steps:
        """Compute the readings of the steps that are stored, and forget these."""
        rows, scene, dt = {name: values[: self.count].copy() for name, values in self._rows.items()}, \
            self._cell.scene, self._cell.model.opt.timestep
        self.count, (time, motion_time, is_missed) = 0, rows["times"].T
        q, q_before = rows["qpos"][:, scene.arm_qpos], rows["qpos_before"][:, scene.arm_qpos]
        qd, qd_before, qdd = (rows[name][:, scene.arm_dofs] for name in ("qvel", "qvel_before", "qacc"))
        asked = [own if np.isnan(t) else self._motion.state(t).q for own, t in zip(rows["asked"], motion_time)]
        axes, force = rows["axes"].reshape(-1, 3, 3), rows["wrench"][:, :3]
        power = rows["wrench"] * 0.5 * (rows["velocity_before"] + rows["velocity"])[:, [3, 4, 5, 0, 1, 2]]
        impulses = balance(rows["sums"], self._cell.plugin.colliders)
        # sensor values belong to the step's start, as MuJoCo's accelerations do
        external = self._sensors.estimate_external(q_before, qd_before, qdd, rows["sensors"])
        return Steps(
            time, q, qd, (qd - qd_before) / dt, rows["torque"], rows["demanded"], self._sensors.read(rows["sensors"]),
            external, np.array([np.concatenate(self._arm.tool_pose(one)) for one in asked]).reshape(-1, 7),
            np.hstack([rows["position"], rows["quaternion"]]),
            np.hstack([np.einsum("nij,nj->ni", axes, rows["sensors"][:, place]) for place in self._wrist]),
            np.hstack(impulses.residual), impulses.exchanged, force, -power.sum(1) * dt, is_missed)
