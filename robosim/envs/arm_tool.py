"""The tool carried by the whole arm: inverse kinematics, smoothing, servo and two-way coupling."""

from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import Any

import mujoco
import numpy as np

import mpm
from robosim.base.errors import ConfigError, UnreachableWaypoint
from robosim.cell.arm_sampler import ArmSampler
from robosim.cell.cell import Cell
from robosim.config.arm import Grip
from robosim.coupling.trial_step import STATE
from robosim.envs.carrier import Carrier, Step
from robosim.robot.assembly import GRIP_TURNS_DEG, add_sensors
from robosim.robot.inverse_kinematics import solve_path, solve_pose, step_towards
from robosim.robot.joint_control import JointSmoother
from robosim.robot.model import Arm
from robosim.robot.timing import JointState
from robosim.scene.build import build_scene_spec
from robosim.scene.compiled import compile_scene
from robosim.scene.grasp import CLOSING_SHARE
from robosim.scene.models import assemble
from robosim.tasks.counting import TOOL
from robosim.tasks.draw import STANDARD, Setting
from robosim.tasks.scene_setting import SceneSetting
from robosim.tasks.task import TaskConfig

IIWA = "iiwa14"
"""The arm where none is named."""
GRASP_TIME = 1.0
"""Time [s] for the fingers to close before an episode."""
PATH_POSES = 61
"""Poses of the task's script that the arm must be able to follow from its start."""


@lru_cache(maxsize=32)
def find_hold(task_json: str, robot: str = IIWA, gripper: str | None = None) -> tuple[float, np.ndarray]:
    """Find the turn [deg] of the tool in the hand, and the joint angles [rad] (n,) at a task's start.
    The first of GRIP_TURNS_DEG with which all of the task's script is within reach. task_json: as JSON, because
    configurations are not hashable. Raises UnreachableWaypoint, ConfigError where there is none."""
    task = TaskConfig.model_validate_json(task_json)
    path = task.scripted_path()
    times = np.linspace(0.0, task.steps * task.step_dt, PATH_POSES)
    poses, ends = [path.pose(t) for t in times], [(0, "start"), (PATH_POSES - 1, "end")]
    refused: list[UnreachableWaypoint | ConfigError] = []
    for turn in GRIP_TURNS_DEG:
        try:
            solution = solve_path(Arm(assemble(task.tool, robot, gripper, turn)), poses, ends, times[1] - times[0])
            return turn, solution.q[0].copy()
        except (UnreachableWaypoint, ConfigError) as error:
            refused.append(error)
    raise refused[0]


class ArmTool(Carrier):
    """Moves the tool with the arm; the grains push back."""

    def __init__(self, task: TaskConfig, solver: mpm.Solver, grasp: Grip, robot: str = IIWA,
                 gripper: str | None = None, *, has_sensors: bool = False) -> None:
        super().__init__(task, solver)
        self._has_sensors = has_sensors
        self._grip: Grip = grasp
        turn, self._start_q = find_hold(task.model_dump_json(), robot, gripper)
        self._assembly = assemble(task.tool, robot, gripper, turn)
        arm = Arm(self._assembly)
        self.cell = Cell(compile_scene(self.build_spec(), self._assembly), arm, self._start_q, task.containers)
        self.robot_data = self.cell.data
        self._smoother = JointSmoother(arm.step_limits(), task.step_dt, arm)
        self._q = self._start_q
        self._forget_readings()
        self._close_fingers(round(GRASP_TIME / task.step_dt))
        self._scene_setting = SceneSetting(self.cell.scene, self.cell.servo, task)
        if has_sensors:
            self.sensors = ArmSampler(self.cell)
        self.cell.couple(solver, TOOL, task.coupling)

    def _forget_readings(self) -> None:
        self._torque_ratio, self._lag, self._behind = 0.0, 0.0, np.zeros(len(self._start_q))

    def build_spec(self) -> mujoco.MjSpec:
        spec = build_scene_spec(self._assembly, self._grip, self._task.containers, self._task.step_dt, contact=True)
        if self._has_sensors:
            add_sensors(spec, self._assembly)
        return spec

    def _close_fingers(self, steps: int) -> None:
        """Keep the start posture until the fingers are closed and, in a grasp by friction, carry the tool alone."""
        cell, still = self.cell, JointState(self._start_q, np.zeros_like(self._start_q), np.zeros_like(self._start_q))
        for k in range(2 * steps):
            if k < steps:
                cell.grasp.close(min(k / (CLOSING_SHARE * steps), 1.0))
            cell.command(still)
            if k == steps:
                cell.grasp.release()
            mujoco.mj_step(cell.model, cell.data)
        self._grasped = np.empty(mujoco.mj_stateSize(cell.model, STATE))
        cell.data.time = 0.0
        mujoco.mj_getState(cell.model, cell.data, self._grasped, STATE)
        mujoco.mj_kinematics(cell.model, cell.data)

    def restart(self, pose: mpm.Pose, setting: Setting = STANDARD) -> mpm.Pose:
        """Put the arm into a posture that has the tool at a pose, and return its pose; raises UnreachableWaypoint."""
        cell = self.cell
        self._scene_setting.apply(setting, cell.data)
        mujoco.mj_setState(cell.model, cell.data, self._grasped, STATE)
        posture = solve_pose(cell.arm, setting.actual(pose), self._start_q, rest=self._start_q)
        if not posture.converged:
            raise UnreachableWaypoint("start", posture.position_error, np.degrees(posture.angle_error), 0.0)
        self._q = posture.q
        sag = cell.q - self._start_q  # the servo's steady error under gravity
        cell.data.qpos[cell.scene.arm_qpos] = self._q + sag
        cell.data.qvel[:] = 0.0
        mujoco.mj_kinematics(cell.model, cell.data)
        mujoco.mj_forward(cell.model, cell.data)
        self._smoother.restart(self._q)
        self._forget_readings()
        cell.contacts.restart()
        cell.grasp.restart()
        cell.plugin.restart()
        if self.sensors is not None:
            self.sensors.restart()
        super().restart(pose, setting)
        return cell.tool_pose()

    def state(self) -> dict[str, Any]:
        cell, integration = self.cell, np.empty_like(self._grasped)
        mujoco.mj_getState(cell.model, cell.data, integration, STATE)
        return super().state() | {
            "integration": integration, "q": self._q.copy(), "torque_ratio": self._torque_ratio, "lag": self._lag,
            "behind": self._behind.copy(),
            "smoother": self._smoother.state(), "saturations": cell.servo.saturations, "grasp": cell.grasp.state(),
            "demanded_torque": cell.servo.demanded_torque.copy(), "contacts": cell.contacts.state(),
            "plugin": cell.plugin.state(), "sensors": None if self.sensors is None else self.sensors.state(),
        }

    def load(self, state: dict[str, Any]) -> None:
        super().load(state)
        cell = self.cell
        self._scene_setting.apply(self.setting, cell.data)
        mujoco.mj_setState(cell.model, cell.data, state["integration"], STATE)
        mujoco.mj_kinematics(cell.model, cell.data)
        mujoco.mj_comPos(cell.model, cell.data)
        mujoco.mj_comVel(cell.model, cell.data)
        self._q, self._torque_ratio, self._lag = np.array(state["q"]), state["torque_ratio"], state["lag"]
        self._smoother.load(state["smoother"])
        self._behind = np.array(state["behind"])
        cell.servo.saturations, cell.servo.demanded_torque = state["saturations"], np.array(state["demanded_torque"])
        cell.contacts.load(state["contacts"])
        cell.grasp.load(state["grasp"])
        cell.plugin.load(state["plugin"])
        if self.sensors is not None:
            self.sensors.load(state["sensors"])

    def begin_action(self) -> None:
        super().begin_action()
        if self.sensors is not None:
            self.sensors.begin_action()

    def advance(self, velocity: Sequence[np.ndarray], steps: int) -> Iterator[Step]:
        cell = self.cell
        for _ in range(steps):
            pose = self.command(*velocity)
            q = step_towards(cell.arm, pose, self._q, self._start_q)
            target = self._smoother.step(q, (q - self._q) / self._dt)
            self._behind = np.maximum(self._behind, np.abs(target.q - q))
            self._q = q
            cell.step(target)
            if self.sensors is not None:
                self.sensors.take()
            ratio = np.abs(cell.servo.demanded_torque / cell.arm.torque_limits).max()
            lag = np.linalg.norm(cell.data.xpos[cell.scene.tool] - pose.position)
            self._torque_ratio, self._lag = max(self._torque_ratio, float(ratio)), max(self._lag, float(lag))
            yield cell.plugin.counts[-1], cell.plugin.solver.collider_pose(TOOL)

    @property
    def arm_readings(self) -> dict[str, float]:
        """Readings of the arm over the episode so far.

        torque_limit_ratio_max: largest demanded torque over its limit. tool_lag_max_m: largest distance of the tool
        from its commanded position. surroundings_contacts: contacts of the robot with table or containers, or of the
        tool with the table, summed over all steps. joint_lag_max_deg: largest angle by which a joint's own limits
        keep it behind the posture of the command; slowest_joint: the number of that joint, from 1 at the base."""
        return {"torque_limit_ratio_max": self._torque_ratio, "tool_lag_max_m": self._lag,
                "surroundings_contacts": float(self.cell.contacts.robot_surroundings_contacts),
                "joint_lag_max_deg": float(np.degrees(self._behind.max())),
                "slowest_joint": float(1 + self._behind.argmax())}
