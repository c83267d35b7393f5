"""Deposits of collapsed round columns of sand: depth over radius."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

import mpm
from robosim.base.errors import UnknownName
from robosim.studies.verification.cases.beds import courant_step, fill_column, rim, rms
from robosim.studies.verification.cases.case import Comparison, Record, TimedSolver, case, grid
from robosim.studies.verification.cases.dense_sand import DenseSand, dense_sand
from robosim.studies.verification.cases.expectations import Approach, Within

RADIUS, DENSITY, NU, G = 0.1, 1600.0, 0.3, 9.81
ANGLE_DEG = 25.377
"""Friction angle with which the cone of triaxial compression carries tan 30 deg in simple shear."""
SHORT, CELLS, FINE, FINEST = (0.5, 1.0, 2.0), (12, 16, 24), 24, 32
"""Columns that are claimed in full, height over radius; cells per radius of their runs, of the claims on errors, and of
the finest run, which shows whether an error goes on rising."""
LAWS = ("dense", "drucker_prager", "mu_i")
MOTIONS, WHENS = ("creep", "drift"), ("", ", woken", ", settled")
_USUAL = {"law": "dense", "floor": 0.5, "relative_density": 0.7, "E": 1e5, "strides": True, "per_cell": 4, "sleep": 1.0}
LIMIT_DEG, GRAIN_DIAMETER, GRAIN_DENSITY = 38.2, 5e-4, 2600.0
"""mu(I): angle [deg] of the cone that carries tan 42 deg in simple shear, diameter [m] and density [kg/m^3] of a grain
of quartz sand."""
LONGER = 3.0
"""Duration of a run, in times after which the source's deposits are at rest."""
LAST = 0.1
"""Last share of the run, over which the creep is taken; as long are the continuations after it."""
READINGS = 20
"""Readings of the velocity in this time."""
RING = 0.1
"""Width of a ring of the profile, in column radii."""
THIN = 0.01
"""Depth at which the deposit ends, in column radii: 1 mm for a column of 0.1 m, some two grains of sand."""
TOP = 0.5
"""Radius within which a straight line through the depths leads to the summit, in column radii."""


def crest(a: float) -> float:
    """Return the height [m] of the deposit; the fit for tall columns fills the source's gap from a = 1 to 1.7."""
    return RADIUS * (a if a < 1 else 0.88 * a ** (1 / 6))


def make_law(law: str, E: float, relative_density: float) -> mpm.DruckerPrager | DenseSand:
    """Return a law; those without dilation carry tan 30 deg in simple shear, when they flow slowly."""
    if law == "dense":
        return dense_sand(relative_density, E=E, nu=NU, density=DENSITY)
    if law == "drucker_prager":
        return mpm.DruckerPrager(E=E, nu=NU, density=DENSITY, friction_angle_deg=ANGLE_DEG)
    if law == "mu_i":
        return mpm.MuIRheology(E=E, nu=NU, density=DENSITY, friction_angle_deg=ANGLE_DEG,
                               limit_angle_deg=LIMIT_DEG, grain_diameter=GRAIN_DIAMETER, grain_density=GRAIN_DENSITY)
    raise UnknownName("law", law, LAWS)


@dataclass(frozen=True)
class Collapse:
    """Choices of a run."""

    a: float = 1.0
    """Height over radius."""
    cells: int = 16
    """Per radius."""
    law: str = "dense"
    """One of LAWS."""
    relative_density: float = 0.7
    E: float = 1e5
    """Young's modulus [Pa] of columns up to a = 1; of taller ones a times as much."""
    floor: float = 0.5
    """Friction coefficient."""
    per_cell: int = 4
    strides: bool = True
    sleep: float = 1.0
    """Factor on the thresholds of sleeping, 0 for none."""
    courant: float = 0.5
    precision: str = "f32"
    duration: float | None = None
    """[s]; None: LONGER times the source's time, after which its deposit is at rest."""


def build(run: Collapse, sleep: float) -> mpm.Solver:
    """Return a quarter of the column before its release."""
    a, cell = run.a, RADIUS / run.cells
    sand = make_law(run.law, run.E * max(a, 1.0), run.relative_density)
    grains = fill_column(RADIUS, a * RADIUS, cell, np.random.default_rng(0), per_cell=run.per_cell)
    volume, room = math.pi * RADIUS**3 * a / 4 / len(grains), math.ceil(1.6 * rim(RADIUS, a) / cell) * cell
    return mpm.Solver(
        grid=mpm.Grid((0, 0, 0), (room, room, 1.2 * a * RADIUS + 3 * cell), cell),
        walls=mpm.Walls(friction=run.floor, lower=("roller", "roller", "friction")),
        bodies=[mpm.Body(sand, grains, volume=volume)], gravity=(0, 0, -G), precision=run.precision,
        sleep=sleep or False, transfer_interval=None if run.strides else 0.0, dt=courant_step(run.courant, cell, sand))


def observe(solver: mpm.Solver, duration: float) -> tuple[float, float]:
    """Advance by `duration` [s]; return the rms displacement over the time, and the largest rms velocity [m/s]."""
    before, fastest = solver.positions(), 0.0
    for _ in range(READINGS):
        solver.advance(duration / READINGS)
        fastest = max(fastest, rms(solver.velocities()))
    return rms(solver.positions() - before) / duration, fastest


class Profile(NamedTuple):
    """Depth of a deposit over the radius; lengths are in column radii."""

    radii: np.ndarray
    """(n,) middles of the rings."""
    depths: np.ndarray
    """(n,) volume over area of each ring."""


def measure_profile(radii: np.ndarray, volumes: np.ndarray, share: float = 1.0) -> Profile:
    """Return the profile of particles, up to one empty ring.
    radii (n,): of the particles, in column radii. volumes (n,): in cubes of the column's radius. share: of the whole
    round that the particles fill, 0.25 for a quarter."""
    edges = np.arange(math.floor(radii.max() / RING) + 3) * RING
    areas = share * math.pi * np.diff(edges**2)
    return Profile(edges[:-1] + RING / 2, np.histogram(radii, edges, weights=volumes)[0] / areas)


def find_rim(profile: Profile, thin: float = THIN) -> float:
    """Return the outermost radius at which the depth is `thin`, by a straight line between rings."""
    r, h = profile
    k = int(np.flatnonzero(h >= thin)[-1])
    return float(r[k] + (h[k] - thin) / (h[k] - h[k + 1]) * RING)


def find_summit(profile: Profile) -> float:
    """Return the depth at the axis, by a straight line through the rings inside TOP."""
    inner = profile.radii < TOP
    return float(np.polyfit(profile.radii[inner], profile.depths[inner], 1)[1])


def volume_of(profile: Profile) -> float:
    """Return the volume of the round deposit, in cubes of the column's radius."""
    return float(np.sum(2 * math.pi * profile.radii * profile.depths) * RING)


def profile_difference(profile: Profile, reference: np.ndarray) -> float:
    """Return the volume between a profile and reference depths (n,) at its radii, over that of the reference.
    The profile is scaled to the reference's volume first, so that its own expansion does not count."""
    area = 2 * math.pi * profile.radii * RING
    scale = float(np.sum(area * reference)) / volume_of(profile)
    return float(np.sum(area * np.abs(scale * profile.depths - reference)) / np.sum(area * reference))


def closed_depths(radii: np.ndarray, summit: float, rim: float, volume: float) -> np.ndarray:
    """Return depths (n,) of the profile that summit, rim and volume determine, all in column radii.
    It is summit (1 - r / rim)^n, or a cone with a flat top where the volume is more than a cone's. Raises ValueError
    for a volume above that of a cylinder."""
    if not 0.0 < volume < math.pi * rim**2 * summit:
        raise ValueError(f"volume {volume:g}; accepted: above 0, below {math.pi * rim**2 * summit:g}")
    # volume = 2 pi summit rim^2 / ((n + 1) (n + 2))
    power = (math.sqrt(1.0 + 8.0 * math.pi * summit * rim**2 / volume) - 3.0) / 2.0
    if power >= 1.0:
        return summit * np.clip(1.0 - radii / rim, 0.0, 1.0) ** power
    top = brentq(lambda c: math.pi * summit * (rim**2 + rim * c + c * c) / 3.0 - volume, 0.0, rim)
    return summit * np.clip((rim - radii) / (rim - float(top)), 0.0, 1.0)  # pyright: ignore[reportArgumentType]


def compare(records: list[Record]) -> list[Comparison]:
    """Return depth over radius for each height of the column, beside the reference's closed profile."""
    comparisons = []
    for a in sorted({float(record.choices["a"] or 0.0) for record in records}):
        end, top = rim(RADIUS, a) / RADIUS, crest(a) / RADIUS
        line = np.linspace(0.0, end, 60)
        series = {}
        for record in (r for r in records if r.choices["a"] == a):
            varied = [f"{key} {record.choices[key]}" for key in _USUAL
                      if key != "law" and record.choices[key] != _USUAL[key]]
            if record.choices["duration"] is not None:
                varied.append(f"{record.choices['duration']:g} s")
            label = ", ".join([str(record.choices["law"]), f"{record.choices['cells']} cells", *varied])
            series[label] = record.curve("depth at", label)
        comparisons.append(Comparison(
            title=f"deposit of a column of {a:g} radii", x="radius, in column radii", y="depth, in column radii",
            measured=series, line=list(zip(line, closed_depths(line, top, end, math.pi * a))),
            uncertainty=0.15, is_relative=True, is_joined=True,
            source="Lube et al. 2004; its shape: from rim, height and the column's volume"))
    return comparisons


@case(
    source="Lube et al. 2004, J. Fluid Mech. 508:175: r = r0 (1 + 1.24 a) for a < 1.7, r0 (1 + 1.6 sqrt(a)) above; "
           "h = r0 a for a < 1, 0.88 r0 a^(1/6) from 1.7, taken from a = 1 on",
    sweep=[*grid(a=SHORT, cells=CELLS), {"a": 4.0, "cells": 12}, {"a": 4.0, "cells": 16}, {"a": 1.0, "cells": FINEST},
           *({"a": a, "cells": n, "sleep": 0.0} for a, n in ((0.5, FINE), (1.0, 16), (1.0, FINE))),
           {"a": 1.0, "cells": FINE, "sleep": 0.0, "strides": False},
           {"a": 1.0, "cells": FINE, "sleep": 0.0, "duration": 1.8},
           *({"a": a, "cells": n, "law": law} for law in ("drucker_prager", "mu_i")
             for a, n in ((0.5, 16), (1.0, 12), (1.0, 16), (1.0, FINE), (2.0, 16))),
           *({"a": 1.0, "cells": 16, **choice} for choice in (
               {"relative_density": 0.3}, {"relative_density": 0.9}, {"floor": 0.6}, {"floor": 1.0}, {"E": 1e6},
               {"strides": False}, {"per_cell": 8}, {"sleep": 4.0})), {"a": 1.0, "cells": FINE, "floor": 1.0}],
    quick=[{"a": 1.0, "cells": 12}, {"a": 1.0, "cells": 12, "law": "drucker_prager"}],
    # mean compression by the weight; rms displacement of the last tenth of the run over its time, and rms velocity at
    # the end, to which elastic vibration adds; in a continuation, the largest
    expectations=(*(Within(name, high, {**_USUAL, "a": a, "cells": FINE})
                    for a in SHORT for name, high in (("run-out", 0.08), ("height", 0.15))),
                  *(Approach(name, "cells", CELLS, {**_USUAL, "a": a})
                    for a in SHORT for name in ("run-out", "height")),
                  *(Approach("profile", "cells", (16, FINE), {**_USUAL, "a": a}) for a in SHORT),
                  *(Approach(name, "cells", (FINE, FINEST), {**_USUAL, "a": 1.0})
                    for name in ("run-out", "height", "profile")),
                  Within("run-out", 0.10, {**_USUAL, "a": 4.0, "cells": 16}), Within("compression", 0.01, _USUAL),
                  *(Within(name + when, 1e-3, _USUAL) for name in MOTIONS for when in WHENS),
                  *(Within(name, 1e-3, {**_USUAL, "sleep": 0.0}) for name in MOTIONS)),
    main_error="profile", resolution="cells", units={name + when: "m/s" for name in MOTIONS for when in WHENS},
    compare=compare, options=Collapse)
def collapse_profile(run: Collapse) -> Record:
    """Deposits of collapsed round columns of sand: depth over radius, for columns of 0.5 to 4 radii.

    Measured: relative errors of run-out and height, the volume between the profile and the reference's over the
    column's, the mean compression, creep and the rms velocity at the end. The source's rim, its height and the column's
    volume determine the shape of the profile that is drawn (`closed_depths`), which is no measurement. The run-out is
    taken where the deposit is 1 % of the column's radius thick; two more errors, of run-out and rim, take the radius
    that holds 99 % of the particles.

    Particles that have come to rest sleep, and then have no velocity. Therefore the state at the end is continued
    without sleeping twice, each time for a tenth of the run: as it is ("woken"), and after kinetic damping for as long
    ("settled"), which takes elastic vibration away and leaves a deposit that is in equilibrium where it is;
    `settlement` is the rms displacement meanwhile, in column radii.

    Three laws: sand denser than critical (`dense_sand`), Drucker-Prager and mu(I). Their parameters are not fitted to
    any collapse."""
    a, solver = run.a, build(run, run.sleep)
    duration = run.duration or LONGER * 3.0 * math.sqrt(a * RADIUS / G)
    timed = TimedSolver(solver)
    timed.advance((1 - LAST) * duration)
    before = solver.positions()
    timed.advance(LAST * duration)
    x, state = solver.positions(), solver.state()
    radii = np.hypot(x[:, 0], x[:, 1]) / RADIUS
    # of what dense sand dilated; beyond its room, and in the other laws, grains are apart
    growth = np.minimum(state["vc"].ravel(), getattr(solver.bodies[0].material, "room", 0.0))
    profile = measure_profile(radii, math.pi * a / 4 / len(x) * np.exp(growth), share=0.25)
    end, top, r99 = rim(RADIUS, a) / RADIUS, crest(a) / RADIUS, np.quantile(radii, 0.99)
    edge, summit = find_rim(profile), find_summit(profile)
    reference = closed_depths(profile.radii, top, end, math.pi * a)
    errors = {"run-out": (edge - 1) / (end - 1) - 1, "run-out of 99 %": (r99 - 1) / (end - 1) - 1,
              "rim of 99 %": r99 / end - 1, "height": summit / top - 1,
              "profile": profile_difference(profile, reference), "compression": solver.densities().mean() / DENSITY - 1,
              "creep": rms(x - before) / (LAST * duration), "drift": rms(solver.velocities())}
    awake = build(run, 0.0)
    awake.load(state)
    if run.sleep:
        errors["creep, woken"], errors["drift, woken"] = observe(awake, LAST * duration)
    before = awake.positions()
    TimedSolver(awake).settle(LAST * duration)
    settlement = rms(awake.positions() - before) / RADIUS
    errors["creep, settled"], errors["drift, settled"] = observe(awake, LAST * duration)
    depths = {f"depth at {r:.2f}": h for r, h in zip(*profile)}
    return timed.record(errors, edge=edge, summit=summit, outermost=radii.max(), awake=solver.awake.mean(), r99=r99,
                        settlement=settlement, expansion=volume_of(profile) / (math.pi * a) - 1, **depths)
