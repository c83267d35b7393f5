"""Joint path through a sequence of tool poses, by inverse kinematics with restarts."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from mpm import Pose
from robosim.base.errors import ConfigError, UnreachableWaypoint
from robosim.robot.inverse_kinematics import TOLERANCE, Solution, solve_pose
from robosim.robot.model import Arm

MAX_RESTARTS, MIN_RESTARTS = 60, 12
"""Initial postures tried at most, and those after which the best path so far is taken."""
MAX_JUMP = 0.6
"""Time [s] that a joint at full speed may need between two coarse samples of a path beyond the time between them; more
is a jump."""
WAYPOINT_RESTARTS = 25
"""Initial postures tried before a waypoint counts as unreachable."""
NEAR = 0.02
"""Distance [m] from obstacles below which other postures are preferred."""
RATED_POSTURES = 15
"""Postures of a path whose clearance is measured to compare it with others."""
UNWOUND_MARGIN = 0.3
"""Distance [rad] from its limits that a joint keeps when it is turned nearer to home, if it had it before."""
COARSE_SAMPLES = 60
"""Samples of a path at which initial postures are compared."""


class PathSolution(NamedTuple):
    """Joint path and its quality."""

    q: np.ndarray
    """Joint angles (n, joints) [rad]."""
    errors: np.ndarray
    """Position and angle errors (n, 2) [m], [rad]."""
    margin: float
    """Smallest distance to a joint limit [rad]."""


def solve_path(arm: Arm, targets: list[Pose], waypoints: list[tuple[int, str]], interval: float, seed: int = 0,
               clearance: Callable[[np.ndarray], float] | None = None) -> PathSolution:
    """Find the best joint path through target poses of the tool.

    Several initial postures are tried, random ones after the arm's home. waypoints: (index into targets, name), for the
    error where no posture works; interval: time [s] between targets. Among the paths that follow all targets without a
    jump, the one with the highest elbow, the most distance to joint limits and the least travel is taken; with a
    clearance, which is the distance [m] of the robot from obstacles and itself in a posture (n,), one that keeps NEAR
    of it goes before others. Raises UnreachableWaypoint, ConfigError.
    """
    rng = np.random.default_rng(seed)
    for index, name in waypoints:
        _check_reachable(arm, targets[index], name, rng)
    start, rest = _choose_start(arm, targets, waypoints, interval, rng, clearance)
    q, errors = follow_path(arm, targets, start, rest)
    bad = np.flatnonzero(errors.max(1) > 10 * TOLERANCE)
    if len(bad):
        first = int(bad[0])
        raise _unreachable(arm, targets, waypoints, first, Solution(q[first], *errors[first]))
    q = unwind(arm, q)
    return PathSolution(q, errors, float(np.minimum(q - arm.lower, arm.upper - q).min()))


def unwind(arm: Arm, q: np.ndarray) -> np.ndarray:
    """Return a joint path (n, joints) [rad] shifted by whole turns of joints that have them, to begin nearest to home.

    Postures are the same; an arm that comes from home need not turn a joint all around first.
    """
    q = q.copy()
    for k, name in enumerate(arm.joints):
        if name in arm.assembly.robot.slides:
            continue
        turns = 2.0 * np.pi * np.arange(-2, 3)
        margins = np.minimum(q[:, k].min() + turns - arm.lower[k], arm.upper[k] - q[:, k].max() - turns)
        allowed = turns[margins >= min(margins[2], UNWOUND_MARGIN)]
        q[:, k] += allowed[np.argmin(np.abs(q[0, k] + allowed - arm.home[k]))]
    return q


def follow_path(arm: Arm, targets: list[Pose], start: np.ndarray, rest: np.ndarray | None = None,
                whole: bool = True) -> tuple[np.ndarray, np.ndarray]:
    """Solve densely sampled target poses, each from the solution before.

    start: initial joint angles (joints,) [rad]. rest: those that a redundant arm is drawn to. whole: whether to go on
    from a target that is not reached. Returns joint angles (n, joints) and errors (n, 2) [m], [rad].
    """
    angles, errors, q = [], [], start
    for target in targets:
        solution = solve_pose(arm, target, q, rest)
        q = solution.q
        angles.append(q)
        errors.append((solution.position_error, solution.angle_error))
        if not (whole or solution.converged):
            break
    return np.array(angles), np.array(errors)


def _choose_start(
    arm: Arm, targets: list[Pose], waypoints: list[tuple[int, str]], interval: float, rng: np.random.Generator,
    clearance: Callable[[np.ndarray], float] | None,
) -> tuple[np.ndarray, np.ndarray]:
    """Joint angles (joints,) of the first target, and those to rest at, with which a coarse path is followed best.

    A redundant arm is drawn to its home in every second attempt, in the others to its first posture.
    """
    stride = max(1, len(targets) // COARSE_SAMPLES)
    coarse = sorted({*range(0, len(targets), stride), *[i for i, _ in waypoints]})
    best, jumps, furthest, closest = None, 0, -1, Solution(arm.home, np.inf, np.inf)
    for attempt in range(MAX_RESTARTS):
        first = solve_pose(arm, targets[0], arm.home if attempt == 0 else _draw_posture(arm, rng))
        if not first.converged:
            continue
        rest = arm.home if attempt % 2 == 0 else first.q
        q, errors = follow_path(arm, [targets[i] for i in coarse], first.q, rest, whole=False)
        bad = np.flatnonzero(errors.max(1) > 10 * TOLERANCE)
        if len(bad):
            if coarse[bad[0]] > furthest:
                furthest, closest = coarse[bad[0]], Solution(q[bad[0]], *errors[bad[0]])
            continue
        travel = np.abs(np.diff(q, axis=0)) / arm.velocity
        if np.any(travel.max(1) > MAX_JUMP + interval * np.diff(coarse)):
            jumps += 1
            continue
        score = _rate_path(arm, q, travel, clearance)
        if best is None or score > best[0]:
            best = (score, first.q, rest)
        if attempt >= MIN_RESTARTS:
            break
    if best is None and jumps:
        raise ConfigError(f"no posture was found from which the arm follows the path to waypoint {waypoints[-1][1]!r} "
                          f"without a jump of its joints, in {MAX_RESTARTS} attempts ({jumps} with one); move the "
                          f"waypoints, or let the planner turn the tool in the hand (grip_turn_deg)")
    if best is None:
        raise _unreachable(arm, targets, waypoints, max(furthest, 0), closest)
    return best[1:]


def _rate_path(arm: Arm, q: np.ndarray, travel: np.ndarray, clearance: Callable[[np.ndarray], float] | None) -> float:
    """Score of a joint path (n, joints): elbow height [m], margin to limits [rad], less travel (n - 1, joints) [s].

    What is missing of a clearance of NEAR [m] counts a hundredfold.
    """
    margin = float(np.minimum(q - arm.lower, arm.upper - q).min())
    elbow = np.mean([arm.elbow_height(x) for x in q[:: max(1, len(q) // 8)]])
    missing = 0.0
    if clearance is not None:
        missing = max(0.0, NEAR - min(clearance(x) for x in q[:: max(1, len(q) // RATED_POSTURES)]))
    return elbow + min(margin, 0.3) - 0.02 * travel.max(1).sum() - 100.0 * missing


def _check_reachable(arm: Arm, target: Pose, name: str, rng: np.random.Generator) -> None:
    """Raise UnreachableWaypoint where no initial posture leads to a waypoint's pose."""
    best = Solution(arm.home, np.inf, np.inf)
    for attempt in range(WAYPOINT_RESTARTS):
        solution = solve_pose(arm, target, arm.home if attempt == 0 else _draw_posture(arm, rng))
        if solution.converged:
            return
        if solution.position_error + solution.angle_error < best.position_error + best.angle_error:
            best = solution
    raise UnreachableWaypoint(name, best.position_error, np.degrees(best.angle_error),
                              arm.distance_beyond_reach(target.position))


def _unreachable(arm: Arm, targets: list[Pose], waypoints: list[tuple[int, str]], index: int,
                 solution: Solution) -> UnreachableWaypoint:
    """The error of a target that was not reached, named by the next waypoint."""
    name = next((n for i, n in waypoints if i >= index), waypoints[-1][1])
    return UnreachableWaypoint(name, solution.position_error, np.degrees(solution.angle_error),
                               arm.distance_beyond_reach(targets[index].position))


def _draw_posture(arm: Arm, rng: np.random.Generator) -> np.ndarray:
    """Random joint angles (joints,) [rad] away from the limits."""
    middle, half = 0.5 * (arm.upper + arm.lower), 0.5 * (arm.upper - arm.lower)
    return middle + 0.8 * half * rng.uniform(-1.0, 1.0, len(half))
