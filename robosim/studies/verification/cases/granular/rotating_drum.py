"""Slowly rotating drum, partly full of sand."""

import math

import numpy as np
from scipy.optimize import brentq

import mpm
from mpm.backend import ti
from mpm.geometry.shape import Shape
from robosim.studies.verification.cases.beds import SMOOTH_SLICE, courant_step, set_up, shear_ratio
from robosim.studies.verification.cases.case import Record, case
from robosim.studies.verification.cases.expectations import Ratio, each_within

_USUAL = {"friction_deg": 30.0, "froude": 4e-3, "wall_friction": 1.0}
RADIUS, DENSITY, NU, G, E = 0.1, 1500.0, 0.3, 9.81, 1e5
WALL = 4.0
"""Thickness of the drum's wall [cells]."""
BEGIN, TURN, LOOKS = 1.6, 2.6, 40
"""Turn [rad] before the measurement; whole turn; readings. The sand first turns with the drum, to 42 deg, slips down to
29 deg and back up: from 1.6 rad on the slope is steady."""


class Drum(Shape):
    """The wall of a round pipe about the frame's y axis: points between r and r + wall [m] from it."""

    def __init__(self, r: float, wall: float) -> None:
        self.r, self.wall, self.radius = r, wall, 2.0 * (r + wall)

    @ti.func
    def at(self, y):
        around = ti.sqrt(y[0] * y[0] + y[2] * y[2] + 1e-24)
        outward = y / around
        outward[1] = 0.0 * y[1]
        middle = self.r + 0.5 * self.wall
        return ti.select(around < middle, -1.0, 1.0) * outward, ti.abs(around - middle) - 0.5 * self.wall

    def distance(self, points: np.ndarray) -> np.ndarray:
        around = np.hypot(points[..., 0], points[..., 2])
        return np.abs(around - self.r - 0.5 * self.wall) - 0.5 * self.wall

    def least_thickness(self) -> float:
        return self.wall


def level_of(fill: float) -> float:
    """Return the height of a level surface over the axis, in radii, for a share of the circle."""
    return float(brentq(lambda level: share_of(level) - fill, -1.0, 1.0))  # pyright: ignore[reportArgumentType]


def share_of(level: float) -> float:
    """Return the share of a circle below a straight surface, from its height over the axis in radii."""
    return 0.5 + (level * math.sqrt(1.0 - level**2) + math.asin(level)) / math.pi


@case(
    source="uniform slope with steady flow: tan(slope) = m3, the cone's shear ratio at constant volume; balance of "
           "moments about the drum's axis",
    sweep=[*({"cells": n} for n in (12, 16, 24)), *({"fill": f} for f in (0.35, 0.65)),
           *({"friction_deg": d} for d in (20.0, 25.0)), *({"froude": f} for f in (1e-3, 1.6e-2)),
           *({"wall_friction": f} for f in (0.7, 2.0))],
    quick=[{"cells": 12}, {"cells": 12, "fill": 0.35}],
    # change: of the slope from the first half of the measurement to the second; ratio: of the slopes of two fills
    expectations=(*each_within({"slope": 3.0, "slope by mass": 3.0}, {"froude": 4e-3}),
                  *each_within({"change": 1.5, "torque": 0.03, "volume": 0.02, "outside": 0.0}),
                  *(Ratio("inclination", "fill", (0.5, f), 0.95, 1.05, {**_USUAL, "cells": 16}) for f in (0.35, 0.65))),
    main_error="slope", resolution="cells", units={"slope": "deg", "slope by mass": "deg", "change": "deg"})
def rotating_drum(*, cells: int = 16, fill: float = 0.5, friction_deg: float = 30.0, froude: float = 4e-3,
                  wall_friction: float = 1.0) -> Record:
    """Slowly rotating drum, partly full of sand: the slope of the surface over which sand flows down all the time.

    Measured: difference [deg] of the slope from the angle that the sand carries in simple shear, by the surface between
    the outer quarters of its chord and by the direction of the centre of mass; the slope's change in time; the drum's
    torque over the weight's; the sand's volume below the surface over that at the start; and the share of the sand that
    is outside the drum. Reference: a layer that flows steadily along a uniform slope has tau / sigma_n = tan(slope) at
    every depth, which in sand without an effect of rate is the ratio m3 of simple shear (see `slope`); and sand that
    neither dilates nor contracts. The drum is one cell thick and turns about the y axis. cells: over the radius; fill:
    share of the drum; froude: angular velocity^2 x radius / gravity; wall_friction: coefficient."""
    cell = RADIUS / cells
    phi = math.degrees(math.asin(math.tan(math.radians(friction_deg))))
    sand = mpm.DruckerPrager(E=E, nu=NU, density=DENSITY, friction_angle_deg=phi, cone="plane_strain")
    limit = math.degrees(math.atan(shear_ratio(phi, "plane_strain")))
    half = RADIUS + (WALL + 2) * cell
    grains = mpm.sample_box((-RADIUS, 0, -RADIUS), (RADIUS, cell, level_of(fill) * RADIUS), cell / 2)
    grains = grains[np.hypot(grains[:, 0], grains[:, 2]) < RADIUS]
    volume = fill * math.pi * RADIUS**2 * cell / len(grains)
    drum = mpm.Collider(Drum(RADIUS, WALL * cell), friction=wall_friction)
    timed, solver = set_up(mpm.Body(sand, grains, volume=volume), (half, cell, half), cell, lower=(-half, 0, -half),
                           colliders=[drum], precision="f32", walls=SMOOTH_SLICE, gravity=(0, 0, -G),
                           dt=courant_step(0.5, cell, sand))
    timed.settle(0.05)
    before = share_of(surface_line(solver.positions(), cell)[1] / RADIUS)
    speed, weight = math.sqrt(froude * G / RADIUS), solver.masses().sum() * G
    step, turned, rows = (TURN - BEGIN) / LOOKS, 0.0, []
    while turned < TURN - 1e-9:
        solver.set_collider_motion(0, turned_by(turned), turned_by(turned + step))
        timed.advance(step / speed)
        turned += step
        if turned > BEGIN:
            x = solver.positions()
            angle, level = surface_line(x, cell)
            torque = solver.collider_impulse(0).torque[1] * speed / step
            rows.append((angle, centre_slope(x), torque, weight * x[:, 0].mean(), share_of(level / RADIUS),
                         np.mean(np.hypot(x[:, 0], x[:, 2]) > RADIUS + cell)))
    slopes, by_mass, torques, moments, volumes, outside = np.array(rows).T
    first, second = np.array_split(slopes, 2)
    errors = {"slope": slopes.mean() - limit, "slope by mass": by_mass.mean() - limit,
              "change": second.mean() - first.mean(), "torque": torques.mean() / moments.mean() - 1,
              "volume": volumes[-LOOKS // 4:].mean() / before - 1, "outside": outside.max()}
    return timed.record(errors, inclination=slopes.mean(), limit=limit, spread=slopes.std(), torque=torques.mean(),
                        moment=moments.mean())


def turned_by(angle: float) -> mpm.Pose:
    """Return the pose of the drum after a turn [rad] about the y axis, by which sand at its bottom moves towards -x."""
    return mpm.Pose(np.zeros(3), np.array([math.cos(angle / 2), 0.0, math.sin(angle / 2), 0.0]))


def centre_slope(positions: np.ndarray) -> float:
    """Return the angle [deg] between the centre of mass and straight down, from the drum's axis."""
    x, _, z = positions.mean(0)
    return math.degrees(math.atan2(abs(x), -z))


def surface_line(positions: np.ndarray, cell: float) -> tuple[float, float]:
    """Return angle [deg] and height over the axis [m] of the surface: a line through the highest grains.
    Grains are sorted into columns along the surface, whose direction is found in three rounds; those in the middle of
    the surface's chord count."""
    angle = level = 0.0
    for _ in range(3):
        along = positions[:, 0] * math.cos(angle) + positions[:, 2] * math.sin(angle)
        up = positions[:, 2] * math.cos(angle) - positions[:, 0] * math.sin(angle)
        columns = np.round(along / cell).astype(int)
        tops = np.full(columns.max() - columns.min() + 1, -np.inf)
        np.maximum.at(tops, columns - columns.min(), up)
        centres = (np.arange(len(tops)) + columns.min()) * cell
        level = np.median(tops[np.isfinite(tops)])
        inner = (np.abs(centres) < 0.5 * math.sqrt(max(RADIUS**2 - level**2, 0.0))) & np.isfinite(tops)
        slope, level = np.polyfit(centres[inner], tops[inner], 1)
        angle += math.atan(slope)
    return abs(math.degrees(angle)), float(level) + cell / 4  # half a grain above the centres
