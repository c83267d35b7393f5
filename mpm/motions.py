"""Where the colliders are and what motion each has been given for the coming advance."""

import math
from itertools import pairwise

import numpy as np

from mpm.collider import Collider
from mpm.errors import InvalidValue
from mpm.features import Features
from mpm.mobility_table import MobilityTable
from mpm.motion import Pose, Twist, logarithm, motion_table, screw
from mpm.timestep import travel_bound

REST = Twist(np.zeros(3), np.zeros(3))
Leg = tuple[Pose, Twist]
"""A begin, and the body twist that carries it to the end in unit time."""


class Motions:
    """Poses of all colliders, and the ways of those that are given one; one without a way rests."""

    def __init__(self, colliders: list[Collider], features: Features, mobility: MobilityTable) -> None:
        self._colliders, self._features, self._mobility = colliders, features, mobility
        self.poses = [collider.pose for collider in colliders]
        self.pending: dict[int, tuple[Pose, ...]] = {}

    def set(self, index: int, begin: Pose, ends: tuple[Pose, ...]) -> None:
        """Give a collider its way through the coming advance."""
        movable = tuple(i for i in self._features.moving_colliders if i not in self._features.mobile)
        if index not in movable or self._colliders[index].static:
            raise InvalidValue(f"collider {index} cannot be given a motion; it can: {movable}")
        if not ends:
            raise InvalidValue(f"collider {index}: no end of the motion; give one pose or more")
        self.pending[index] = (begin, *ends)

    def kept(self) -> tuple[list[Pose], dict[int, tuple[Pose, ...]]]:
        """Poses and ways, to return to."""
        return list(self.poses), dict(self.pending)

    def take(self, duration: float, looks: int, dt: float, cell: float, dtype: type) -> tuple[int, np.ndarray]:
        """Number of equal substeps of the coming advance, and the motion table of all of them.

        As many substeps for every leg and every look; each at most dt [s], and short enough that no collider's surface
        outruns its contact.
        """
        ways = []
        for index in self._features.moving_colliders:
            way = self.pending.pop(index, None)
            ways.append([(self.poses[index], REST)] if way is None else
                        [(begin, logarithm(begin, end)) for begin, end in pairwise(way)])
            self.poses[index] = self.poses[index] if way is None else way[-1]
        parts = math.lcm(looks, *(len(legs) for legs in ways))
        longest = min(dt, self._longest(ways, duration, cell))
        total = parts * max(1, math.ceil(duration / parts / longest - 1e-9))
        screws = [[screw(*leg, duration / len(legs), total // len(legs)) for leg in legs] for legs in ways]
        return total, motion_table(screws, total, dtype)

    def _longest(self, ways: list[list[Leg]], duration: float, cell: float) -> float:
        """Longest substep [s] in which contact sees every collider's surface."""
        longest = math.inf
        for index, legs in zip(self._features.moving_colliders, ways):
            for _, twist in legs:
                speed = math.sqrt(twist.linear @ twist.linear)
                speed += math.sqrt(twist.angular @ twist.angular) * self._colliders[index].sdf.radius
                longest = min(longest, travel_bound(cell, speed * len(legs) / duration))
        for index in self._features.mobile:
            speed = self._mobility.fastest(index, self._colliders[index].sdf.radius)
            longest = min(longest, travel_bound(cell, speed))
        return longest
