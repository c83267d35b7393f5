"""The arm in extreme cases: large steps of MuJoCo, poses at the edge of its reach, loads beyond its motors."""

from collections.abc import Callable
from functools import lru_cache

import mujoco
import numpy as np

from mpm import Pose
from robosim.cell.cell import Cell
from robosim.robot.inverse_kinematics import solve_path
from robosim.robot.model import Arm
from robosim.robot.timing import JointState, SmoothMotion
from robosim.scene.build import build_scene_spec
from robosim.scene.compiled import compile_scene
from robosim.scene.models import assemble
from robosim.studies.verification.stability.cell import G, Outcome, raise_to

SHIFT = np.array([0.0, 0.35, 0.0, 0.3, 0.2, -0.3, 0.2])
"""Change of the joint angles [rad] (7,) in the one second of the step test."""


@lru_cache
def arm() -> Arm:
    """Return Pinocchio's model of the arm with its tool."""
    return Arm(assemble("spoon"))


def build_cell(host_step: float) -> Cell:
    """Build the arm alone, at rest in its home posture, with its servo; host_step: MuJoCo's [s].
    Raises ConfigError for a step with which the servo would be unstable."""
    made = compile_scene(build_scene_spec(arm().assembly, "weld", {}, host_step, contact=False), arm().assembly)
    return Cell(made, arm(), arm().home, ())


def follow(cell: Cell, target: Callable[[float], JointState], until: float, load: float = 0.0) -> Outcome:
    """Follow joint states until a time [s] with a load [kg] at the tool; return what failed first, and readings."""
    data, readings = cell.data, {"fastest_joint": 0.0, "saturated": 0.0}
    data.xfrc_applied[cell.scene.tool, 2] = -load * G
    while data.time < until:
        cell.command(target(data.time))
        mujoco.mj_step(cell.model, data)
        at = f" at t = {data.time:.4g} s"
        if data.warning[mujoco.mjtWarning.mjWARN_BADQACC].number or not np.all(np.isfinite(data.qpos)):
            return "accelerations beyond MuJoCo's range" + at, readings
        raise_to(readings, fastest_joint=np.abs(cell.qd / arm().velocity).max())
        beyond = np.maximum(cell.q - arm().upper, arm().lower - cell.q).max()
        if beyond > np.radians(1.0):
            return f"a joint {np.degrees(beyond):.2g} degrees beyond its range" + at, readings
        if np.any(np.abs(data.actuator_force[cell.scene.arm_actuators]) > arm().torque_limits * (1 + 1e-9)):
            return "a motor beyond its torque" + at, readings
    readings["saturated"] = float(cell.servo.saturations)
    return "", readings


def arm_host_step(step: float) -> Outcome:
    """Run a motion of a second, then half a second of rest, at MuJoCo steps [s]."""
    cell, times = build_cell(step), np.linspace(0.0, 1.0, 101)
    ease = times**3 * (10 - 15 * times + 6 * times**2)
    q, limits = arm().home + ease[:, None] * SHIFT, arm().step_limits()
    motion = SmoothMotion(times, q, limits, {"end": 1.0}, arm().joints)
    failure, readings = follow(cell, motion.state, 1.5)
    target = arm().tool_pose(arm().home + SHIFT).position
    readings["tool_error_m"] = float(np.linalg.norm(cell.data.xpos[cell.scene.tool] - target))
    if not failure and readings["tool_error_m"] > 1e-3:
        failure = f"the tool {1e3 * readings['tool_error_m']:.2g} mm from its target at rest"
    if not failure and readings["fastest_joint"] > 1.0:
        failure = f"a joint at {readings['fastest_joint']:.2g} of its speed limit"
    return failure, readings


def payload(mass: float) -> Outcome:
    """Hold the home posture for a second with a load [kg] on the tool.
    From 14 kg on the motors saturate, and the arm sinks."""
    still = JointState(arm().home, np.zeros(7), np.zeros(7))
    return follow(build_cell(1e-3), lambda _: still, 1.0, mass)


def arm_pose(kind: str) -> Outcome:
    """Solve and follow a straight path of 3 cm in a second from a singular or extreme pose; it may be refused."""
    q = {"home": arm().home, "stretched": np.array([0.0, 0.9, 0.0, 0.0, 0.0, 0.4, 0.0]),
         "wrist aligned": np.array([0.0, 0.6, 0.0, -1.4, 0.0, 0.0, 0.0]),
         "near a limit": np.array([0.3, 0.5, 0.2, -2.09, 0.1, -1.0, 0.2]),
         "over the shoulder": np.array([0.0, 0.0, 0.0, -1.6, 0.0, -1.0, 0.0]), "beyond reach": arm().home}[kind]
    start = arm().tool_pose(q)
    away = np.array([0.9, 0.0, 0.3]) if kind == "beyond reach" else np.zeros(3)
    inward = (np.array([0.0, 0.0, 0.36]) - start.position) / np.linalg.norm(start.position - [0.0, 0.0, 0.36])
    path = [Pose(start.position + away + s * inward, start.quaternion) for s in np.linspace(0.0, 0.03, 31)]
    solution = solve_path(arm(), path, [(0, "start"), (len(path) - 1, "end")], 1.0 / (len(path) - 1))
    motion = SmoothMotion(np.linspace(0.0, 1.0, len(path)), solution.q, arm().step_limits(), {"start": 0.0, "end": 1.0},
                          arm().joints)
    speeds = np.array([motion.state(t).qd for t in np.arange(0.0, motion.duration, 1e-3)])
    readings = {"position_error_m": float(solution.errors[:, 0].max()), "margin": solution.margin,
                "fastest_joint": float(np.abs(speeds / arm().velocity).max())}
    if readings["position_error_m"] > 1e-6:
        return f"{readings['position_error_m']:.2g} m off", readings
    is_fast = readings["fastest_joint"] > 1.0 + 1e-9
    return f"a joint at {readings['fastest_joint']:.2g} of its speed limit" if is_fast else "", readings


ROBOT_AXES: dict[str, tuple[Callable[..., Outcome], tuple]] = {
    "arm_host_step": (arm_host_step, (1e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2)),
    "payload": (payload, (1.0, 5.0, 14.0, 30.0, 60.0)),
    "arm_pose": (arm_pose, ("home", "stretched", "wrist aligned", "near a limit", "over the shoulder", "beyond reach")),
}
"""Axis -> (function that runs a cell, values)."""
