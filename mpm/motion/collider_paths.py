"""Paths of colliders: where each is, and the motion that each was given for the next advance."""

import math
import warnings
from collections.abc import Mapping
from itertools import pairwise

import numpy as np

from mpm.errors import ColliderJumped, ColliderTooFast, InvalidValue
from mpm.geometry.rigid_motion import COLUMNS, Pose, Twist, check_pose, logarithm, motion_table, screw
from mpm.materials.stable_step import TRAVEL_FRACTION, travel_bound
from mpm.motion.mobility_table import MobilityTable
from mpm.scene.features import Features
from mpm.scene.scene import Scene
from mpm.scene.validation import read_array

SHORTEST = 1000
"""How often a dt may be divided for a fast collider; one that needs more is a mistake, or diverges."""
MOST_NUMBERS = 2**28
"""Of a motion table: 1 or 2 GB."""
REST = Twist(np.zeros(3), np.zeros(3))
Leg = tuple[Pose, Twist]  # pose at the begin, and the body twist that carries it to the end in unit time


class ColliderPaths:
    """Poses of all colliders, and the paths of those that were given one; one without a path rests."""

    def __init__(self, scene: Scene, features: Features, mobility: MobilityTable) -> None:
        grid, colliders = scene.grid, tuple(scene.colliders)
        self._colliders, self._features, self.mobility, self._grid = colliders, features, mobility, grid
        self._size = float(np.linalg.norm(grid.cells * grid.cell))
        self.poses = [collider.pose for collider in colliders]
        self.pending: dict[int, tuple[Pose, ...]] = {}
        self._jumped: set[int] = set()  # colliders of whose jump was warned

    def set(self, index: int, begin: Pose, ends: tuple[Pose, ...], is_jump: bool = False) -> None:
        """Give a collider its path through the next advance; raises InvalidValue for one that cannot move.
        Warns, once a collider, of a path that begins elsewhere than the collider is; is_jump: that is meant."""
        movable = tuple(i for i in self._features.moving_colliders if i not in self._features.mobile)
        if index not in movable or self._colliders[index].static:
            raise InvalidValue(f"collider {index} cannot be given a motion; it can: {movable}")
        if not ends:
            raise InvalidValue(f"collider {index}: no end of the motion; give one pose or more")
        for pose in (begin, *ends):
            check_pose(f"collider {index}", pose)
        if not is_jump and begin is not self.poses[index]:
            self._warn_of_jump(index, begin)
        self.pending[index] = (begin, *ends)

    def _warn_of_jump(self, index: int, begin: Pose) -> None:
        """Warn of a surface that is elsewhere by more than it may travel in a substep."""
        twist = logarithm(self.poses[index], begin)
        travel = float(np.linalg.norm(twist.linear) + np.linalg.norm(twist.angular) * self._reach(index, begin))
        if travel > TRAVEL_FRACTION * self._grid.cell and index not in self._jumped:
            self._jumped.add(index)
            warnings.warn(ColliderJumped(
                f"set_collider_motion: the motion of collider {index} begins at {begin.position.tolist()} m, and it is "
                f"at {self.poses[index].position.tolist()} m, {travel / self._grid.cell:.2g} cells away; particles in "
                f"between are not pushed; begin at collider_pose({index}), or give jump=True"), stacklevel=4)

    def pose(self, index: int) -> Pose:
        """Return the pose of a collider; raises InvalidValue where there is none."""
        if not 0 <= index < len(self.poses):
            raise InvalidValue(f"collider {index}; accepted: 0 to {len(self.poses) - 1}, as the scene has them")
        return self.poses[index]

    def read_snapshot(self, state: Mapping[str, np.ndarray]) -> list[Pose]:
        """Return the poses of a snapshot; raises InvalidValue for one of another scene."""
        rows = read_array(state, "poses", (len(self.poses), 7))
        return [Pose(row[:3].copy(), row[3:].copy()) for row in rows]

    def save(self) -> tuple[list[Pose], dict[int, tuple[Pose, ...]]]:
        """Return copies of poses and pending paths."""
        return list(self.poses), dict(self.pending)

    def plan(self, duration: float, readings: int, dt: float, dtype: type) -> tuple[int, np.ndarray]:
        """Return the number of equal substeps of the next advance, and the motion table of all of them.
        Every leg and every reading gets as many substeps; each is at most dt [s], and short enough that no collider's
        surface outruns its contact. The paths count as travelled. Raises ColliderTooFast where a substep would have to
        be `SHORTEST` times shorter than dt, InvalidValue where the table would have more than `MOST_NUMBERS`."""
        paths = []
        for index in self._features.moving_colliders:
            path = self.pending.get(index)
            paths.append([(self.poses[index], REST)] if path is None else
                         [(begin, logarithm(begin, end)) for begin, end in pairwise(path)])
        longest = min(dt, self._longest(paths, duration, dt))
        parts = math.lcm(readings, *(len(legs) for legs in paths))
        substeps, most = parts * max(1.0, duration / parts / longest), MOST_NUMBERS // COLUMNS // max(1, len(paths))
        if substeps > most:
            raise InvalidValue(f"advance: duration = {duration:.6g} s takes {substeps:.4g} substeps of {longest:.4g} "
                               f"s; accepted: up to {most} in one call, which last {most * longest:.4g} s")
        for index, path in self.pending.items():
            self.poses[index] = path[-1]
        self.pending.clear()
        total = parts * max(1, math.ceil(duration / parts / longest - 1e-9))
        screws = [[screw(*leg, duration / len(legs), total // len(legs)) for leg in legs] for legs in paths]
        return total, motion_table(screws, total, dtype)

    def _longest(self, paths: list[list[Leg]], duration: float, dt: float) -> float:
        """Return the longest substep [s] in which contact sees every collider's surface."""
        fastest, owner = 0.0, -1
        for index, legs in zip(self._features.moving_colliders, paths):
            for begin, twist in legs:
                speed = math.sqrt(twist.linear @ twist.linear)
                speed += math.sqrt(twist.angular @ twist.angular) * self._reach(index, begin)
                fastest, owner = max((fastest, owner), (speed * len(legs) / duration, index))
        for index in self._features.mobile:
            speed = self.mobility.fastest(index, self._reach(index, self.poses[index]))
            fastest, owner = max((fastest, owner), (speed, index))
        longest = travel_bound(self._grid.cell, fastest)
        if SHORTEST * longest < dt:
            raise ColliderTooFast(owner, fastest, SHORTEST * longest / dt * fastest)
        return longest

    def _reach(self, index: int, pose: Pose) -> float:
        """Return how far [m] from its frame's origin a collider can meet particles: within the grid, unlike a plane."""
        radius = self._colliders[index].sdf.radius
        if radius <= self._size:
            return radius
        lower = np.asarray(self._grid.lower)
        upper = lower + self._grid.cells * self._grid.cell
        corner = np.maximum(np.abs(pose.position - lower), np.abs(upper - pose.position))
        return min(radius, float(np.linalg.norm(corner)))
