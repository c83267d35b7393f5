"""Figures of a rehearsal's report, computed from its readings, and the ranges in which they are accepted."""

from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.spatial.transform import Rotation

from robosim.config.rehearsal import RehearsalConfig
from robosim.dosing.command import accepted_error
from robosim.planning.recorded_path import RecordedPath
from robosim.planning.waypoint_path import is_in_container
from robosim.rehearsal.comparison import replay_figures
from robosim.rehearsal.dosing_driver import DosingDriver
from robosim.rehearsal.mass_balance import (
    GRAVITY,
    compute_fractions,
    compute_ratio,
    compute_scooped_mass,
    weigh_at_wrist,
)
from robosim.rehearsal.run import RehearsalRun
from robosim.shapes import tool_shape

PATH_ERROR_STEPS = 2
"""Steps from one comparison with the commanded path to the next."""
PATH_ERROR_WINDOW = 0.05
"""Time [s] before and after a step in which the commanded path is compared with it."""


class Bound(NamedTuple):
    """Accepted range of one figure."""

    low: float
    high: float
    is_optional: bool = False
    """Whether it may be None."""


BOUNDS = {
    "delivered_fraction": Bound(0.90, np.inf),
    "spilled_fraction": Bound(0, 0.05),
    "tool_container_contacts": Bound(0, 0),
    "robot_surroundings_contacts": Bound(0, 0),
    "robot_self_contacts": Bound(0, 0),
    "wrist_payload_relative_error": Bound(0, 0.03),
    "momentum_residual": Bound(0, 1e-4, is_optional=True),  # the grains may touch nothing
    "velocity_limit_ratio_max": Bound(0, 1.0),
    "torque_limit_ratio_max": Bound(0, 1.0),
    "joint_limit_ratio_max": Bound(0, 1.0),
    "ik_position_error_max_m": Bound(0, 1e-5),
    "tool_tracking_error_max_m": Bound(0, 3e-3),
    "path_error_max_m": Bound(0, 3e-3),
    "path_error_inside_max_m": Bound(0, 2e-3, is_optional=True),  # the tool may be in no container
    "wrist_load_ratio_max": Bound(0, 1.0, is_optional=True),  # the robot's file may say no payload
    "grasp_slip_m": Bound(0, 2e-3),
    "set_down_distance_m": Bound(0, 5e-3, is_optional=True),  # the tool may not be set down
    "set_down_tilt_deg": Bound(0, 2.0, is_optional=True),  # the same
    "coupling_missed_fraction": Bound(0, 0.01),
    "particles_lost": Bound(0, 0),
}
"""Bounds of every rehearsal (SI units; a name ends in the unit, if there is one)."""


def get_bounds(config: RehearsalConfig) -> dict[str, Bound]:
    """Return the bounds of one rehearsal.
    They include its least load, and no weighing where it weighs nothing. A dose has the bound of its error in place of
    the delivered fraction: the rest stays in the tool."""
    first, bounds = {"scooped_mass_kg": Bound(config.least_load, np.inf)}, dict(BOUNDS)
    if not config.weigh_at:
        del bounds["wrist_payload_relative_error"]
    if config.dose is not None:
        error = accepted_error(1e-3 * config.dose.target_g)
        del bounds["delivered_fraction"]
        first["dose_error_kg"] = Bound(-error, error)
    return first | bounds


def find_missed(figures: dict[str, object], config: RehearsalConfig) -> list[str]:
    """Describe each figure outside its bound in one line. Returns an empty list where all are within."""
    lines = []
    for name, bound in get_bounds(config).items():
        value = figures[name]
        if bound.is_optional and value is None:
            continue
        if not isinstance(value, (int, float)) or not bound.low <= value <= bound.high:
            shown = f"{value:.5g}" if isinstance(value, float) else value
            lines.append(f"{name} = {shown}; accepted: {bound.low:g} to {bound.high:g}")
    return lines


def compute_figures(run: RehearsalRun) -> dict[str, object]:
    """Compute the report's figures as JSON values; a name ends in the unit; fractions are of the scooped mass."""
    config, plan, path, dosing = run.config, run.plan, run.plan.path, run.dosing
    clearance, approach = plan.clearance, plan.approach
    return {
        "material": config.material, "grains": len(run.solver.masses()), "cell_m": config.field.cell,
        "substep_s": run.solver.substep, "seed": run.seed, "host_dt_s": config.host_dt, "coupling": config.coupling,
        "simulated_time_s": run.time, "wall_time_s": run.wall_time,
        "realtime_factor": run.time / max(run.wall_time, 1e-9),
        **{f"{name}_time_s": seconds for name, seconds in run.timings.items()},
        "awake_share": run.readings.awake_share,
        **_mass_figures(run),
        **_contact_figures(run),
        **_momentum_figures(run),
        **_arm_figures(run),
        "robot": plan.arm.assembly.robot.name, "gripper": plan.arm.assembly.gripper_name,
        "grip_turn_deg": config.grip_turn_deg, "motion_time_scale": plan.time_scale,
        "planned_clearance_m": finite(clearance.surroundings.distance),
        "planned_clearance_between": list(clearance.surroundings.parts),
        "planned_self_clearance_m": finite(clearance.itself.distance),
        **({"approach": f"none: {plan.no_approach}"} if approach is None else {
            "approach": "from home", "approach_time_s": approach.motion.duration,
            "approach_corners": len(approach.motion.corners) - 2,
            "approach_clearance_m": finite(approach.clearance.distance),
            "approach_clearance_between": list(approach.clearance.parts)}),
        "motion_delay_s": plan.motion.delay, "driver": run.driver.name,
        "trajectory": "replay" if run.replay else "driver" if run.driver.is_own else config.trajectory,
        **({} if not isinstance(path, RecordedPath) else {
            "recorded_motions": list(config.recorded), "time_scale": path.time_scale,
            "path_smoothing_deviation_m": path.smoothing_deviation, "path_clearance_shift_m": path.clearance_shift}),
        **({} if run.replay is None else replay_figures(run.replay, run.compare_wrench(), run.plan.arm)),
        "model_errors": None if run.errors is None else run.errors.figures(),
        "grasp": config.grasp, "grasp_slip_m": run.cell.grasp.slip,
        "grasp_slip_deg": float(np.degrees(run.cell.grasp.slip_angle)),
        **_set_down_figures(run),
        **({} if dosing is None else dose_figures(dosing, run.weigh_dose()[0] - dosing.tare,
                                                  float(run.solver.masses()[0]))),
        "particles_lost": int(run.readings.stack_grains("lost").max()),
    }


def _mass_figures(run: RehearsalRun) -> dict[str, object]:
    scooped, payload = compute_scooped_mass(run), weigh_at_wrist(run)
    error = None if payload is None else compute_ratio(abs(payload - scooped), scooped)
    return {"scooped_mass_kg": scooped, **compute_fractions(run, run.solver.positions()), "wrist_payload_kg": payload,
            "wrist_payload_relative_error": error}


def _contact_figures(run: RehearsalRun) -> dict[str, object]:
    """Contacts of tool and containers, with container points inside the tool, and of the robot with all else."""
    contacts, surface = run.cell.contacts, run.surface
    return {"tool_container_contacts": contacts.tool_container_contacts + (surface.penetrations if surface else 0),
            "tool_container_depth_m": surface.depth if surface else 0.0,
            "robot_surroundings_contacts": contacts.robot_surroundings_contacts,
            "robot_self_contacts": contacts.robot_self_contacts}


def _momentum_figures(run: RehearsalRun) -> dict[str, object]:
    """Momentum that no impulse accounts for, relative to all that was exchanged."""
    residual, exchanged = run.readings.stack_steps("residual"), run.readings.stack_steps("exchanged").sum(0)
    linear = compute_ratio(np.linalg.norm(residual[:, :3], axis=1).sum(), exchanged[0])
    angular = compute_ratio(np.linalg.norm(residual[:, 3:], axis=1).sum(), exchanged[1])
    missed = run.readings.stack_steps("is_missed").mean()
    return {"coupling_missed_fraction": float(missed),
            "momentum_residual": max((value for value in (linear, angular) if value is not None), default=None),
            "momentum_residual_linear": linear, "momentum_residual_angular": angular}


def _arm_figures(run: RehearsalRun) -> dict[str, object]:
    """Joints and motors relative to their limits; errors of inverse kinematics and tracking."""
    readings, arm = run.readings, run.plan.arm
    middle, half = (arm.upper + arm.lower) / 2, (arm.upper - arm.lower) / 2
    return {
        "velocity_limit_ratio_max": float((np.abs(readings.stack_steps("qd")) / arm.velocity).max()),
        "torque_limit_ratio_max": float((np.abs(readings.stack_steps("demanded_torque")) / arm.torque_limits).max()),
        "torque_saturations": run.cell.servo.saturations,
        "joint_limit_ratio_max": float((np.abs(readings.stack_steps("q") - middle) / half).max()),
        "ik_position_error_max_m": float(run.plan.solution.errors[:, 0].max()),
        "tool_tracking_error_max_m": float(compute_tracking_errors(run).max()),
        **compute_path_errors(run), "wrist_load_ratio_max": compute_wrist_load(run),
        "robot_sources": arm.assembly.robot.sources,
        "robot_contacts_left_out": [" and ".join(pair) for pair in arm.assembly.robot.touching],
    }


def _set_down_figures(run: RehearsalRun) -> dict[str, object]:
    """Return how far [m] the tool stands in the end from where it was set down, and how much [deg] it leans."""
    if not np.isfinite(run.held_until):
        return {"set_down_distance_m": None, "set_down_tilt_deg": None}
    place, end = run.config.tool_pose(run.config.waypoints[-2]), run.cell.tool_pose()
    upright = place.matrix.T @ np.array([0.0, 0.0, 1.0])
    leaning = np.arccos(np.clip((end.matrix @ upright)[2], -1.0, 1.0))
    return {"set_down_distance_m": float(np.linalg.norm(end.position - place.position)),
            "set_down_tilt_deg": float(np.degrees(leaning))}


def dose_figures(dosing: DosingDriver, mass: float, grain_mass: float) -> dict[str, object]:
    """Return the figures of a dose.
    mass: in the cup at the end of the rehearsal, less the tare [kg]. grain_mass: of a material point [kg], below which
    no error means anything."""
    shown, masses, tilts = (dosing.stack(name) for name in ("shown", "mass", "tilt"))
    seconds = None if dosing.begin is None or dosing.done is None else dosing.done - dosing.begin
    return {
        "dose_target_kg": dosing.target, "dose_kg": mass, "dose_error_kg": mass - dosing.target,
        "dose_relative_error_ratio": (mass - dosing.target) / dosing.target,
        "dose_overshoot_kg": max(float(max(masses.max(initial=0.0), mass)) - dosing.target, 0.0),
        "dose_shown_kg": float(shown[-1]) if len(shown) else None, "dose_grain_mass_kg": grain_mass,
        "dosing_time_s": seconds, "dosing_largest_tilt_deg": float(np.degrees(tilts.max(initial=0.0))),
        "dosing_timed_out": dosing.is_late,
    }


def finite(value: float) -> float | None:
    """Return a value; None for an infinite one, which JSON cannot hold."""
    return value if np.isfinite(value) else None


def compute_tracking_errors(run: RehearsalRun) -> np.ndarray:
    """Compute the tracking errors [m] (n,) of the tool's position at each step; zero while it is not held."""
    commanded, reached = run.readings.stack_steps("commanded"), run.readings.stack_steps("reached")
    times = run.readings.stack_steps("time")
    is_held = (times >= run.held_from) & (times < run.held_until)
    return is_held * np.linalg.norm(commanded[:, :3] - reached[:, :3], axis=1)


def compute_path_errors(run: RehearsalRun) -> dict[str, float | None]:
    """Compute the largest deviations [m] of the tool's origin and of its farthest point from where they should pass.
    Everywhere from the path as it is commanded, with its rounded corners; inside containers, beside that, from the
    waypoints' screws. Each is compared with the path about the same time. The latter figure is None where the tool was
    in no container."""
    tip, window = tool_shape(run.config.tool).tip, round(PATH_ERROR_WINDOW / run.config.host_dt)
    times = run.readings.stack_steps("time")
    commanded, reached = (find_points(run.readings.stack_steps(name), tip) for name in ("commanded", "reached"))
    nearby = sliding_window_view(np.pad(commanded, ((window, window), (0, 0)), "edge"), 2 * window + 1, axis=0)
    first, end = (int(np.searchsorted(times, time)) for time in (run.held_from, run.held_until))
    is_inside, worst, inside = is_in_container(reached[:, :3], run.config), 0.0, None
    for step in range(first, end, PATH_ERROR_STEPS):
        worst = max(worst, find_deviation(nearby[step], reached[step]))
        if is_inside[step] and not run.driver.is_dosing_at(times[step]):
            screws = run.plan.path.sample_near(run.driver.motion_time(times[step]), tip)
            inside = max(inside or 0.0, find_deviation(screws.T, reached[step]))
    return {"path_error_max_m": worst, "path_error_inside_max_m": inside}


def find_points(poses: np.ndarray, tip: np.ndarray) -> np.ndarray:
    """Return the places (n, 6) [m] of a tool's origin and of a point `tip` (3,) of its frame, at poses (n, 7)."""
    rotations = Rotation.from_quat(poses[:, 3:], scalar_first=True)
    return np.hstack([poses[:, :3], poses[:, :3] + rotations.apply(tip)])


def find_deviation(path: np.ndarray, points: np.ndarray) -> float:
    """Return the distance [m] of two points (6,) from the place (6, n) of a path where the farther one is closest."""
    squares = (path - points[:, None]) ** 2
    return float(np.sqrt(np.maximum(squares[:3].sum(0), squares[3:].sum(0)).min()))


def compute_wrist_load(run: RehearsalRun) -> float | None:
    """Compute the largest force at the wrist over the weight that the arm may carry; None where no data sheet says.
    Makers give the largest mass of hand, tool and load. The force of a motion is compared with its weight at twice
    gravity, which an arm that accelerates by 1 g with that load exerts."""
    payload = run.plan.arm.assembly.robot.payload
    if payload is None:
        return None
    force = np.linalg.norm(run.readings.stack_steps("wrist")[:, :3], axis=1).max()
    return float(force / (2.0 * GRAVITY * payload))
