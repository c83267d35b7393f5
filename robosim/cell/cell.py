"""The cell: a robot that holds a tool, and the grains that the tool moves."""

from collections.abc import Collection, Iterable

import mujoco
import numpy as np

import mpm
from robosim.coupling.plugin import Coupling, GranularPlugin
from robosim.robot.assembly import WRIST_SITE
from robosim.robot.joint_control import Servo
from robosim.robot.mjspec import body_pose
from robosim.robot.model import Arm, Gains
from robosim.robot.timing import JointState
from robosim.scene.collisions import ContactCounter
from robosim.scene.compiled import Scene
from robosim.scene.grasp import Grasp, put_tool


class Cell:
    """A robot and grains, which a command of the joints moves together; `couple` gives it its grains.
    q: joint angles at the start (n,) [rad]. containers: names of the containers' bodies. gains: of the servo; None: the
    arm's own. stand: world pose of a tool that the hand does not hold yet. tip: as of `Grasp`. Raises ConfigError for a
    time step that is too long for the gains."""

    def __init__(self, scene: Scene, arm: Arm, q: np.ndarray, containers: Collection[str], *,
                 gains: Gains | None = None, stand: mpm.Pose | None = None, tip: np.ndarray | None = None) -> None:
        self.scene, self.arm = scene, arm
        self.model, self.data = scene.model, mujoco.MjData(scene.model)
        self.data.qpos[scene.arm_qpos] = q
        if stand is not None:
            put_tool(scene, self.data, stand)
        mujoco.mj_forward(self.model, self.data)
        self.grasp = Grasp(scene, self.data, tip)
        dt = self.model.opt.timestep
        self.servo = Servo(arm, gains or arm.gains(dt), dt)
        self.servo.check_step(self.model, self.data, scene.arm_dofs)
        self.contacts = ContactCounter(scene, self.data, containers)
        self.tool_name = scene.model.body(scene.tool).name
        """Name of the tool's body."""

    def check_path(self, path: Iterable[np.ndarray]) -> None:
        """Raise ConfigError where the time step is too long for the gains in a posture (n,) [rad] of a path."""
        data = mujoco.MjData(self.model)
        for q in path:
            data.qpos[self.scene.arm_qpos] = q
            mujoco.mj_fwdPosition(self.model, data)
            self.servo.check_step(self.model, data, self.scene.arm_dofs)

    def couple(self, solver: mpm.Solver, collider: int, coupling: Coupling) -> None:
        """Give the cell its grains; collider: index of the tool's in the solver."""
        self.plugin = GranularPlugin(self.model, self.data, solver, bodies={self.tool_name: collider},
                                     coupling=coupling)

    def step(self, target: JointState, is_held: bool = True) -> np.ndarray:
        """Command the joints, and advance robot and grains by one step; returns the motors' torques (n,) [N m].
        is_held: whether the hand holds the tool, or it stands by itself. Raises RobotDiverged and the solver's errors.
        """
        torque = self.command(target)
        self.plugin.step()
        self.grasp.measure_slip()
        self.contacts.count(is_held)
        return torque

    def command(self, target: JointState) -> np.ndarray:
        """Set the motors' torques (n,) [N m] for a commanded joint state, and return them."""
        torque = self.servo.compute_torque(target, self.q, self.qd)
        self.data.ctrl[self.scene.arm_actuators] = torque
        return torque

    @property
    def q(self) -> np.ndarray:
        """Joint angles (n,) [rad]."""
        return self.data.qpos[self.scene.arm_qpos]

    @property
    def qd(self) -> np.ndarray:
        """Joint speeds (n,) [rad/s]."""
        return self.data.qvel[self.scene.arm_dofs]

    def tool_pose(self) -> mpm.Pose:
        """Return the world pose of the tool's frame."""
        return body_pose(self.data, self.scene.tool)

    def read_tool_velocity(self, out: np.ndarray) -> None:
        """Write the velocity of the tool's centre of mass in world axes (6,): angular, linear, in MuJoCo's order."""
        mujoco.mj_objectVelocity(self.model, self.data, mujoco.mjtObj.mjOBJ_BODY, self.scene.tool, out, 0)

    def wrist_wrench(self) -> np.ndarray:
        """Return force [N] and torque [N m] (6,) of the wrist sensor in world axes, at the last step's start."""
        R = self.data.site_xmat[self.model.site(WRIST_SITE).id].reshape(3, 3)
        return np.concatenate([R @ self.data.sensor("wrist_force").data, R @ self.data.sensor("wrist_torque").data])
