"""Figures of a rehearsal's report, computed from its readings, and the ranges in which they are accepted."""

from typing import NamedTuple

import numpy as np

from mpm.geometry.rigid_motion import Pose
from robosim.config.rehearsal_file import RehearsalConfig
from robosim.rehearsal.mass_balance import compute_fractions, compute_ratio, compute_scooped_mass, weigh_at_wrist
from robosim.rehearsal.planning.learned_path import LearnedPath
from robosim.rehearsal.planning.waypoint_path import is_in_container
from robosim.rehearsal.replay.comparison import replay_figures
from robosim.rehearsal.run import RehearsalRun
from robosim.shapes import tool_shape
from robosim.shapes.tool import WALL

PATH_ERROR_STRIDE = 2
"""Steps from one comparison with the commanded path to the next."""


class Bound(NamedTuple):
    """Accepted range of one figure."""

    low: float
    high: float


BOUNDS = {
    "delivered_fraction": Bound(0.90, np.inf),
    "spilled_fraction": Bound(0, 0.05),
    "tool_container_contacts": Bound(0, 0),
    "robot_surroundings_contacts": Bound(0, 0),
    "robot_self_contacts": Bound(0, 0),
    "wrist_payload_relative_error": Bound(0, 0.03),
    "momentum_residual": Bound(0, 1e-4),
    "velocity_limit_ratio_max": Bound(0, 1.0),
    "torque_limit_ratio_max": Bound(0, 1.0),
    "joint_limit_ratio_max": Bound(0, 1.0),
    "ik_position_error_max_m": Bound(0, 1e-5),
    "path_error_inside_max_m": Bound(0, 2e-3),
    "particles_lost": Bound(0, 0),
}
"""Bounds of every rehearsal (SI units; a name ends in the unit, if there is one)."""
PATH_ERROR_INSIDE = "path_error_inside_max_m"
"""The figure that is None where the tool was in no container."""
WRIST_ERROR = "wrist_payload_relative_error"
"""The figure that is None where nothing is weighed."""


def get_bounds(config: RehearsalConfig) -> dict[str, Bound]:
    """Return the bounds of one rehearsal.

    They include its least load, and no weighing where it weighs nothing.
    """
    return {"scooped_mass_kg": Bound(config.least_load, np.inf),
            **{name: bound for name, bound in BOUNDS.items() if name != WRIST_ERROR or config.weigh_at}}


def find_missed(figures: dict[str, object], config: RehearsalConfig) -> list[str]:
    """Describe each figure outside its bound in one line.

    Returns an empty list where all are within.
    """
    lines = []
    for name, bound in get_bounds(config).items():
        value = figures[name]
        if name == PATH_ERROR_INSIDE and value is None:
            continue
        if not isinstance(value, (int, float)) or not bound.low <= value <= bound.high:
            lines.append(f"{name} = {value}; accepted: {bound.low:g} to {bound.high:g}")
    return lines


def compute_figures(run: RehearsalRun) -> dict[str, object]:
    """Compute the report's figures as JSON values.

    A name ends in the unit, if the figure has one. Fractions are of the scooped mass.
    """
    config, positions = run.config, run.solver.positions()
    return {
        "material": config.material, "grains": len(positions), "cell_m": config.field.cell,
        "substep_s": run.solver.substep, "seed": run.seed, "host_dt_s": config.host_dt, "coupling": config.coupling,
        "simulated_time_s": run.time, "wall_time_s": run.wall_time,
        "realtime_factor": run.time / max(run.wall_time, 1e-9),
        **{f"{name}_time_s": seconds for name, seconds in run.timings.items()},
        "awake_share": run.readings.awake_share,
        **_mass_figures(run, positions),
        "tool_container_contacts": run.collisions.tool_container_contacts,
        "tool_container_depth_m": run.collisions.tool_container_depth,
        "robot_surroundings_contacts": run.collisions.robot_surroundings_contacts,
        "robot_self_contacts": run.collisions.robot_self_contacts,
        **_momentum_figures(run),
        **_arm_figures(run),
        "robot": run.plan.arm.assembly.robot.name, "gripper": run.plan.arm.assembly.gripper_name,
        "grip_turn_deg": run.config.grip_turn_deg, "motion_time_scale": run.plan.time_scale,
        "motion_delay_s": run.plan.motion.delay, "trajectory": "recorded" if run.replay else config.trajectory,
        **_learned_path_figures(run), **_replay_figures(run),
        "model_errors": None if run.errors is None else run.errors.figures(),
        "grasp": config.grasp, "grasp_slip_m": run.grasp.slip,
        "grasp_slip_deg": float(np.degrees(run.grasp.slip_angle)),
        "particles_lost": int(run.readings.stack_grains("lost").max()),
    }


def _mass_figures(run: RehearsalRun, positions: np.ndarray) -> dict[str, object]:
    scooped, payload = compute_scooped_mass(run), weigh_at_wrist(run)
    error = None if payload is None else compute_ratio(abs(payload - scooped), scooped)
    return {"scooped_mass_kg": scooped, **compute_fractions(run, positions), "wrist_payload_kg": payload,
            "wrist_payload_relative_error": error}


def _momentum_figures(run: RehearsalRun) -> dict[str, object]:
    """Momentum that no impulse accounts for, relative to all that was exchanged."""
    residual, exchanged = run.readings.stack_steps("residual"), run.readings.stack_steps("exchanged").sum(0)
    linear = compute_ratio(np.linalg.norm(residual[:, :3], axis=1).sum(), exchanged[0])
    angular = compute_ratio(np.linalg.norm(residual[:, 3:], axis=1).sum(), exchanged[1])
    return {"momentum_residual": max(linear or 0.0, angular or 0.0), "momentum_residual_linear": linear,
            "momentum_residual_angular": angular}


def _arm_figures(run: RehearsalRun) -> dict[str, object]:
    """Joints and motors relative to their limits; errors of inverse kinematics and tracking."""
    readings, arm = run.readings, run.plan.arm
    middle, half = (arm.upper + arm.lower) / 2, (arm.upper - arm.lower) / 2
    return {
        "velocity_limit_ratio_max": float((np.abs(readings.stack_steps("qd")) / arm.velocity).max()),
        "torque_limit_ratio_max": float((np.abs(readings.stack_steps("demanded_torque")) / arm.torque_limits).max()),
        "torque_saturations": run.servo.saturations,
        "joint_limit_ratio_max": float((np.abs(readings.stack_steps("q") - middle) / half).max()),
        "ik_position_error_max_m": float(run.plan.solution.errors[:, 0].max()),
        "tool_tracking_error_max_m": float(compute_tracking_errors(run).max()),
        "path_error_inside_max_m": compute_path_error_inside(run),
    }


def _learned_path_figures(run: RehearsalRun) -> dict[str, object]:
    """Differences from the learned motions; empty for a script."""
    path = run.plan.path
    if not isinstance(path, LearnedPath):
        return {}
    return {"learned": list(run.config.learned), "time_scale": path.time_scale,
            "path_smoothing_deviation_m": path.smoothing_deviation, "path_clearance_shift_m": path.clearance_shift}


def _replay_figures(run: RehearsalRun) -> dict[str, object]:
    """Differences of a recording from plan and simulation; empty without one."""
    return {} if run.replay is None else replay_figures(run.replay, run.compare_wrench(), run.plan.arm)


def compute_tracking_errors(run: RehearsalRun) -> np.ndarray:
    """Compute the tracking errors [m] (n,) of the tool's position at each step."""
    commanded, reached = run.readings.stack_steps("commanded"), run.readings.stack_steps("reached")
    return np.linalg.norm(commanded[:, :3] - reached[:, :3], axis=1)


def compute_path_error_inside(run: RehearsalRun) -> float | None:
    """Compute the largest deviation [m] from the commanded path inside containers.

    Both the tool's origin and its farthest point are compared with the path about the same time. None where the tool
    was in no container.
    """
    head = tool_shape(run.config.tool).head(WALL).vertices
    tip = head[np.linalg.norm(head, axis=1).argmax()]
    times, reached = run.readings.stack_steps("time"), run.readings.stack_steps("reached")
    worst = None
    for time, row in list(zip(times, reached))[::PATH_ERROR_STRIDE]:
        pose = Pose(row[:3], row[3:])
        if not is_in_container(pose, run.config):
            continue
        commanded = run.plan.path.sample_near(time - run.config.grasp_time, tip)
        measured = np.concatenate([pose.position, pose.apply(tip[None])[0]])
        distances = np.linalg.norm((commanded - measured).reshape(-1, 2, 3), axis=2).max(1)
        worst = max(distances.min(), worst or 0.0)
    return worst
