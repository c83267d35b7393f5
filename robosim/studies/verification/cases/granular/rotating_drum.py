"""Slowly rotating drum, partly full of sand."""

import math

import numpy as np

import mpm
from robosim.studies.verification.cases.beds import plane_strain_angle, shear_ratio
from robosim.studies.verification.cases.case import Record, case
from robosim.studies.verification.cases.expectations import Ratio, each_within
from robosim.studies.verification.cases.granular.drum import G, TurnedDrum

_USUAL = {"friction_deg": 30.0, "froude": 4e-3, "wall_friction": 1.0}
RADIUS, DENSITY, NU, E = 0.1, 1500.0, 0.3, 1e5
BEGIN, TURN, LOOKS = 1.6, 2.6, 40
"""Turn [rad] before the measurement; whole turn; readings. The sand first turns with the drum, to 42 deg, slips down to
29 deg and back up: from 1.6 rad on the slope is steady."""


@case(
    source="uniform slope with steady flow: tan(slope) = m3, the cone's shear ratio at constant volume; balance of "
           "moments about the drum's axis",
    sweep=[*({"cells": n} for n in (12, 16, 24)), *({"fill": f} for f in (0.35, 0.65)),
           *({"friction_deg": d} for d in (20.0, 25.0)), *({"froude": f} for f in (1e-3, 1.6e-2)),
           *({"wall_friction": f} for f in (0.7, 2.0)),
           *({"cells": n, "per_axis": 3} for n in (12, 16, 24))],
    quick=[{"cells": 12}, {"cells": 12, "fill": 0.35}, {"cells": 12, "per_axis": 3}],
    # change: of the slope from the first half of the measurement to the second; ratio: of the slopes of two fills
    expectations=(*each_within({"slope": 3.0, "slope by mass": 3.0}, {"froude": 4e-3}),
                  *each_within({"change": 1.5, "torque": 0.03, "volume": 0.02, "outside": 0.0}),
                  *(Ratio("inclination", "fill", (0.5, f), 0.95, 1.05, {**_USUAL, "cells": 16}) for f in (0.35, 0.65))),
    main_error="slope", resolution="cells", units={"slope": "deg", "slope by mass": "deg", "change": "deg"})
def rotating_drum(*, cells: int = 16, fill: float = 0.5, friction_deg: float = 30.0, froude: float = 4e-3,
                  wall_friction: float = 1.0, per_axis: int = 2) -> Record:
    """Slowly rotating drum, partly full of sand: the slope of the surface over which sand flows down all the time.

    Measured: difference [deg] of the slope from the angle that the sand carries in simple shear, by the surface between
    the outer quarters of its chord and by the direction of the centre of mass; the slope's change in time; the drum's
    torque over the weight's; the room that a grain takes inside the sand over that at the start; and the share of the
    sand that is outside the drum. Reference: a layer that flows steadily along a uniform slope has tau / sigma_n =
    tan(slope) at every depth, which in sand without an effect of rate is the ratio m3 of simple shear (see `slope`);
    and sand that neither dilates nor contracts. The drum is one cell thick and turns about the y axis. cells: over the
    radius; fill: share of the drum; froude: angular velocity^2 x radius / gravity; wall_friction: coefficient;
    per_axis: grains in a cell along each axis."""
    cell = RADIUS / cells
    phi = plane_strain_angle(friction_deg)
    sand = mpm.DruckerPrager(E=E, nu=NU, density=DENSITY, friction_angle_deg=phi, cone="plane_strain")
    limit = math.degrees(math.atan(shear_ratio(phi, "plane_strain")))
    drum = TurnedDrum(sand, RADIUS, cell, fill, wall_friction, per_axis=per_axis)
    before = drum.room_of_grains()
    speed, weight, rows = math.sqrt(froude * G / RADIUS), drum.solver.masses().sum() * G, []
    for step in drum.turn(speed, BEGIN, TURN, LOOKS):
        x = drum.solver.positions()
        angle, _ = drum.surface()
        torque = drum.solver.collider_impulse(0).torque[1] / step
        rows.append((angle, centre_slope(x), torque, weight * x[:, 0].mean(), drum.room_of_grains(),
                     np.mean(np.hypot(x[:, 0], x[:, 2]) > RADIUS + cell)))
    slopes, by_mass, torques, moments, volumes, outside = np.array(rows).T
    first, second = np.array_split(slopes, 2)
    errors = {"slope": slopes.mean() - limit, "slope by mass": by_mass.mean() - limit,
              "change": second.mean() - first.mean(), "torque": torques.mean() / moments.mean() - 1,
              "volume": volumes[-LOOKS // 4:].mean() / before - 1, "outside": outside.max()}
    return drum.timed.record(errors, inclination=slopes.mean(), limit=limit, spread=slopes.std(), torque=torques.mean(),
                             moment=moments.mean())


def centre_slope(positions: np.ndarray) -> float:
    """Return the angle [deg] between the centre of mass and straight down, from the drum's axis."""
    x, _, z = positions.mean(0)
    return math.degrees(math.atan2(abs(x), -z))
