"""What carries the tool when the whole arm does: inverse kinematics, smoothing, servo and two-way coupling."""

from collections.abc import Iterator
from functools import lru_cache

import mujoco
import numpy as np
from ruckig import ControlInterface, InputParameter, OutputParameter, Result, Ruckig, Synchronization

import mpm
from robosim.config.robot import Grip, RobotConfig, load_robot
from robosim.coupling.plugin import GranularPlugin
from robosim.coupling.trial_step import STATE
from robosim.envs.carrier import Carrier, Step
from robosim.errors import RobotDiverged, UnreachableWaypoint
from robosim.robot.inverse_kinematics import solve, solve_path, step_towards
from robosim.robot.model import SPEED_LIMITS, Arm
from robosim.robot.servo import Servo
from robosim.robot.timing import JointState
from robosim.scene.build import compile_scene, scene_spec
from robosim.scene.clearance import Touches
from robosim.scene.frames import body_pose
from robosim.scene.grasp import Grasp
from robosim.tasks.counting import TOOL
from robosim.tasks.task import TaskConfig

PATH_POSES = 61
"""Poses of the task's script through which the arm must be able to go."""
CATCH_UP = 20.0
"""[1/s] at which the smoothed motion closes the gap to its goal."""


@lru_cache(maxsize=32)
def start_posture(words: str) -> tuple[float, ...]:
    """Joint angles [rad] (7,) of the start of a task, given as JSON, from which its whole script can be followed."""
    task = TaskConfig.model_validate_json(words)
    way = task.way()
    times = np.linspace(0.0, task.steps * task.step_dt, PATH_POSES)
    solution = solve_path(Arm(task.tool), [way.pose(t) for t in times], [(0, "start"), (PATH_POSES - 1, "end")])
    return tuple(solution.q[0])


class Smoother:
    """Joint motion within the limits of speed, acceleration and jerk behind a goal that moves from step to step.

    Ruckig is asked for speeds: those of the goal, and what closes the gap to it. Asked for places that move, it takes
    long ways round a goal that is near.
    """

    def __init__(self, robot: RobotConfig, dt: float, arm: Arm) -> None:
        self._otg, self._request, self._output = Ruckig(7, dt), InputParameter(7), OutputParameter(7)
        self._speed = SPEED_LIMITS * robot.limits.velocity_fraction
        self._lower, self._upper = arm.lower, arm.upper
        self._request.control_interface = ControlInterface.Velocity
        self._request.synchronization = Synchronization.No
        self._request.max_velocity = list(self._speed)
        self._request.max_acceleration = list(robot.limits.acceleration)
        self._request.max_jerk = list(robot.limits.jerk)

    def restart(self, q: np.ndarray) -> None:
        """At rest at angles q [rad] (7,)."""
        self._q = np.array(q)
        self._now, self._request.current_position = 0.0, list(q)
        self._request.current_velocity = self._request.current_acceleration = [0.0] * 7

    def step(self, q: np.ndarray, qd: np.ndarray) -> JointState:
        """One step towards angles q [rad] that move with speeds qd [rad/s]."""
        wanted = qd + CATCH_UP * (np.clip(q, self._lower, self._upper) - self._q)
        self._request.target_velocity = list(np.clip(wanted, -self._speed, self._speed))
        self._now += self._otg.delta_time
        if self._otg.update(self._request, self._output) not in (Result.Working, Result.Finished):
            raise RobotDiverged(self._now, ["the smoother found no motion within the joints' limits"])
        self._output.pass_to_input(self._request)
        self._q = np.array(self._output.new_position)
        return JointState(self._q, np.array(self._output.new_velocity), np.array(self._output.new_acceleration))


class ArmTool(Carrier):
    """Moves the tool with the arm: the grains push back."""

    def __init__(self, task: TaskConfig, solver: mpm.Solver, grasp: Grip) -> None:
        super().__init__(task)
        self._solver = solver
        self._robot = load_robot("iiwa14")
        self._task = task
        self._grip: Grip = grasp
        self.scene = compile_scene(self.spec(), task.tool)
        self.model = self.scene.model
        self.data = self.robot = mujoco.MjData(self.model)
        self._arm = Arm(task.tool)
        self._start_q = np.array(start_posture(task.model_dump_json()))
        self.data.qpos[self.scene.arm_qpos] = self._start_q
        mujoco.mj_forward(self.model, self.data)
        self.grasp = Grasp(self.model, self.data, self.scene.tool)
        self.servo, self._smoother = Servo(self._arm, self._robot.servo), Smoother(self._robot, task.step_dt, self._arm)
        self._q = self._start_q
        self.servo.check(self.model, self.data, self.scene.arm_dofs)
        self._touches = Touches(self.model, self.data, task.tool, task.containers)
        self._torque = self._lag = 0.0
        self._close_fingers()
        self.plugin = GranularPlugin(self.model, self.data, solver, bodies={task.tool: TOOL})

    def spec(self) -> mujoco.MjSpec:
        """The rigid scene, a new specification at each call."""
        return scene_spec(self._task.tool, self._grip, self._task.containers, self._task.step_dt, contact=True)

    def _close_fingers(self) -> None:
        """Hold the start until the fingers have closed and, with a grasp by friction, carry the tool alone."""
        still = JointState(self._start_q, np.zeros(7), np.zeros(7))
        steps = round(self._robot.grasp_time / self._dt)
        for k in range(2 * steps):
            if k < steps:
                self.grasp.close(min(k / (0.6 * steps), 1.0))
            self._drive(still)
            if k == steps:
                self.grasp.release()
            mujoco.mj_step(self.model, self.data)
        self._held = np.empty(mujoco.mj_stateSize(self.model, STATE))
        self.data.time = 0.0
        mujoco.mj_getState(self.model, self.data, self._held, STATE)
        mujoco.mj_kinematics(self.model, self.data)

    def restart(self, pose: mpm.Pose) -> mpm.Pose:
        """Put the arm where it holds the tool at a pose; returns where it holds it really."""
        mujoco.mj_setState(self.model, self.data, self._held, STATE)
        posture = solve(self._arm, pose, self._start_q, rest=self._start_q)
        if not posture.converged:
            raise UnreachableWaypoint("start", posture.position_error, np.degrees(posture.angle_error), 0.0)
        self._q = posture.q
        offset = self.data.qpos[self.scene.arm_qpos] - self._start_q  # what the servo leaves under gravity
        self.data.qpos[self.scene.arm_qpos] = self._q + offset
        self.data.qvel[:] = 0.0
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_forward(self.model, self.data)
        self._smoother.restart(self._q)
        self._torque = self._lag = 0.0
        self._touches.restart()
        self.grasp.restart()
        self.plugin.restart()
        super().restart(pose)
        return body_pose(self.data, self.scene.tool)

    def hold(self, linear: np.ndarray, angular: np.ndarray, steps: int) -> Iterator[Step]:
        """Command velocities [m/s], [rad/s] in world axes; the arm follows as it can."""
        for _ in range(steps):
            self.command(linear, angular)
            q = step_towards(self._arm, self.commanded, self._q, self._start_q)
            self._drive(self._smoother.step(q, (q - self._q) / self._dt))
            self._q = q
            self.plugin.step()
            self.grasp.watch()
            self._watch()
            yield self.plugin.read[-1], self._solver.collider_pose(TOOL)

    def _watch(self) -> None:
        torque = np.abs(self.servo.demand / self._arm.torque_limits).max()
        lag = np.linalg.norm(self.data.xpos[self.scene.tool] - self.commanded.position)
        self._torque, self._lag = max(self._torque, float(torque)), max(self._lag, float(lag))
        self._touches.count()

    @property
    def strain(self) -> dict[str, float]:
        """Of the episode so far: largest torque asked for as a share of its limit, the tool's largest distance [m] from
        where it was commanded to be, and contacts of robot and table or containers, or tool and table, over all
        steps."""
        return {"torque_limit_ratio_max": self._torque, "tool_lag_max": self._lag,
                "surroundings_contacts": float(self._touches.robot_surroundings)}

    def _drive(self, wanted: JointState) -> None:
        """Motor torques for a joint state."""
        q, qd = self.data.qpos[self.scene.arm_qpos], self.data.qvel[self.scene.arm_dofs]
        self.data.ctrl[self.scene.arm_actuators] = self.servo.torque(wanted, q, qd)
