"""The motion from the arm's home to the start of a path, around what stands in its way.
Straight in joint space where that is free; elsewhere by two trees that grow towards each other (RRT-Connect: Kuffner
and LaValle 2000), whose route is then cut short. The arm rests at each corner of the route."""

from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from robosim.base.errors import ConfigError
from robosim.config.rehearsal import RehearsalConfig
from robosim.planning.clearance import Clearances, Nearest
from robosim.robot.model import Arm
from robosim.robot.timing import MotionLimits, StraightMotion

MARGIN = 0.01
"""Distance [m] that the robot keeps from everything, unless home or start are closer."""
CHECKED = 0.03
"""Largest joint displacement [rad] between postures whose clearance is measured: 3 cm at a metre from the base."""
GROWTH = 0.3
"""Largest joint displacement [rad] by which a tree grows at a time."""
MOST_GROWTHS, SHORTCUTS = 400, 60
"""Times that the trees grow before a route counts as missing, and that a found one is tried to be cut short."""
AROUND = 1.2
"""Joint displacement [rad] beyond home and start up to which postures are tried."""
SPEED = 0.5
"""Share of the motion's speed limits that an approach uses."""
TORQUE_SHARE, MOST_SLOWDOWNS = 0.9, 6
"""Share of the motors' torques up to which it demands them; times that it is slowed down for that."""

Test = Callable[[np.ndarray], bool]


class Approach(NamedTuple):
    """A motion from the arm's home to the start of a path."""

    motion: StraightMotion
    clearance: Nearest
    """The smallest distance on the way."""


def plan_approach(config: RehearsalConfig, arm: Arm, start: np.ndarray) -> Approach:
    """Plan the motion from home to a posture (n,) [rad], within the limits of joints and motors.
    Raises ConfigError where home collides, or no way is found, which says between what."""
    clearances = Clearances(config, arm, is_standing=True)

    def measure(q: np.ndarray) -> Nearest:
        return clearances.least(q, MARGIN)

    ends = [(name, measure(q)) for name, q in (("home", arm.home), ("the start", start))]
    for name, nearest in ends:
        if nearest.distance < 0.0:
            raise ConfigError(f"in {name} {nearest.parts[0]} and {nearest.parts[1]} overlap by "
                              f"{-1e3 * nearest.distance:.1f} mm; accepted: the robot's home_deg, or a first waypoint, "
                              f"away from them")
    margin = min(MARGIN, *(0.9 * nearest.distance for _, nearest in ends))
    route = find_route(arm.home, start, (arm.lower, arm.upper), lambda q: measure(q).distance >= margin)
    if route is None:
        raise ConfigError(f"no way from home to the start was found that keeps {1e3 * margin:.3g} mm from all else, in "
                          f"{MOST_GROWTHS} attempts; accepted: the robot's home_deg nearer to it, or less in the way")
    on_the_way = [measure(q) for a, b in pairwise(route) for q in between(a, b, CHECKED)]
    motion = time_route(np.array(route), arm, arm.limits(config.limits))
    return Approach(motion, min(on_the_way, key=lambda nearest: nearest.distance))


def find_route(begin: np.ndarray, end: np.ndarray, limits: tuple[np.ndarray, np.ndarray],
               is_free: Test) -> list[np.ndarray] | None:
    """Find corners of a free route between two free postures (n,) [rad], both among them; None where none is found."""
    if is_straight_free(begin, end, is_free):
        return [begin, end]
    rng = np.random.default_rng(0)
    low = np.maximum(limits[0], np.minimum(begin, end) - AROUND)
    high = np.minimum(limits[1], np.maximum(begin, end) + AROUND)
    trees = [[[begin]], [[end]]]
    for k in range(MOST_GROWTHS):
        one, other = trees[k % 2], trees[1 - k % 2]
        # every fourth time towards the other tree's root
        goal = other[0][0] if k % 8 < 2 else rng.uniform(low, high)
        if not grow(one, goal, is_free):
            continue
        reached = one[-1][-1]
        while grow(other, reached, is_free):
            if np.array_equal(other[-1][-1], reached):
                return shorten(trees[0][-1] + trees[1][-1][-2::-1], is_free, rng)
    return None


def grow(tree: list[list[np.ndarray]], goal: np.ndarray, is_free: Test) -> bool:
    """Grow a tree, a list of routes from its root, by a step towards a posture; return whether the way was free."""
    route = min(tree, key=lambda route: np.linalg.norm(route[-1] - goal))
    away = goal - route[-1]
    length = float(np.abs(away).max())
    new = goal if length <= GROWTH else route[-1] + away * (GROWTH / length)
    if length == 0.0 or not is_straight_free(route[-1], new, is_free):
        return False
    tree.append([*route, new])
    return True


def shorten(route: list[np.ndarray], is_free: Test, rng: np.random.Generator) -> list[np.ndarray]:
    """Leave out corners between which the straight way is free."""
    for _ in range(SHORTCUTS):
        if len(route) < 3:
            break
        a, b = sorted(rng.choice(len(route), 2, replace=False))
        if b - a > 1 and is_straight_free(route[a], route[b], is_free):
            route = route[: a + 1] + route[b:]
    return route


def is_straight_free(a: np.ndarray, b: np.ndarray, is_free: Test) -> bool:
    """Test all postures between two."""
    return all(is_free(q) for q in between(a, b, CHECKED))


def between(a: np.ndarray, b: np.ndarray, step: float) -> np.ndarray:
    """Return postures (k, n) from a to b, both among them, at most `step` [rad] apart."""
    count = 1 + max(1, int(np.ceil(np.abs(b - a).max() / step)))
    return a + np.linspace(0.0, 1.0, count)[:, None] * (b - a)


def time_route(route: np.ndarray, arm: Arm, limits: MotionLimits) -> StraightMotion:
    """Put a route (k, n) [rad] into time; raises ConfigError where the motors are too weak at any speed."""
    slower, worst = SPEED, 0.0
    for _ in range(MOST_SLOWDOWNS):
        motion = StraightMotion(route, MotionLimits(*(most * slower**k for k, most in enumerate(limits, 1))))
        states = [motion.state(time) for time in np.arange(0.0, motion.duration, 0.02)]
        worst, _, _ = arm.most_demanded(states)
        if worst <= TORQUE_SHARE:
            return motion
        slower *= 0.7
    raise ConfigError(f"the motion from home to the start demands {worst:.2f} of a motor's torque, however slow it is; "
                      f"accepted: up to {TORQUE_SHARE}, a lighter tool")
