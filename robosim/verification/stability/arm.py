"""What the arm does in extreme cases: MuJoCo's step, poses at the edge of what it can reach, loads beyond its motors.

Stable means: finite; motors within their torques; joints within their ranges to a degree; and, where a motion is asked
for, the tool where it was asked to be within a millimetre, without a joint faster than the data sheet allows.
"""

from collections.abc import Callable
from functools import lru_cache

import mujoco
import numpy as np

from mpm import Pose
from robosim.config.robot import RobotConfig, load_robot
from robosim.errors import ConfigError, UnreachableWaypoint
from robosim.robot.inverse_kinematics import HOME
from robosim.robot.joint_path import solve_path
from robosim.robot.model import SPEED_LIMITS, Arm
from robosim.robot.servo import Servo
from robosim.robot.timing import JointState, SmoothMotion
from robosim.scene.build import Scene, build_scene_spec, compile_scene
from robosim.verification.stability.cell import G, Verdict, verdict_of

TOOL = "spoon"
SHIFT = np.array([0.0, 0.35, 0.0, 0.3, 0.2, -0.3, 0.2])
"""Joint motion [rad] (7,) of the step test, in a second."""
HELD_TO = 1e-3
"""[m] that the tool may be off at the end of a motion."""
RANGE_MARGIN = np.radians(1.0)


@lru_cache
def arm() -> Arm:
    """The arm as Pinocchio sees it."""
    return Arm(TOOL)


def scene(host_step: float) -> tuple[Scene, mujoco.MjData, Servo, RobotConfig]:
    """The arm alone, at rest in its home posture, with its servo; raises ConfigError for a step that it cannot hold."""
    robot = load_robot("iiwa14")
    made = compile_scene(build_scene_spec(TOOL, "weld", {}, host_step, contact=False), TOOL)
    data = mujoco.MjData(made.model)
    data.qpos[made.arm_qpos] = HOME
    mujoco.mj_forward(made.model, data)
    servo = Servo(arm(), robot.servo)
    servo.check_step(made.model, data, made.arm_dofs)
    return made, data, servo, robot


def driven(made: Scene, data: mujoco.MjData, servo: Servo, wanted: Callable[[float], JointState], until: float,
           load: float = 0.0) -> tuple[str, dict[str, float]]:
    """Follow joint states for a time [s] with a load [kg] at the tool; what failed first, and readings."""
    seen = {"fastest_joint": 0.0, "saturated": 0.0}
    data.xfrc_applied[made.tool, 2] = -load * G
    while data.time < until:
        q, qd = data.qpos[made.arm_qpos], data.qvel[made.arm_dofs]
        data.ctrl[made.arm_actuators] = servo.compute_torque(wanted(data.time), q, qd)
        mujoco.mj_step(made.model, data)
        at = f" at t = {data.time:.4g} s"
        if data.warning[mujoco.mjtWarning.mjWARN_BADQACC].number or not np.all(np.isfinite(data.qpos)):
            return "accelerations beyond MuJoCo's range" + at, seen
        q, qd = data.qpos[made.arm_qpos], data.qvel[made.arm_dofs]
        seen["fastest_joint"] = max(seen["fastest_joint"], float(np.abs(qd / SPEED_LIMITS).max()))
        beyond = np.maximum(q - arm().upper, arm().lower - q).max()
        if beyond > RANGE_MARGIN:
            return f"a joint {np.degrees(beyond):.2g} degrees beyond its range" + at, seen
        if np.any(np.abs(data.actuator_force[made.arm_actuators]) > arm().torque_limits * (1 + 1e-9)):
            return "a motor beyond its torque" + at, seen
    seen["saturated"] = float(servo.saturations)
    return "", seen


def arm_host_step(step: float) -> Verdict:
    """A motion of a second, then half a second of rest."""
    try:
        made, data, servo, robot = scene(step)
    except ConfigError as error:
        return Verdict("arm_host_step", step, "refused", str(error))
    times = np.linspace(0.0, 1.0, 101)
    ease = times**3 * (10 - 15 * times + 6 * times**2)
    motion = SmoothMotion(times, HOME + ease[:, None] * SHIFT, robot.limits, {"end": 1.0})
    failed, seen = driven(made, data, servo, motion.state, 1.5)
    wanted = arm().tool_pose(HOME + SHIFT).position
    seen["off"] = float(np.linalg.norm(data.xpos[made.tool] - wanted))
    if not failed and seen["off"] > HELD_TO:
        failed = f"the tool {1e3 * seen['off']:.2g} mm off at rest"
    if not failed and seen["fastest_joint"] > 1.0:
        failed = f"a joint at {seen['fastest_joint']:.2g} of its speed limit"
    return verdict_of("arm_host_step", step, failed, seen)


def payload(mass: float) -> Verdict:
    """Home held for a second with a load on the tool: from 14 kg on the motors give in, and the arm sinks."""
    made, data, servo, _ = scene(1e-3)
    still = JointState(HOME, np.zeros(7), np.zeros(7))
    return verdict_of("payload", mass, *driven(made, data, servo, lambda _: still, 1.0, mass))


def targets(kind: str) -> list[Pose]:
    """A short straight path of the tool at the edge of what it can reach."""
    q = {"home": HOME, "stretched": np.array([0.0, 0.9, 0.0, 0.0, 0.0, 0.4, 0.0]),
         "wrist aligned": np.array([0.0, 0.6, 0.0, -1.4, 0.0, 0.0, 0.0]),
         "near a limit": np.array([0.3, 0.5, 0.2, -2.09, 0.1, -1.0, 0.2]),
         "over the shoulder": np.array([0.0, 0.0, 0.0, -1.6, 0.0, -1.0, 0.0]), "beyond reach": HOME}[kind]
    start = arm().tool_pose(q)
    away = np.array([0.9, 0.0, 0.3]) if kind == "beyond reach" else np.zeros(3)
    inward = (np.array([0.0, 0.0, 0.36]) - start.position) / np.linalg.norm(start.position - [0.0, 0.0, 0.36])
    return [Pose(start.position + away + s * inward, start.quaternion) for s in np.linspace(0.0, 0.03, 31)]


def arm_pose(kind: str) -> Verdict:
    """A path of 3 cm in a second from a singular or extreme pose, solved and carried out, or refused by name."""
    path = targets(kind)
    try:
        found = solve_path(arm(), path, [(0, "start"), (len(path) - 1, "end")])
    except UnreachableWaypoint as error:
        return Verdict("arm_pose", kind, "refused", str(error))
    times = np.linspace(0.0, 1.0, len(path))
    try:
        motion = SmoothMotion(times, found.q, load_robot("iiwa14").limits, {"start": 0.0, "end": 1.0})
    except ConfigError as error:
        return Verdict("arm_pose", kind, "refused", str(error))
    speeds = np.array([motion.state(t).qd for t in np.arange(0.0, motion.duration, 1e-3)])
    seen = {"position_error": float(found.errors[:, 0].max()), "margin": found.margin,
            "fastest_joint": float(np.abs(speeds / SPEED_LIMITS).max())}
    failed = ""
    if seen["position_error"] > 1e-6:
        failed = f"{seen['position_error']:.2g} m off"
    elif seen["fastest_joint"] > 1.0 + 1e-9:
        failed = f"a joint at {seen['fastest_joint']:.2g} of its speed limit"
    return verdict_of("arm_pose", kind, failed, seen)


ROBOT_AXES: dict[str, tuple[Callable[..., Verdict], tuple]] = {
    "arm_host_step": (arm_host_step, (1e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2)),
    "payload": (payload, (1.0, 5.0, 14.0, 30.0, 60.0)),
    "arm_pose": (arm_pose, ("home", "stretched", "wrist aligned", "near a limit", "over the shoulder", "beyond reach")),
}
"""Name -> (judge, values)."""
