"""A drum that is turned: its shape, its sand, and the surface of that."""

import math
from collections.abc import Iterator

import numpy as np
from scipy.optimize import brentq

import mpm
from mpm.backend import ti
from mpm.geometry.shape import Shape
from mpm.materials.material import Material
from robosim.studies.verification.cases.beds import SMOOTH_SLICE, courant_step, set_up

G = 9.81
WALL, CORE = 4.0, 2.5
"""Thickness of the drum's wall; depth from which grains count as inside [cells]."""
ENDLESS = 1e3
"""Half the width [m] of a drum without ends."""


class Drum(Shape):
    """What surrounds a round room about the frame's y axis: points up to a wall's thickness outside of it [m].
    half: half the room's width [m]."""

    def __init__(self, r: float, wall: float, half: float = ENDLESS) -> None:
        self.r, self.wall, self.half = r, wall, half
        self.radius = 2.0 * (r + wall)

    @ti.func
    def at(self, y):
        around = ti.sqrt(y[0] * y[0] + y[2] * y[2] + 1e-24)
        outward = y / around
        outward[1] = 0.0 * y[1]
        along = 0.0 * y
        along[1] = ti.select(y[1] < 0, -1.0, 1.0)
        side, end = around - self.r, ti.abs(y[1]) - self.half
        deep = ti.max(side, end)
        n = ti.select(side > end, outward, along)
        return ti.select(deep < 0.5 * self.wall, -1.0, 1.0) * n, ti.abs(deep - 0.5 * self.wall) - 0.5 * self.wall

    def distance(self, points: np.ndarray) -> np.ndarray:
        deep = np.maximum(np.hypot(points[..., 0], points[..., 2]) - self.r, np.abs(points[..., 1]) - self.half)
        return np.abs(deep - 0.5 * self.wall) - 0.5 * self.wall

    def least_thickness(self) -> float:
        return self.wall


class TurnedDrum:
    """A drum about the y axis with sand that has settled in it: a slice in plane strain, or half of a narrow drum.
    radius, cell [m]; fill: share of the drum; half_width [m]: of a narrow drum, whose end turns with it; per_axis:
    grains in a cell along each axis."""

    def __init__(self, law: Material, radius: float, cell: float, fill: float, wall_friction: float,
                 half_width: float | None = None, per_axis: int = 2) -> None:
        self.radius, self.cell, self.turned = radius, cell, 0.0
        half, width = radius + (WALL + 2) * cell, half_width or cell
        # on a regular lattice the layers of a slice move as one, and shear closes the gaps between fewer grains
        grains = mpm.sample_box((-radius, 0, -radius), (radius, width, level_of(fill) * radius), cell / per_axis,
                                np.random.default_rng(0))
        grains = grains[np.hypot(grains[:, 0], grains[:, 2]) < radius]
        volume = fill * math.pi * radius**2 * width / len(grains)
        walls, room, shape = SMOOTH_SLICE, width, Drum(radius, WALL * cell)
        if half_width:
            walls = mpm.Walls(lower=("slip", "roller", "slip"), upper=("slip", "slip", "slip"))
            room, shape = math.ceil(width / cell + WALL) * cell, Drum(radius, WALL * cell, width)
        self.timed, self.solver = set_up(
            mpm.Body(law, grains, volume=volume), (half, room, half), cell, lower=(-half, 0, -half), walls=walls,
            colliders=[mpm.Collider(shape, friction=wall_friction)], precision="f32", gravity=(0, 0, -G),
            dt=courant_step(0.5, cell, law))
        self.timed.settle(0.05)

    def turn(self, speed: float, begin: float, whole: float, looks: int) -> Iterator[float]:
        """Turn the drum by an angle [rad] at a speed [rad/s]; yield the time [s] of each of the looks after `begin`."""
        step = (whole - begin) / looks
        while self.turned < whole - 1e-9:
            self.solver.set_collider_motion(0, turned_by(self.turned), turned_by(self.turned + step))
            self.timed.advance(step / speed)
            self.turned += step
            if self.turned > begin:
                yield step / speed

    def surface(self) -> tuple[float, float]:
        """Return angle [deg] and height over the axis [m] of the sand's surface, see `surface_line`."""
        return surface_line(self.solver.positions(), self.cell, self.radius)

    def room_of_grains(self) -> float:
        """Return the area [m^2] of the section that a grain takes inside the sand, see `room_inside`."""
        return room_inside(self.solver.positions(), self.surface(), self.radius, CORE * self.cell)


def room_inside(positions: np.ndarray, surface: tuple[float, float], radius: float, depth: float) -> float:
    """Return the area [m^2] of the section for each grain deeper than a depth [m] below surface and drum.
    The surface's own layer loosens and is left out. surface: angle [deg] and height [m], see `surface_line`; the sand
    lies towards the side on which its centre of mass is."""
    (angle, level), inner = surface, radius - depth
    slope, side = math.radians(angle), 1.0 if positions[:, 0].mean() < 0 else -1.0
    height = positions[:, 2] * math.cos(slope) + side * positions[:, 0] * math.sin(slope)
    highest = min(level - depth, inner)
    count = np.sum((height < highest) & (np.hypot(positions[:, 0], positions[:, 2]) < inner))
    return share_of(highest / inner) * math.pi * inner**2 / count


def surface_line(positions: np.ndarray, cell: float, radius: float) -> tuple[float, float]:
    """Return angle [deg] and height over the axis [m] of the surface: a line through the highest grains.
    Grains are sorted into columns along the surface, whose direction is found in three rounds; those in the middle of
    the surface's chord count. radius [m]: of the drum."""
    angle = level = 0.0
    for _ in range(3):
        along = positions[:, 0] * math.cos(angle) + positions[:, 2] * math.sin(angle)
        up = positions[:, 2] * math.cos(angle) - positions[:, 0] * math.sin(angle)
        columns = np.round(along / cell).astype(int)
        tops = np.full(columns.max() - columns.min() + 1, -np.inf)
        np.maximum.at(tops, columns - columns.min(), up)
        centres = (np.arange(len(tops)) + columns.min()) * cell
        level = np.median(tops[np.isfinite(tops)])
        inner = (np.abs(centres) < 0.5 * math.sqrt(max(radius**2 - level**2, 0.0))) & np.isfinite(tops)
        slope, level = np.polyfit(centres[inner], tops[inner], 1)
        angle += math.atan(slope)
    return abs(math.degrees(angle)), float(level) + cell / 4  # half a grain above the centres


def level_of(fill: float) -> float:
    """Return the height of a level surface over the axis, in radii, for a share of the circle."""
    return float(brentq(lambda level: share_of(level) - fill, -1.0, 1.0))  # pyright: ignore[reportArgumentType]


def share_of(level: float) -> float:
    """Return the share of a circle below a straight surface, from its height over the axis in radii."""
    return 0.5 + (level * math.sqrt(1.0 - level**2) + math.asin(level)) / math.pi


def turned_by(angle: float) -> mpm.Pose:
    """Return the pose of the drum after a turn [rad] about the y axis, by which sand at its bottom moves towards -x."""
    return mpm.Pose(np.zeros(3), np.array([math.cos(angle / 2), 0.0, math.sin(angle / 2), 0.0]))
