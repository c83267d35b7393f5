"""The report of a rehearsal: figures, each from the recording, and whether they meet their bounds."""

from typing import NamedTuple

import numpy as np

from mpm.motion import Pose
from robosim.arm import SPEED_LIMITS
from robosim.counting import in_container, in_spoon
from robosim.path import CommandedPath
from robosim.rehearsal import Rehearsal

G = 9.81
WEIGH_MARGIN = 0.1
"""Time [s] left to the arm to come to rest before the load is weighed."""
SCREW_SAMPLING = 400
"""Points on each commanded screw that reached positions are compared with."""


class Bound(NamedTuple):
    """Accepted range of one figure."""

    low: float
    high: float


BOUNDS = {
    "scooped_mass": Bound(0.015, np.inf),
    "delivered_fraction": Bound(0.90, np.inf),
    "spilled_fraction": Bound(-np.inf, 0.05),
    "tool_container_contacts": Bound(0, 0),
    "wrist_payload_relative_error": Bound(0, 0.03),
    "momentum_residual_linear": Bound(0, 1e-4),
    "momentum_residual_angular": Bound(0, 1e-4),
    "velocity_limit_ratio_max": Bound(0, 1.0),
    "torque_limit_ratio_max": Bound(0, 1.0),
    "joint_limit_ratio_max": Bound(0, 1.0),
    "ik_position_error_max": Bound(0, 1e-5),
    "path_error_inside_max": Bound(0, 2e-3),
    "particles_lost": Bound(0, 0),
}
"""What a rehearsal is expected to keep (SI units)."""


def figures(run: Rehearsal) -> dict[str, object]:
    """The report's figures as JSON values; SI units, fractions of the scooped mass."""
    positions, config = run.solver.positions(), run.config
    mass = run.solver.masses()
    scooped = _mean_in_tool(run, *weighing(run))
    in_target = mass[in_container(positions, config.containers["target"], run.scene.inner_size("target"))].sum()
    in_source = mass[in_container(positions, config.containers["source"], run.scene.inner_size("source"))].sum()
    retained = mass[in_spoon(positions, run.tool_pose())].sum()
    spilled = mass.sum() - in_target - in_source - retained
    rec = run.recording
    arm = run.plan.arm
    middle, half = (arm.upper + arm.lower) / 2, (arm.upper - arm.lower) / 2
    residual, exchanged = rec.array("residual"), rec.array("exchanged").sum(0)
    payload = wrist_payload(run)
    return {
        "material": config.material, "grains": len(positions), "cell": config.field.cell,
        "substep": run.solver.dt, "host_dt": config.host_dt, "coupling": config.coupling,
        "simulated_time": run.time, "wall_time": run.wall_time, "realtime_factor": run.time / max(run.wall_time, 1e-9),
        "scooped_mass": scooped,
        "delivered_fraction": _ratio(in_target, scooped), "spilled_fraction": _ratio(spilled, scooped),
        "retained_fraction": _ratio(retained, scooped),
        "wrist_payload": payload, "wrist_payload_relative_error": _ratio(abs(payload - scooped), scooped),
        "tool_container_contacts": run.contacts.tool_container,
        "robot_surroundings_contacts": run.contacts.robot_surroundings,
        "momentum_residual_linear": _ratio(np.linalg.norm(residual[:, :3], axis=1).sum(), exchanged[0]),
        "momentum_residual_angular": _ratio(np.linalg.norm(residual[:, 3:], axis=1).sum(), exchanged[1]),
        "velocity_limit_ratio_max": float((np.abs(rec.array("qd")) / SPEED_LIMITS).max()),
        "torque_limit_ratio_max": float((np.abs(rec.array("torque")) / arm.torque_limits).max()),
        "torque_saturations": run.servo.saturated,
        "joint_limit_ratio_max": float((np.abs(rec.array("q") - middle) / half).max()),
        "ik_position_error_max": float(run.plan.solution.errors[:, 0].max()),
        "tool_tracking_error_max": float(tracking_error(run).max()),
        "path_error_inside_max": path_error_inside(run),
        "motion_stretched_by": run.plan.motion.delay,
        "particles_lost": int((~np.isfinite(positions).all(1)).sum() + _outside(run, positions)),
    }


def missed(values: dict[str, object]) -> list[str]:
    """One line for each figure outside its bound."""
    lines = []
    for name, bound in BOUNDS.items():
        value = values[name]
        if not isinstance(value, (int, float)) or not bound.low <= value <= bound.high:
            lines.append(f"{name} = {value}; expected {bound.low:g} to {bound.high:g}")
    return lines


def _ratio(value: float, of: float) -> float | None:
    """value / of, or None where nothing was scooped: a ratio to nothing is no number."""
    return float(value / of) if of > 0 else None


def _mean_in_tool(run: Rehearsal, begin: float, end: float) -> float:
    """Mean mass [kg] counted in the tool between two instants [s]."""
    times = run.recording.sampled("time")
    inside = (times >= begin) & (times < end)
    return float(run.recording.sampled("in_tool")[inside].mean()) if inside.any() else 0.0


def _outside(run: Rehearsal, positions: np.ndarray) -> int:
    """Grains at the sides or the top of the region: the clamp there means that they wanted to leave."""
    grid = run.solver.grid
    lower, upper = np.asarray(grid.lower), np.asarray(grid.lower) + grid.cells * grid.cell
    close = 1e-6
    return int(np.sum(np.any((positions[:, :2] <= lower[:2] + close) | (positions[:, :2] >= upper[:2] - close), axis=1)
                      | (positions[:, 2] >= upper[2] - close)))


def weighing(run: Rehearsal) -> tuple[float, float]:
    """First and last instant [s] at which the load hangs still at the wrist."""
    begin, end = run.plan.path.rests[run.config.weigh_at]
    return begin + run.config.grasp_time + WEIGH_MARGIN, end + run.config.grasp_time


def wrist_payload(run: Rehearsal) -> float:
    """Load [kg] from the wrist sensor at rest: force along gravity less the weight of hand and tool."""
    begin, end = weighing(run)
    window = run.recording.between(begin, end)
    hand = run.model.body("palm").subtreemass[0]
    # the sensor's sign is that of the child on the parent; at rest only its magnitude along gravity matters
    return float(abs(run.recording.array("wrist")[window, 2].mean()) / G - hand)


def tracking_error(run: Rehearsal) -> np.ndarray:
    """Distance [m] between commanded and reached tool position at each step."""
    return np.linalg.norm(run.recording.array("commanded")[:, :3] - run.recording.array("reached")[:, :3], axis=1)


def path_error_inside(run: Rehearsal) -> float:
    """Largest distance [m] of the reached tool position from the commanded screws, inside a container."""
    screws = np.concatenate([_screw_points(run.plan.path, i) for i in range(len(run.plan.path.poses) - 1)])
    reached = run.recording.array("reached")
    inside = [r[:3] for r in reached if CommandedPath.inside(Pose(r[:3], r[3:]), run.config)]
    if not inside:
        return 0.0
    return float(max(np.linalg.norm(screws - p, axis=1).min() for p in inside[::5]))


def _screw_points(path: CommandedPath, leg: int) -> np.ndarray:
    """Positions (n, 3) [m] along one commanded screw."""
    from mpm.motion import exponential, logarithm

    twist = logarithm(path.poses[leg], path.poses[leg + 1])
    return np.array([exponential(path.poses[leg], twist, u).position for u in np.linspace(0, 1, SCREW_SAMPLING)])
