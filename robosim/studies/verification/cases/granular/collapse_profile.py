"""Deposits of collapsed round columns of sand: depth over radius, for columns of 0.5 to 4 radii.

Measured: relative errors of run-out and height, the volume between the profile and the reference's over the column's,
the mean compression, creep and the rms velocity at the end. Reference: the fits of Lube et al. (2004); their rim, their
height and the column's volume determine the shape of the profile that is drawn (`deposit.closed_depths`), which is no
measurement. The run-out is taken where the deposit is 1 % of the column's radius thick; a second error takes the radius
that holds 99 % of the particles.

Particles that have come to rest sleep, and then have no velocity. Therefore the state at the end is continued without
sleeping twice, each time for a tenth of the run: as it is ("woken"), and after kinetic damping for as long ("settled"),
which takes elastic vibration away and leaves a deposit that is in equilibrium where it is; `settlement` is the rms
displacement meanwhile, in column radii.

Three laws: sand denser than critical (`dense_sand`), Drucker-Prager and mu(I). Their parameters are not fitted to any
collapse.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

import mpm
from robosim.base.errors import UnknownName
from robosim.scene.settle import settle
from robosim.studies.verification.cases.beds import courant_step
from robosim.studies.verification.cases.case import Comparison, Record, TimedSolver, case, grid
from robosim.studies.verification.cases.dense_sand import DenseSand, dense_sand
from robosim.studies.verification.cases.expectations import Approach, Within
from robosim.studies.verification.cases.granular.column_collapse import (
    ANGLES_DEG,
    DENSITY,
    NU,
    RADIUS,
    G,
    crest,
    fill,
    rim,
)
from robosim.studies.verification.cases.granular.deposit import (
    closed_depths,
    find_rim,
    find_summit,
    measure_profile,
    profile_difference,
    volume_of,
)

SHORT, CELLS, FINE, FINEST = (0.5, 1.0, 2.0), (12, 16, 24), 24, 32
"""Columns that are claimed in full, height over radius; cells per radius of their runs, of the claims on errors, and of
the finest run, which shows whether an error goes on rising."""
LAWS = ("dense", "drucker_prager", "mu_i")
MOTIONS, WHENS = ("creep", "drift"), ("", ", woken", ", settled")
_USUAL = {"law": "dense", "floor": 0.5, "relative_density": 0.7, "E": 1e5, "strides": True, "per_cell": 4,
          "sleep": 1.0}
LIMIT_DEG, GRAIN_DIAMETER, GRAIN_DENSITY = 38.2, 5e-4, 2600.0
"""mu(I): angle [deg] of the cone that carries tan 42 deg in simple shear, diameter [m] and density [kg/m^3] of a grain
of quartz sand."""
LONGER = 3.0
"""Duration of a run, in times after which the source's deposits are at rest."""
LAST = 0.1
"""Last share of the run, over which the creep is taken; as long are the continuations after it."""
READINGS = 20
"""Readings of the velocity in this time."""
SETTLING_WINDOW = 2e-3
"""[s], see `settle`."""
HELD = 0.99
"""Share of the particles inside the rim by the second definition."""


def source_time(a: float) -> float:
    """Return the time [s] after which the source's deposit is at rest."""
    return 3.0 * math.sqrt(a * RADIUS / G)


def make_law(law: str, E: float, relative_density: float) -> mpm.DruckerPrager | DenseSand:
    """Return a law; those without dilation carry tan 30 deg in simple shear, when they flow slowly."""
    if law == "dense":
        return dense_sand(relative_density, E=E, nu=NU, density=DENSITY)
    angle = ANGLES_DEG["compression"]
    if law == "drucker_prager":
        return mpm.DruckerPrager(E=E, nu=NU, density=DENSITY, friction_angle_deg=angle)
    if law == "mu_i":
        return mpm.MuIRheology(E=E, nu=NU, density=DENSITY, friction_angle_deg=angle, limit_angle_deg=LIMIT_DEG,
                               grain_diameter=GRAIN_DIAMETER, grain_density=GRAIN_DENSITY)
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
    """[s]; None: LONGER times the source's time."""


def build(run: Collapse, sleep: float) -> mpm.Solver:
    """Return a quarter of the column before its release."""
    a, cell = run.a, RADIUS / run.cells
    sand = make_law(run.law, run.E * max(a, 1.0), run.relative_density)
    grains = fill(a, cell, run.per_cell, quarter=True)
    volume, room = math.pi * RADIUS**3 * a / 4 / len(grains), math.ceil(1.6 * rim(a) / cell) * cell
    return mpm.Solver(
        grid=mpm.Grid((0, 0, 0), (room, room, 1.2 * a * RADIUS + 3 * cell), cell),
        walls=mpm.Walls(friction=run.floor, lower=("roller", "roller", "friction")),
        bodies=[mpm.Body(sand, grains, volume=volume)], gravity=(0, 0, -G), precision=run.precision,
        sleep=sleep or False, transfer_interval=None if run.strides else 0.0, dt=courant_step(run.courant, cell, sand))


class Motion(NamedTuple):
    """Motion of a deposit during a time."""

    creep: float
    """Rms displacement over the time [m/s]."""
    drift: float
    """Largest rms velocity [m/s]."""


def observe(solver: mpm.Solver, duration: float) -> Motion:
    """Advance by `duration` [s]; return the motion meanwhile."""
    before, fastest = solver.positions(), 0.0
    for _ in range(READINGS):
        solver.advance(duration / READINGS)
        fastest = max(fastest, rms(solver.velocities()))
    return Motion(rms(solver.positions() - before) / duration, fastest)


def rms(vectors: np.ndarray) -> float:
    """Return the root of the mean square of the lengths of vectors (n, 3)."""
    return float(np.sqrt((vectors**2).sum(1).mean()))


def compare(records: list[Record]) -> list[Comparison]:
    """Return depth over radius for each height of the column, beside the reference's closed profile."""
    comparisons = []
    for a in sorted({float(record.choices["a"] or 0.0) for record in records}):
        end, top = rim(a) / RADIUS, crest(a) / RADIUS
        line = np.linspace(0.0, end, 60)
        series = {}
        for record in (r for r in records if r.choices["a"] == a):
            varied = [f"{key} {record.choices[key]}" for key in _USUAL
                      if key != "law" and record.choices[key] != _USUAL[key]]
            if record.choices["duration"] is not None:
                varied.append(f"{record.choices['duration']:g} s")
            label = ", ".join([str(record.choices["law"]), f"{record.choices['cells']} cells", *varied])
            series[label] = [(float(name.removeprefix("depth at ")), depth, label)
                             for name, depth in record.readings.items() if name.startswith("depth at ")]
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
def measure(run: Collapse) -> Record:
    """Run the case; return the errors of run-out, height and profile."""
    a, duration, solver = run.a, run.duration or LONGER * source_time(run.a), build(run, run.sleep)
    timed = TimedSolver(solver)
    timed.advance((1 - LAST) * duration)
    before = solver.positions()
    timed.advance(LAST * duration)
    x, state = solver.positions(), solver.state()
    radii = np.hypot(x[:, 0], x[:, 1]) / RADIUS
    # of what dense sand dilated; beyond its room, and in the other laws, grains are apart
    growth = np.minimum(state["vc"].ravel(), getattr(solver.bodies[0].material, "room", 0.0))
    profile = measure_profile(radii, math.pi * a / 4 / len(x) * np.exp(growth), share=0.25)
    end, top = rim(a) / RADIUS, crest(a) / RADIUS
    edge, summit = find_rim(profile), find_summit(profile)
    reference = closed_depths(profile.radii, top, end, math.pi * a)
    errors = {"run-out": (edge - 1) / (end - 1) - 1,
              "run-out of 99 %": (np.quantile(radii, HELD) - 1) / (end - 1) - 1, "height": summit / top - 1,
              "profile": profile_difference(profile, reference),
              "compression": solver.densities().mean() / DENSITY - 1,
              "creep": rms(x - before) / (LAST * duration), "drift": rms(solver.velocities())}
    awake = build(run, 0.0)
    awake.load(state)
    if run.sleep:
        errors["creep, woken"], errors["drift, woken"] = observe(awake, LAST * duration)
    before = awake.positions()
    settle(awake, awake.advance, LAST * duration, SETTLING_WINDOW)
    settlement = rms(awake.positions() - before) / RADIUS
    errors["creep, settled"], errors["drift, settled"] = observe(awake, LAST * duration)
    depths = {f"depth at {r:.2f}": h for r, h in zip(*profile)}
    return timed.record(errors, edge=edge, summit=summit, outermost=radii.max(), awake=solver.awake.mean(),
                        settlement=settlement, expansion=volume_of(profile) / (math.pi * a) - 1, **depths)
