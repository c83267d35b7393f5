"""Inverse kinematics by damped least squares, under joint limits: of a pose, and of a path with restarts."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import pinocchio

from mpm import Pose
from robosim.base.errors import ConfigError, UnreachableWaypoint
from robosim.robot.model import Arm

TOLERANCE = 1e-7
"""Position [m] and rotation [rad] error at which the iteration ends."""
IDENTITY = np.eye(6)
LIMIT_MARGIN = 1e-4
"""Least distance [rad] of a solution of `solve_pose` from the joint limits."""
TRACKING_LIMIT_MARGIN = 1e-3
"""The same for `step_towards`."""
REST_GAIN = 1e-3
"""Share of the difference to the rest posture by which `step_towards` moves the elbow."""
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


class Solution(NamedTuple):
    """Joint angles [rad] (n,) and the remaining errors [m], [rad]."""

    q: np.ndarray
    position_error: float
    angle_error: float

    @property
    def converged(self) -> bool:
        """Whether both errors are within ten times TOLERANCE."""
        return self.position_error < 10 * TOLERANCE and self.angle_error < 10 * TOLERANCE


class PathSolution(NamedTuple):
    """Joint path and its quality."""

    q: np.ndarray
    """Joint angles (n, joints) [rad]."""
    errors: np.ndarray
    """Position and angle errors (n, 2) [m], [rad]."""
    margin: float
    """Smallest distance to a joint limit [rad]."""


def solve_pose(arm: Arm, target: Pose, start: np.ndarray, rest: np.ndarray | None = None,
               iterations: int = 200) -> Solution:
    """Find joint angles near `start` that put the tool at `target`.
    Takes Levenberg-Marquardt steps from start (n,) [rad]. target: world pose of the tool's frame. The redundant degree
    of freedom draws the posture towards `rest` (n,), by default the arm's home."""
    goal = pinocchio.SE3(target.matrix, np.asarray(target.position, float))
    q, rest = start.copy(), arm.home if rest is None else rest
    error = _compute_error(arm, q, goal)
    for _ in range(iterations):
        size = np.linalg.norm(error)
        if size < TOLERANCE:
            break
        J = arm.jacobian(q)
        damping = 1e-8 + 1e-3 * size**2  # vanishes at the goal, so that convergence stays quadratic
        rest_step = 0.05 * min(1.0, 10 * size) * (rest - q)
        step = rest_step + J.T @ np.linalg.solve(J @ J.T + damping * IDENTITY, error - J @ rest_step)
        step *= min(1.0, 0.3 / np.abs(step).max())
        q = np.clip(q + step, arm.lower + LIMIT_MARGIN, arm.upper - LIMIT_MARGIN)
        error = _compute_error(arm, q, goal)
    return Solution(q, float(np.linalg.norm(error[:3])), float(np.linalg.norm(error[3:])))


def step_towards(arm: Arm, target: Pose, q: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """Take a damped step from q (n,) [rad] towards the tool's slowly moving world pose; returns angles (n,) [rad]."""
    error = _compute_error(arm, q, pinocchio.SE3(target.matrix, np.asarray(target.position, float)))
    J = arm.jacobian(q)
    damping = 1e-6 + 1e-3 * float(error @ error)
    rest_step = REST_GAIN * (rest - q)
    step = rest_step + J.T @ np.linalg.solve(J @ J.T + damping * IDENTITY, error - J @ rest_step)
    step *= min(1.0, 0.1 / max(float(np.abs(step).max()), 1e-12))
    return np.clip(q + step, arm.lower + TRACKING_LIMIT_MARGIN, arm.upper - TRACKING_LIMIT_MARGIN)


def _compute_error(arm: Arm, q: np.ndarray, target: pinocchio.SE3) -> np.ndarray:
    """Twist (6,) in the tool's axes that carries the tool to the target in unit time: linear, angular."""
    return pinocchio.log6(arm.tool_placement(q).actInv(target)).vector


def unreachable(arm: Arm, name: str, target: Pose, solution: Solution) -> UnreachableWaypoint:
    """Return the error of a waypoint's pose that was not reached."""
    return UnreachableWaypoint(name, solution.position_error, np.degrees(solution.angle_error),
                               arm.distance_beyond_reach(target.position))


def solve_path(arm: Arm, targets: list[Pose], waypoints: list[tuple[int, str]], interval: float,
               clearance: Callable[[np.ndarray], float] | None = None) -> PathSolution:
    """Find the best joint path through target poses of the tool.

    Several initial postures are tried, random ones after the arm's home. waypoints: (index into targets, name), for the
    error where no posture works; interval: time [s] between targets. Among the paths that follow all targets without a
    jump, the one with the highest elbow, the most distance to joint limits and the least travel is taken; with a
    clearance, which is the distance [m] of the robot from obstacles and itself in a posture (n,), one that keeps NEAR
    of it goes before others. Raises UnreachableWaypoint, ConfigError."""
    search = _PathSearch(arm, targets, waypoints, clearance)
    for index, name in waypoints:
        search.check_reachable(targets[index], name)
    q, errors = search.follow(range(len(targets)), *search.choose_start(interval))
    if not is_reached(errors).all():
        first = int(np.argmin(is_reached(errors)))
        raise search.unreachable(first, Solution(q[first], *errors[first]))
    q = search.unwind(q)
    return PathSolution(q, errors, arm.margin(q))


def is_reached(errors: np.ndarray) -> np.ndarray:
    """Return which poses with errors (n, 2) [m], [rad] were reached (n,)."""
    return errors.max(1) <= 10 * TOLERANCE


class _PathSearch:
    """Joint paths through target poses, from several initial postures; arguments as of `solve_path`."""

    def __init__(self, arm: Arm, targets: list[Pose], waypoints: list[tuple[int, str]],
                 clearance: Callable[[np.ndarray], float] | None) -> None:
        self._arm, self._targets, self._waypoints, self._clearance = arm, targets, waypoints, clearance
        self._rng = np.random.default_rng(0)

    def check_reachable(self, target: Pose, name: str) -> None:
        """Raise UnreachableWaypoint where no initial posture leads to a waypoint's pose."""
        best = Solution(self._arm.home, np.inf, np.inf)
        for attempt in range(WAYPOINT_RESTARTS):
            solution = solve_pose(self._arm, target, self._start(attempt))
            if solution.converged:
                return
            if solution.position_error + solution.angle_error < best.position_error + best.angle_error:
                best = solution
        raise unreachable(self._arm, name, target, best)

    def unreachable(self, index: int, solution: Solution) -> UnreachableWaypoint:
        """Return the error of a target that was not reached, named by the next waypoint."""
        name = next((n for i, n in self._waypoints if i >= index), self._waypoints[-1][1])
        return unreachable(self._arm, name, self._targets[index], solution)

    def choose_start(self, interval: float) -> tuple[np.ndarray, np.ndarray]:
        """Joint angles (joints,) of the first target, and those to rest at, with which a coarse path is followed best.
        A redundant arm is drawn to its home in every second attempt, in the others to its first posture."""
        arm, count = self._arm, len(self._targets)
        coarse = sorted({*range(0, count, max(1, count // COARSE_SAMPLES)), *[i for i, _ in self._waypoints]})
        best, jumps, furthest, closest = None, 0, -1, Solution(arm.home, np.inf, np.inf)
        for attempt in range(MAX_RESTARTS):
            first = solve_pose(arm, self._targets[0], self._start(attempt))
            if not first.converged:
                continue
            rest = arm.home if attempt % 2 == 0 else first.q
            q, errors = self.follow(coarse, first.q, rest, whole=False)
            if not is_reached(errors).all():  # the last one is the first that is not
                if coarse[len(q) - 1] > furthest:
                    furthest, closest = coarse[len(q) - 1], Solution(q[-1], *errors[-1])
                continue
            travel = np.abs(np.diff(q, axis=0)) / arm.velocity
            if np.any(travel.max(1) > MAX_JUMP + interval * np.diff(coarse)):
                jumps += 1
                continue
            score = self._rate(q, travel)
            if best is None or score > best[0]:
                best = (score, first.q, rest)
            if attempt >= MIN_RESTARTS:
                break
        if best is None and jumps:
            raise ConfigError(f"no posture was found from which the arm follows the path to waypoint "
                              f"{self._waypoints[-1][1]!r} without a jump of its joints, in {MAX_RESTARTS} attempts "
                              f"({jumps} with one); move the waypoints, or let the planner turn the tool in the hand "
                              f"(grip_turn_deg)")
        if best is None:
            raise self.unreachable(max(furthest, 0), closest)
        return best[1:]

    def follow(self, indices: Sequence[int], q: np.ndarray, rest: np.ndarray,
               whole: bool = True) -> tuple[np.ndarray, np.ndarray]:
        """Solve targets that follow closely on one another, each from the solution before, the first from q (joints,).
        rest: joint angles [rad] that a redundant arm is drawn to. whole: whether to go on from a target that is not
        reached. Returns joint angles (n, joints) and errors (n, 2) [m], [rad]."""
        angles, errors = [], []
        for index in indices:
            solution = solve_pose(self._arm, self._targets[index], q, rest)
            q = solution.q
            angles.append(q)
            errors.append((solution.position_error, solution.angle_error))
            if not (whole or solution.converged):
                break
        return np.array(angles), np.array(errors)

    def unwind(self, q: np.ndarray) -> np.ndarray:
        """Return a joint path (n, joints) [rad] shifted by whole turns of joints, so that it begins nearest to home.
        Postures are the same; an arm that comes from home need not turn a joint all around first."""
        q, arm = q.copy(), self._arm
        for k, name in enumerate(arm.joints):
            if name in arm.assembly.robot.slides:
                continue
            turns = 2.0 * np.pi * np.arange(-2, 3)
            margins = np.minimum(q[:, k].min() + turns - arm.lower[k], arm.upper[k] - q[:, k].max() - turns)
            allowed = turns[margins >= min(margins[2], UNWOUND_MARGIN)]
            q[:, k] += allowed[np.argmin(np.abs(q[0, k] + allowed - arm.home[k]))]
        return q

    def _rate(self, q: np.ndarray, travel: np.ndarray) -> float:
        """Score of a joint path (n, joints): elbow height [m], margin to limits [rad], less travel (n - 1, joints) [s].
        What is missing of a clearance of NEAR [m] counts a hundredfold."""
        elbow = np.mean([self._arm.elbow_height(x) for x in q[:: max(1, len(q) // 8)]])
        missing = 0.0
        if self._clearance is not None:
            missing = max(0.0, NEAR - min(self._clearance(x) for x in q[:: max(1, len(q) // RATED_POSTURES)]))
        return elbow + min(self._arm.margin(q), 0.3) - 0.02 * travel.max(1).sum() - 100.0 * missing

    def _start(self, attempt: int) -> np.ndarray:
        """Joint angles (joints,) [rad] to begin an attempt with: home, then random ones away from the limits."""
        arm = self._arm
        if attempt == 0:
            return arm.home
        middle, half = 0.5 * (arm.upper + arm.lower), 0.5 * (arm.upper - arm.lower)
        return middle + 0.8 * half * self._rng.uniform(-1.0, 1.0, len(half))
