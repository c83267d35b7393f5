"""Where the colliders are and what motion each has been given for the coming advance."""

import math
from collections.abc import Mapping
from itertools import pairwise

import numpy as np

from mpm.boundaries.mobility_table import MobilityTable
from mpm.errors import ColliderTooFast, InvalidValue
from mpm.geometry.rigid_motion import Pose, Twist, logarithm, motion_table, screw
from mpm.materials.stable_step import travel_bound
from mpm.scene.collider import Collider
from mpm.scene.features import Features
from mpm.scene.grid import Grid
from mpm.scene.validation import stored

SHORTER = 1000
"""Times that substeps may be shorter than dt for a collider's sake: one that needs more is a mistake, or diverges."""
REST = Twist(np.zeros(3), np.zeros(3))
Leg = tuple[Pose, Twist]
"""A begin, and the body twist that carries it to the end in unit time."""


class Motions:
    """Poses of all colliders, and the ways of those that are given one; one without a way rests."""

    def __init__(self, colliders: list[Collider], features: Features, mobility: MobilityTable, grid: Grid) -> None:
        self._colliders, self._features, self._mobility, self._grid = colliders, features, mobility, grid
        self._size = float(np.linalg.norm(grid.cells * grid.cell))
        self.poses = [collider.pose for collider in colliders]
        self.pending: dict[int, tuple[Pose, ...]] = {}

    def set(self, index: int, begin: Pose, ends: tuple[Pose, ...]) -> None:
        """Give a collider its way through the coming advance."""
        movable = tuple(i for i in self._features.moving_colliders if i not in self._features.mobile)
        if index not in movable or self._colliders[index].static:
            raise InvalidValue(f"collider {index} cannot be given a motion; it can: {movable}")
        if not ends:
            raise InvalidValue(f"collider {index}: no end of the motion; give one pose or more")
        for pose in (begin, *ends):
            if not math.isfinite(sum(map(float, (*pose.position, *pose.quaternion)))):
                raise InvalidValue(f"collider {index}: {pose}; accepted: finite numbers")
        self.pending[index] = (begin, *ends)

    def pose(self, index: int) -> Pose:
        """Where a collider is; raises InvalidValue where there is none."""
        if not 0 <= index < len(self.poses):
            raise InvalidValue(f"collider {index}; accepted: 0 to {len(self.poses) - 1}, as the scene has them")
        return self.poses[index]

    def stored_in(self, state: Mapping[str, np.ndarray]) -> list[Pose]:
        """The poses of a snapshot; raises InvalidValue where that is of another scene."""
        rows = stored(state, "poses", (len(self.poses), 7))
        return [Pose(row[:3].copy(), row[3:].copy()) for row in rows]

    def kept(self) -> tuple[list[Pose], dict[int, tuple[Pose, ...]]]:
        """Poses and ways, to return to."""
        return list(self.poses), dict(self.pending)

    def take(self, duration: float, looks: int, dt: float, dtype: type) -> tuple[int, np.ndarray]:
        """Number of equal substeps of the coming advance, and the motion table of all of them.

        As many substeps for every leg and every look; each at most dt [s], and short enough that no collider's surface
        outruns its contact. Raises ColliderTooFast where that would be `SHORTER` times shorter.
        """
        ways = []
        for index in self._features.moving_colliders:
            way = self.pending.get(index)
            ways.append([(self.poses[index], REST)] if way is None else
                        [(begin, logarithm(begin, end)) for begin, end in pairwise(way)])
        longest = min(dt, self._longest(ways, duration, dt))
        for index, way in self.pending.items():
            self.poses[index] = way[-1]
        self.pending.clear()
        parts = math.lcm(looks, *(len(legs) for legs in ways))
        total = parts * max(1, math.ceil(duration / parts / longest - 1e-9))
        screws = [[screw(*leg, duration / len(legs), total // len(legs)) for leg in legs] for legs in ways]
        return total, motion_table(screws, total, dtype)

    def _longest(self, ways: list[list[Leg]], duration: float, dt: float) -> float:
        """Longest substep [s] in which contact sees every collider's surface."""
        fastest, whose = 0.0, -1
        for index, legs in zip(self._features.moving_colliders, ways):
            for begin, twist in legs:
                speed = math.sqrt(twist.linear @ twist.linear)
                speed += math.sqrt(twist.angular @ twist.angular) * self._reach(index, begin)
                fastest, whose = max((fastest, whose), (speed * len(legs) / duration, index))
        for index in self._features.mobile:
            speed = self._mobility.fastest(index, self._reach(index, self.poses[index]))
            fastest, whose = max((fastest, whose), (speed, index))
        longest = travel_bound(self._grid.cell, fastest)
        if SHORTER * longest < dt:
            raise ColliderTooFast(whose, fastest, SHORTER * longest / dt * fastest)
        return longest

    def _reach(self, index: int, pose: Pose) -> float:
        """How far [m] from its frame's origin a collider can meet grains: not beyond the grid, which a plane is."""
        radius = self._colliders[index].sdf.radius
        if radius <= self._size:
            return radius
        lower = np.asarray(self._grid.lower)
        upper = lower + self._grid.cells * self._grid.cell
        corner = np.maximum(np.abs(pose.position - lower), np.abs(upper - pose.position))
        return min(radius, float(np.linalg.norm(corner)))
