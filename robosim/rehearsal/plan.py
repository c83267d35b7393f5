"""Planning of a rehearsal's motion, before anything is simulated."""

from typing import NamedTuple

import numpy as np

from robosim.config.rehearsal import RehearsalConfig
from robosim.errors import ConfigError
from robosim.rehearsal.paths.learned_path import LearnedPath
from robosim.rehearsal.paths.waypoint_path import WaypointPath
from robosim.robot.joint_path import PathSolution, solve_path
from robosim.robot.model import Arm
from robosim.robot.timing import JointMotion, SmoothMotion, compute_time_scale
from robosim.scene.build import assemble_rehearsal

MAX_SLOWDOWNS = 20
"""Times that a learned motion is slowed down before it is refused."""
LIMIT_SHARE = 0.92
"""Share of the arm's limits to which a learned motion is slowed down."""
PATH_SAMPLING = 0.01
"""Time [s] between the poses at which the path is solved for joint angles."""


class Plan(NamedTuple):
    """The planned motion of a rehearsal."""

    path: WaypointPath | LearnedPath
    solution: PathSolution
    motion: JointMotion
    arm: Arm


def plan_motion(config: RehearsalConfig) -> Plan:
    """Plan the motion of a rehearsal.

    Tool path, joint path, and joint motion within the arm's limits. Learned motions are slowed down where the arm is
    too slow for them. Raises ConfigError or UnreachableWaypoint.
    """
    arm = Arm(assemble_rehearsal(config))
    limits = arm.limits(config.limits)
    if config.trajectory == "script":
        path = WaypointPath(config)
        times, solution = solve_joints(arm, path)
        return Plan(path, solution, SmoothMotion(times, solution.q, limits, path.times, arm.joints), arm)
    path, reason = LearnedPath(config), None
    for _ in range(MAX_SLOWDOWNS):
        times, solution = solve_joints(arm, path)
        try:
            return Plan(path, solution, SmoothMotion(times, solution.q, limits, path.times, arm.joints), arm)
        except ConfigError as error:
            reason = error
        path.slow_down(times, compute_time_scale(times, solution.q, limits) / LIMIT_SHARE)
    raise ConfigError(f"the learned motion is too fast for the arm even {path.time_scale:.1f} times slower: {reason}")


def solve_joints(arm: Arm, path: WaypointPath | LearnedPath) -> tuple[np.ndarray, PathSolution]:
    """Solve a path for joint angles.

    Returns the sampling times [s] (n,) and the solution at them.
    """
    times = np.linspace(0.0, path.duration, int(np.ceil(path.duration / PATH_SAMPLING)) + 1)
    waypoints = [(min(int(np.searchsorted(times, t)), len(times) - 1), name) for name, t in path.times.items()]
    return times, solve_path(arm, [path.pose(t) for t in times], waypoints)
