"""Planning of a rehearsal's motion, before anything is simulated."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from robosim.config.rehearsal_file import RehearsalConfig
from robosim.errors import ConfigError, UnreachableWaypoint
from robosim.rehearsal.planning.learned_path import LearnedPath
from robosim.rehearsal.planning.slower_waypoints import slow_down
from robosim.rehearsal.planning.waypoint_path import WaypointPath
from robosim.robot.joint_path import PathSolution, solve_path
from robosim.robot.model import Arm
from robosim.robot.timing import JointMotion, SmoothMotion, compute_time_scale
from robosim.scene.build import assemble_rehearsal

MAX_SLOWDOWNS = 20
"""Times that a motion is slowed down before it is refused."""
LIMIT_SHARE = 0.92
"""Share of the arm's limits to which a motion is slowed down."""
PATH_SAMPLING = 0.01
"""Time [s] between the poses at which the path is solved for joint angles."""
GRIP_TURNS_DEG = (0.0, 30.0, -30.0, 60.0, -60.0, 90.0, -90.0, 120.0, -120.0, 150.0, -150.0, 180.0)
"""Turns of the tool about its handle in the hand that are tried, in this order."""


class Plan(NamedTuple):
    """The planned motion of a rehearsal."""

    config: RehearsalConfig
    """With what the planner has chosen: the turn of the tool in the hand, and slower waypoints."""
    path: WaypointPath | LearnedPath
    solution: PathSolution
    motion: JointMotion
    arm: Arm
    time_scale: float = 1.0
    """Factor by which all waypoints' times are longer than the file says; of a script."""


def plan_motion(config: RehearsalConfig) -> Plan:
    """Plan the motion of a rehearsal.

    Tool path, joint path, and joint motion within the arm's limits. Where the file leaves it open how the hand holds
    the handle, the turns of GRIP_TURNS_DEG are tried until one can be followed; where none can at full speed, the
    fastest. Learned motions are slowed down where the arm is too slow for them, scripts up to `max_time_scale`. Raises
    ConfigError or UnreachableWaypoint.
    """
    refused: list[ConfigError | UnreachableWaypoint] = []
    slower: list[Plan] = []
    for candidate in choose_grips(config):
        try:
            plan = plan_grip(candidate)
        except (ConfigError, UnreachableWaypoint) as error:
            refused.append(error)
            continue
        if plan.time_scale == 1.0:
            return plan
        slower.append(plan)
    if not slower:
        raise refused[0]
    return min(slower, key=lambda plan: plan.time_scale)


def choose_grips(config: RehearsalConfig) -> Iterator[RehearsalConfig]:
    """Yield the configuration with each turn of the tool in the hand that is to be tried."""
    turns = GRIP_TURNS_DEG if config.grip_turn_deg is None else (config.grip_turn_deg,)
    for turn in turns:
        yield config.model_copy(update={"grip_turn_deg": turn})


def plan_grip(config: RehearsalConfig) -> Plan:
    """Plan the motion with the tool held as the configuration says; errors as of `plan_motion`."""
    arm = Arm(assemble_rehearsal(config))
    limits, scale, reason = arm.limits(config.limits), 1.0, ConfigError("")
    learned = config.trajectory == "learned"
    path = LearnedPath(config) if learned else WaypointPath(config)
    for _ in range(MAX_SLOWDOWNS):
        times, solution = solve_joints(arm, path)
        try:
            motion = SmoothMotion(times, solution.q, limits, path.times, arm.joints)
            return Plan(config, path, solution, motion, arm, scale)
        except ConfigError as error:
            reason = error
        factors = compute_time_scale(times, solution.q, limits) / LIMIT_SHARE
        if isinstance(path, LearnedPath):
            path.slow_down(times, factors)
            continue
        factor = max(1.02, float(factors.max()))
        if scale * factor > config.max_time_scale:
            raise ConfigError(f"{reason}, or allow the whole motion to be played slower (max_time_scale = "
                              f"{config.max_time_scale:g}, needed: {scale * factor:.3g})")
        config, scale = slow_down(config, factor), scale * factor
        path = WaypointPath(config)
    slower = path.time_scale if isinstance(path, LearnedPath) else scale
    raise ConfigError(f"the motion is too fast for the arm even {slower:.1f} times slower: {reason}")


def solve_joints(arm: Arm, path: WaypointPath | LearnedPath) -> tuple[np.ndarray, PathSolution]:
    """Solve a path for joint angles.

    Returns the sampling times [s] (n,) and the solution at them.
    """
    times = np.linspace(0.0, path.duration, int(np.ceil(path.duration / PATH_SAMPLING)) + 1)
    waypoints = [(min(int(np.searchsorted(times, t)), len(times) - 1), name) for name, t in path.times.items()]
    return times, solve_path(arm, [path.pose(t) for t in times], waypoints)
