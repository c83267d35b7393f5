"""The report of a rehearsal: figures, each from the recording, and whether they meet their bounds."""

from typing import NamedTuple

import numpy as np

from mpm.geometry.rigid_motion import Pose
from robosim.config.rehearsal import RehearsalConfig
from robosim.rehearsal.rehearsal import Rehearsal
from robosim.rehearsal.waypoint_path import CommandedPath
from robosim.robot.model import SPEED_LIMITS
from robosim.scene.grain_regions import is_in_container, is_in_tool
from robosim.scene.models import read_inner_size
from robosim.shapes import tool_shape
from robosim.shapes.tool import WALL

G = 9.81
WEIGH_MARGIN = 0.1
"""Time [s] left to the arm to come to rest before the load is weighed."""


class Bound(NamedTuple):
    """Accepted range of one figure."""

    low: float
    high: float


BOUNDS = {
    "delivered_fraction": Bound(0.90, np.inf),
    "spilled_fraction": Bound(0, 0.05),
    "tool_container_contacts": Bound(0, 0),
    "robot_surroundings_contacts": Bound(0, 0),
    "wrist_payload_relative_error": Bound(0, 0.03),
    "momentum_residual": Bound(0, 1e-4),
    "velocity_limit_ratio_max": Bound(0, 1.0),
    "torque_limit_ratio_max": Bound(0, 1.0),
    "joint_limit_ratio_max": Bound(0, 1.0),
    "ik_position_error_max": Bound(0, 1e-5),
    "path_error_inside_max": Bound(0, 2e-3),
    "particles_lost": Bound(0, 0),
}
"""What every rehearsal is expected to keep (SI units)."""
INSIDE, WEIGHED = "path_error_inside_max", "wrist_payload_relative_error"
"""Figures that are None where the tool was in no container, or where nothing is weighed."""


def bounds(config: RehearsalConfig) -> dict[str, Bound]:
    """What this one is expected to keep."""
    return {"scooped_mass": Bound(config.least_load, np.inf),
            **{name: bound for name, bound in BOUNDS.items() if name != WEIGHED or config.weigh_at}}


def figures(run: Rehearsal) -> dict[str, object]:
    """The report's figures as JSON values; SI units, fractions of the scooped mass."""
    positions, config = run.solver.positions(), run.config
    scooped = load(run)
    fate = fates(run, positions)
    rec = run.recording
    arm = run.plan.arm
    middle, half = (arm.upper + arm.lower) / 2, (arm.upper - arm.lower) / 2
    residual, exchanged = rec.array("residual"), rec.array("exchanged").sum(0)
    payload = wrist_payload(run)
    linear = _ratio(np.linalg.norm(residual[:, :3], axis=1).sum(), exchanged[0])
    angular = _ratio(np.linalg.norm(residual[:, 3:], axis=1).sum(), exchanged[1])
    return {
        "material": config.material, "grains": len(positions), "cell": config.field.cell,
        "substep": run.solver.substep, "seed": run.seed, "host_dt": config.host_dt, "coupling": config.coupling,
        "simulated_time": run.time, "wall_time": run.wall_time, "realtime_factor": run.time / max(run.wall_time, 1e-9),
        "scooped_mass": scooped,
        **fate,
        "wrist_payload": payload,
        "wrist_payload_relative_error": None if payload is None else _ratio(abs(payload - scooped), scooped),
        "tool_container_contacts": run.contacts.tool_container_contacts,
        "tool_container_depth": run.contacts.tool_container_depth,
        "robot_surroundings_contacts": run.contacts.robot_surroundings_contacts,
        "momentum_residual": max(linear or 0.0, angular or 0.0),
        "momentum_residual_linear": linear, "momentum_residual_angular": angular,
        "velocity_limit_ratio_max": float((np.abs(rec.array("qd")) / SPEED_LIMITS).max()),
        "torque_limit_ratio_max": float((np.abs(rec.array("demand")) / arm.torque_limits).max()),
        "torque_saturations": run.servo.saturations,
        "joint_limit_ratio_max": float((np.abs(rec.array("q") - middle) / half).max()),
        "ik_position_error_max": float(run.plan.solution.errors[:, 0].max()),
        "tool_tracking_error_max": float(tracking_error(run).max()),
        "path_error_inside_max": path_error_inside(run),
        "motion_stretched_by": run.plan.motion.delay, "trajectory": config.trajectory,
        **learned_figures(run),
        "grasp": config.grasp, "grasp_slip": run.grasp.slip, "grasp_slip_deg": float(np.degrees(run.grasp.slip_angle)),
        "particles_lost": int(rec.sampled("lost").max()),
    }


def learned_figures(run: Rehearsal) -> dict[str, object]:
    """How far the motion is from what was learnt; nothing for a script."""
    path = run.plan.path
    if isinstance(path, CommandedPath):
        return {}
    return {"learned": list(run.config.learned), "played_slower_by": path.slower_by,
            "path_rounded_by": path.rounded_by, "path_kept_clear_by": path.kept_clear_by}


def missed(values: dict[str, object], config: RehearsalConfig) -> list[str]:
    """One line for each figure outside its bound."""
    lines = []
    for name, bound in bounds(config).items():
        value = values[name]
        if name == INSIDE and value is None:
            continue
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


def fates(run: Rehearsal, positions: np.ndarray) -> dict[str, float | None]:
    """What became of the grains that hung in the tool when it was weighed (of all, where none is), as fractions of
    their mass.

    spilled counts every grain of the run that lies outside containers, area and tool, also those spilled while
    scooping.
    """
    mass, config = run.solver.masses(), run.config
    carried = np.full(len(mass), config.weigh_at is None) if run.scooped is None else run.scooped
    nowhere = np.zeros(len(mass), bool)
    place = {name: is_in_container(positions, c, read_inner_size(name)) for name, c in config.containers.items()}
    there = config.area.region.holds(positions) if config.area else place.get(config.sink or "", nowhere)
    back = place.get(config.source or "", nowhere)
    held = is_in_tool(config.tool, positions, run.tool_pose())
    if config.area and config.weigh_at is not None:  # what is still in a tool above the area is not there yet
        there &= ~held
    held &= ~there & ~back
    lying = ~(there | back | held)
    of = mass[carried].sum()
    shares = {"delivered_fraction": there, "returned_fraction": back, "retained_fraction": held}
    result = {name: _ratio(mass[carried & where].sum(), of) for name, where in shares.items()}
    result["spilled_fraction"] = _ratio(mass[lying].sum(), of)
    return result


def load(run: Rehearsal) -> float:
    """Mass [kg] that counts: in the tool when it was weighed, or all there is."""
    at = run.config.weigh_at
    return float(run.solver.masses().sum()) if at is None else _mean_in_tool(run, *weighing(run, at))


def weighing(run: Rehearsal, at: str) -> tuple[float, float]:
    """First and last instant [s] at which the load hangs still at the wrist, at a waypoint."""
    begin, end = run.plan.path.rests[at]
    return begin + run.config.grasp_time + WEIGH_MARGIN, end + run.config.grasp_time


def wrist_payload(run: Rehearsal) -> float | None:
    """Load [kg] from the wrist sensor at rest: force along gravity less the weight of hand and tool; None where nothing
    is weighed."""
    if run.config.weigh_at is None:
        return None
    begin, end = weighing(run, run.config.weigh_at)
    window = run.recording.between(begin, end)
    hand = run.model.body("palm").subtreemass[0]  # the tool's, too, whatever holds it
    # the sensor's sign is that of the child on the parent; at rest only its magnitude along gravity matters
    return float(abs(run.recording.array("wrist")[window, 2].mean()) / G - hand)


def tracking_error(run: Rehearsal) -> np.ndarray:
    """Distance [m] between commanded and reached tool position at each step."""
    return np.linalg.norm(run.recording.array("commanded")[:, :3] - run.recording.array("reached")[:, :3], axis=1)


def path_error_inside(run: Rehearsal) -> float | None:
    """Largest distance [m] of the tool's origin and farthest point from the commanded path about the moment.

    Counts inside containers; None when the tool never was in one.
    """
    head = tool_shape(run.config.tool).head(WALL).vertices
    tip = head[np.linalg.norm(head, axis=1).argmax()]
    worst = None
    for time, r in list(zip(run.recording.array("time"), run.recording.array("reached")))[::2]:
        pose = Pose(r[:3], r[3:])
        if not CommandedPath.inside(pose, run.config):
            continue
        near = run.plan.path.near(time - run.config.grasp_time, tip)
        both = np.concatenate([pose.position, pose.apply(tip[None])[0]])
        distance = np.abs(np.linalg.norm((near - both).reshape(-1, 2, 3), axis=2).max(1)).min()
        worst = max(distance, worst or 0.0)
    return worst
