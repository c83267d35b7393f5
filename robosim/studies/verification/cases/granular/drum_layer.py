"""Drums whose surface layer, or whose slope by speed, was measured."""

import math

import numpy as np

import mpm
from robosim.studies.verification.cases.beds import Beads, plane_strain_angle
from robosim.studies.verification.cases.case import Comparison, Record, case
from robosim.studies.verification.cases.expectations import each_within
from robosim.studies.verification.cases.granular.drum import TurnedDrum
from robosim.studies.verification.cases.granular.rotating_drum import NU, E
from robosim.studies.verification.cases.references import read_reference, stated

BEGIN, TURN, LOOKS = 1.6, 3.2, 48
"""Turn [rad] before the measurement; whole turn; readings."""
GLASS = Beads(packing=0.6, slow_deg=20.9, fast_deg=32.76, inertial_number=0.279)
"""Source: Jop et al. 2006, Nature 441:727, for beads of 0.5 mm."""
BESIDE = 0.1
"""Half width of the middle of the chord in which velocities are taken, in radii."""


def compare_layer(records: list[Record]) -> list[Comparison]:
    """Return the velocity over the distance from the axis, beside that measured."""
    reference = read_reference("drum_of_beads")
    measured = {record.label("cells", "per_axis"): record.curve("u") for record in records}
    return [Comparison(title="layer in a drum", x="distance from the axis [m]", y="velocity along the surface [m/s]",
                       measured=measured, published={"measured": [(y, u, "") for y, u in reference["rows"]]},
                       uncertainty=reference["uncertainty"], is_relative=True, is_joined=True)]


@case(
    source=stated("drum_of_beads"), quick=[{"cells": 24}],
    sweep=[*({"cells": n} for n in (16, 24, 32)), {"wall_friction": 0.5}, {"per_axis": 3}],
    # of the whole layer, the surface's speed, angle and distance from the axis; rms over the surface's speed
    expectations=[one for n in (24, 32) for one in each_within(
        {"layer": 0.2, "surface speed": 0.2, "slope": 2.0, "surface": 0.003, "profile": 0.2},
        {"wall_friction": 1.0, "cells": n})],
    main_error="profile", resolution="cells", units={"slope": "deg", "surface": "m"}, compare=compare_layer)
def drum_layer(*, cells: int = 24, wall_friction: float = 1.0, per_axis: int = 2) -> Record:
    """Drum a third full of glass beads, in which a layer flows down over beads that turn with the drum.

    Measured: relative errors of the layer's thickness and of its speed at the surface, differences of the slope [deg]
    and of the surface's distance from the axis [m], and rms difference of the velocity over the depth from that
    measured, in units of the surface's. The beads are the law mu(I) with numbers of smaller ones. cells: over the
    radius; wall_friction: coefficient; per_axis: grains in a cell along each axis."""
    reference = read_reference("drum_of_beads")
    radius, law = reference["radius"], GLASS.make_law(E, NU, reference)
    drum = TurnedDrum(law, radius, radius / cells, reference["fill"], wall_friction, per_axis=per_axis)
    y, u = np.array(reference["rows"]).T
    slopes, levels, profiles = [], [], []
    for _ in drum.turn(reference["turns_per_minute"] * math.pi / 30, BEGIN, TURN, LOOKS):
        slope, level = drum.surface()
        slopes.append(slope)
        levels.append(level)
        profiles.append(velocities_at(drum, math.radians(slope), -y))
    sums, counts = np.sum(profiles, 0)
    profile, top = np.where(counts > 0, sums / np.maximum(counts, 1), np.nan), -float(np.mean(levels))
    deep = np.linspace(top, 0.95 * radius, 400)
    smooth = np.interp(deep, -y, profile)
    still = deep[np.argmax(smooth < 0.0)] if np.any(smooth < 0.0) else np.nan
    surface = float(np.nanmax(profile))
    errors = {"layer": (still - top) / (np.interp(0.0, -u, -y) + y[0]) - 1, "surface speed": surface / u[0] - 1,
              "slope": np.mean(slopes) - reference["slope_deg"], "surface": top + y[0],
              "profile": math.sqrt(np.nanmean((profile - u) ** 2)) / u[0]}
    return drum.timed.record(errors, top=top, still=still, inclination=np.mean(slopes),
                             **{f"u {place:g} m": value for place, value in zip(y, profile) if math.isfinite(value)})


def velocities_at(drum: TurnedDrum, slope: float, depths: np.ndarray) -> np.ndarray:
    """Return sums of velocities [m/s] down a slope [rad], and counts (2, n), at depths [m] (n,) below the axis.
    Depths are along the slope's normal; grains within half a cell of one count, in the middle of the chord."""
    x, v = drum.solver.positions(), drum.solver.velocities()
    along = np.array([math.cos(slope), 0.0, -math.sin(slope)])
    middle = np.abs(x @ along) < BESIDE * drum.radius
    depth, speed = x[middle] @ np.array([-math.sin(slope), 0.0, -math.cos(slope)]), v[middle] @ along
    near = np.abs(depths[:, None] - depth) < 0.5 * drum.cell
    return np.array([near @ speed, near.sum(1)])


def compare_slopes(records: list[Record]) -> list[Comparison]:
    """Return the slope over the drum's speed, beside that measured."""
    reference = read_reference("drum_of_powder")
    measured: dict[str, list] = {}
    for record in records:
        label = record.label("cells", "friction_deg", "wall_friction")
        point = (record.choices["turns_per_minute"], record.readings["inclination"], label)
        measured.setdefault(label, []).append(point)
    return [Comparison(title="slope by speed", x="turns per minute", y="slope [deg]", measured=measured,
                       published={"measured": [(n, angle, "") for n, angle in reference["rows"]]},
                       uncertainty=reference["uncertainty"], is_joined=True)]


@case(
    source=stated("drum_of_powder"),
    sweep=[*({"turns_per_minute": n, "cells": c} for c in (12, 16) for n in (10.0, 15.0, 30.0, 45.0)),
           {"wall_friction": 0.2}],
    quick=[{"turns_per_minute": n, "cells": 10} for n in (10.0, 30.0)],
    expectations=each_within({"slope": 2.0}, {"wall_friction": 0.4}), main_error="slope", resolution="cells",
    units={"slope": "deg"}, compare=compare_slopes)
def drum_slope(*, turns_per_minute: float = 10.0, cells: int = 16, friction_deg: float = 32.0,
               wall_friction: float = 0.4) -> Record:
    """Narrow drum half full of granules, whose slope grows with its speed; half of its width is computed.

    Measured: difference of the slope [deg] over the middle half of the chord from that measured. Reference: images at
    four speeds. The friction of the granules is not known: friction_deg, whose tangent they carry in simple shear, is
    chosen so that the slowest drum has the measured slope; what the case tests is how the slope grows. cells: over the
    radius; wall_friction: coefficient on drum and sides."""
    reference = read_reference("drum_of_powder")
    sand = mpm.DruckerPrager(E=E, nu=NU, density=reference["density"], cone="plane_strain",
                             friction_angle_deg=plane_strain_angle(friction_deg))
    radius = reference["radius"]
    drum = TurnedDrum(sand, radius, radius / cells, reference["fill"], wall_friction, reference["width"] / 2)
    slopes = [drum.surface()[0] for _ in drum.turn(turns_per_minute * math.pi / 30, BEGIN, TURN, LOOKS)]
    wanted = dict(reference["rows"])[turns_per_minute]
    return drum.timed.record({"slope": np.mean(slopes) - wanted}, inclination=np.mean(slopes), spread=np.std(slopes))
