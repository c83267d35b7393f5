"""Inverse kinematics by damped least squares, under joint limits, with restarts."""

from typing import NamedTuple

import numpy as np
import pinocchio

from mpm import Pose
from robosim.errors import UnreachableWaypoint
from robosim.robot.model import REACH, SPEED_LIMITS, Arm

TOLERANCE = 1e-7
"""Position [m] and rotation [rad] error at which a solution counts."""
RESTARTS, ENOUGH_RESTARTS = 60, 12
"""Postures that the path is followed from at most, and those after which the best one found is taken."""
MAX_JUMP = 0.6
"""Longest time [s] that a joint at full speed may need between two coarse samples of a path; more is a jump."""
WAYPOINT_RESTARTS = 25
"""Postures tried before a waypoint counts as unreachable."""
SHOULDER = np.array([0.0, 0.0, 0.36])
UNIT = np.eye(6)
DRAW = 1e-3
"""Share of the way to its rest posture that the elbow is drawn in a step."""
HOME = np.radians([0.0, 45.0, 0.0, -95.0, 0.0, -50.0, 0.0])
"""Posture that free motion of the elbow is drawn to: elbow up, hand forward."""


class Solution(NamedTuple):
    """Joint angles [rad] (7,) and the remaining errors [m], [rad]."""

    q: np.ndarray
    position_error: float
    angle_error: float

    @property
    def converged(self) -> bool:
        return self.position_error < 10 * TOLERANCE and self.angle_error < 10 * TOLERANCE


def _error(arm: Arm, q: np.ndarray, target: pinocchio.SE3) -> np.ndarray:
    """Twist (6,) in the tool's axes that carries the tool to the target in unit time."""
    return pinocchio.log6(arm.placement(q).actInv(target)).vector


def solve(arm: Arm, target: Pose, start: np.ndarray, rest: np.ndarray = HOME, iterations: int = 200) -> Solution:
    """Closest joint angles to `start` that put the tool at `target`, by Levenberg-Marquardt steps.

    The free motion of the elbow is spent on drawing the posture towards `rest`.
    """
    goal = pinocchio.SE3(target.matrix, np.asarray(target.position, float))
    q, margin = start.copy(), 1e-4
    error = _error(arm, q, goal)
    for _ in range(iterations):
        size = np.linalg.norm(error)
        if size < TOLERANCE:
            break
        J = arm.jacobian(q)
        damping = 1e-8 + 1e-3 * size**2  # vanishes at the goal: convergence stays quadratic
        free = 0.05 * min(1.0, 10 * size) * (rest - q)
        step = free + J.T @ np.linalg.solve(J @ J.T + damping * UNIT, error - J @ free)
        step *= min(1.0, 0.3 / np.abs(step).max())
        trial = np.clip(q + step, arm.lower + margin, arm.upper - margin)
        error = _error(arm, trial, goal)
        q = trial
    return Solution(q, float(np.linalg.norm(error[:3])), float(np.linalg.norm(error[3:])))


def step_towards(arm: Arm, target: Pose, q: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """Joint angles (7,) one damped step nearer to a target that moves little from call to call."""
    error = _error(arm, q, pinocchio.SE3(target.matrix, np.asarray(target.position, float)))
    J = arm.jacobian(q)
    damping = 1e-6 + 1e-3 * float(error @ error)
    free = DRAW * (rest - q)
    step = free + J.T @ np.linalg.solve(J @ J.T + damping * UNIT, error - J @ free)
    step *= min(1.0, 0.1 / max(float(np.abs(step).max()), 1e-12))
    return np.clip(q + step, arm.lower + 1e-3, arm.upper - 1e-3)


def follow(arm: Arm, targets: list[Pose], start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Joint angles (n, 7) along a densely sampled path and the errors (n, 2) [m], [rad], each solved from the last."""
    angles, errors, q = [], [], start
    for target in targets:
        solution = solve(arm, target, q)
        q = solution.q
        angles.append(q)
        errors.append((solution.position_error, solution.angle_error))
    return np.array(angles), np.array(errors)


class PathSolution(NamedTuple):
    """Joint path (n, 7) [rad] and its quality: errors (n, 2), smallest distance to a joint limit [rad]."""

    q: np.ndarray
    errors: np.ndarray
    margin: float


def solve_path(arm: Arm, targets: list[Pose], names: list[tuple[int, str]], seed: int = 0) -> PathSolution:
    """Best joint path through the targets among restarts from random postures.

    names: (index into targets, waypoint name), for the error when no posture works. Among the paths that follow all
    targets without a jump, the one with the highest elbow, the most room to joint limits and the least travel is taken.
    """
    rng = np.random.default_rng(seed)
    for index, name in names:
        _check_reachable(arm, targets[index], name, rng)
    coarse = sorted({*range(0, len(targets), max(1, len(targets) // 60)), *[i for i, _ in names]})
    best, furthest, closest = None, -1, Solution(HOME, np.inf, np.inf)
    for attempt in range(RESTARTS):
        first = solve(arm, targets[0], HOME if attempt == 0 else _random_posture(arm, rng))
        if not first.converged:
            continue
        q, errors = follow(arm, [targets[i] for i in coarse], first.q)
        bad = np.flatnonzero(errors.max(1) > 10 * TOLERANCE)
        if len(bad):
            if coarse[bad[0]] > furthest:
                furthest, closest = coarse[bad[0]], Solution(q[bad[0]], *errors[bad[0]])
            continue
        margin = float(np.minimum(q - arm.lower, arm.upper - q).min())
        travel = np.abs(np.diff(q, axis=0)) / SPEED_LIMITS
        elbow = np.mean([arm.elbow_height(x) for x in q[:: max(1, len(q) // 8)]])
        if travel.max() > MAX_JUMP:
            continue
        score = elbow + min(margin, 0.3) - 0.02 * travel.max(1).sum()
        if best is None or score > best[0]:
            best = (score, first.q)
        if attempt >= ENOUGH_RESTARTS:
            break
    if best is None:
        index = max(furthest, 0)
        name = next((n for i, n in names if i >= index), names[-1][1])
        raise UnreachableWaypoint(name, closest.position_error, np.degrees(closest.angle_error),
                                  _beyond_reach(targets[index]))
    q, errors = follow(arm, targets, best[1])
    bad = np.flatnonzero(errors.max(1) > 10 * TOLERANCE)
    if len(bad):
        name = next((n for i, n in names if i >= bad[0]), names[-1][1])
        first = int(bad[0])
        raise UnreachableWaypoint(name, errors[first, 0], np.degrees(errors[first, 1]), _beyond_reach(targets[first]))
    return PathSolution(q, errors, float(np.minimum(q - arm.lower, arm.upper - q).min()))


def _check_reachable(arm: Arm, target: Pose, name: str, rng: np.random.Generator) -> None:
    """Raise UnreachableWaypoint when no start leads to a waypoint's pose."""
    best = Solution(HOME, np.inf, np.inf)
    for attempt in range(WAYPOINT_RESTARTS):
        found = solve(arm, target, HOME if attempt == 0 else _random_posture(arm, rng))
        if found.converged:
            return
        if found.position_error + found.angle_error < best.position_error + best.angle_error:
            best = found
    raise UnreachableWaypoint(name, best.position_error, np.degrees(best.angle_error), _beyond_reach(target))


def _random_posture(arm: Arm, rng: np.random.Generator) -> np.ndarray:
    """Joint angles (7,) away from the limits."""
    return rng.uniform(0.8 * arm.lower, 0.8 * arm.upper)


TOOL_TO_WRIST = 0.36
"""Distance [m] from the tool's frame to the wrist centre at most: flange 0.126, grip 0.160 and handle aslant."""


def _beyond_reach(target: Pose) -> float:
    """How far [m] the target lies outside the ball that the tool can reach; negative inside."""
    return float(np.linalg.norm(target.position - SHOULDER)) - (REACH + TOOL_TO_WRIST)
