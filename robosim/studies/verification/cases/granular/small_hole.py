"""Discharge of salt from holes of 3 mm in the floor of a thin can, on cells of 4 to 8 mm.

Measured: relative error of the mass below the floor; of holes too small for the grains, that mass as a share of what
the law without cut-off gives; the part of the momentum that gravity, walls and can do not account for. Reference:
Beverloo's law. `mpm.Orifice` imposes it: what the case tests is that the bed keeps the holes covered on every cell,
that what passes arrives below, and that momentum is kept although particles are carried through the floor.
"""

import math

import numpy as np
import trimesh

import mpm
from robosim.studies.verification.cases.beds import UPRIGHT
from robosim.studies.verification.cases.case import Record, TimedSolver, case, grid
from robosim.studies.verification.cases.expectations import each_within

HALF, DEEP, FILL, BELOW = 0.024, 0.05, 0.04, 0.05
"""Half the can's width, its depth, height of the fill, room below it [m]."""
PLACES = 0.011 * np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]])
"""Where the holes are [m]."""
THICKNESS, DENSITY, G, PER_CELL = 1.5e-3, 1217.0, 9.81, 8
C, K = 0.58, 1.4
UNTIL = 0.2
"""Time [s] that the bed has to settle, with the holes already open, and the rate to become steady."""


def can() -> trimesh.Trimesh:
    """Make the mid-surface of the can, open on top, its floor at z = 0."""
    box = trimesh.creation.box((2 * HALF, 2 * HALF, DEEP))
    box.apply_translation((0.0, 0.0, 0.5 * DEEP))
    return trimesh.Trimesh(box.vertices, box.faces[box.triangles_center[:, 2] < DEEP - 1e-6])


@case(
    source="Beverloo, Leniger & van de Velde 1961, Chem. Eng. Sci. 15:260: W = C rho sqrt(g) (D - k d)^(5/2), "
           "C = 0.58, k = 1.4; nothing below D / d = 4",
    sweep=grid(cell=(0.008, 0.006, 0.004), ratio=(3.0, 3.9, 6.0, 8.0, 12.0, 20.0)),
    quick=[{"ratio": r, "cell": c} for r, c in ((3.9, 0.008), (6.0, 0.008), (20.0, 0.006))],
    # the rate for D / d of 6 to 20; share of the law without cut-off that passes below 4; unaccounted share of the
    # momentum exchanged with the can, the larger of the linear and the angular one
    expectations=each_within({"rate": 0.15, "blocked": 0.0, "momentum": 1e-6}),
    main_error="rate")
def measure(*, ratio: float = 8.0, cell: float = 0.006, diameter: float = 3e-3, duration: float = 2.0,
            precision: str = "f32") -> Record:
    """Run the case; return the errors of rate and momentum, or what passes a hole that is too small.

    ratio: D / d; cell [m]; diameter: of the holes [m]; duration: of the discharge [s].
    """
    spacing = cell / PER_CELL ** (1 / 3)
    salt = mpm.DruckerPrager(E=1.5e5, nu=0.2, density=DENSITY, friction_angle_deg=33.0)
    margin = 0.5 * (THICKNESS + spacing)
    grains = mpm.sample_box((margin - HALF, margin - HALF, margin), (HALF - margin, HALF - margin, FILL), spacing,
                            np.random.default_rng(0))
    place = np.array([2 * HALF, 2 * HALF, BELOW])
    orifice = mpm.Orifice(PLACES, np.array([0.0, 0.0, -1.0]), diameter=diameter, grain_diameter=diameter / ratio, k=K,
                          C=C)
    holder = mpm.Collider(mpm.Shell.from_mesh(can(), THICKNESS), friction=0.3, orifices=[orifice],
                          pose=mpm.Pose(place, UPRIGHT))
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (4 * HALF, 4 * HALF, BELOW + DEEP + cell), cell), colliders=[holder],
                        bodies=[mpm.Body(salt, grains + place, volume=spacing**3)], precision=precision,
                        gravity=(0, 0, -G))
    timed, mass = TimedSolver(solver), float(solver.masses()[0])
    timed.advance(UNTIL)
    begin, momentum = _below(solver, mass), np.concatenate(solver.momentum())
    given, exchanged = np.zeros(6), np.zeros(2)
    for _ in range(round(duration / 0.05)):
        timed.advance(0.05)
        given += solver.ledger.sum(0)
        impulse = solver.collider_impulse(0, np.zeros(3))
        exchanged += np.linalg.norm([impulse.force, impulse.torque], axis=1)
    passed = _below(solver, mass) - begin
    law = len(PLACES) * C * DENSITY * math.sqrt(G) * (diameter - K * diameter / ratio) ** 2.5 * duration
    left = np.concatenate(solver.momentum()) - momentum - given
    errors = {"momentum": float((np.abs(left.reshape(2, 3)).max(1) / exchanged).max())}
    if ratio < 4.0:
        errors["blocked"] = passed / (len(PLACES) * C * DENSITY * math.sqrt(G) * diameter**2.5 * duration)
    else:
        errors["rate"] = passed / law - 1
    return timed.record(errors, passed_g=1e3 * passed, law_g=1e3 * law, particle_g=1e3 * mass)


def _below(solver: mpm.Solver, mass: float) -> float:
    """Return the mass [kg] of the particles, `mass` [kg] each, that are below the can's floor."""
    return mass * float(np.count_nonzero(solver.positions()[:, 2] < BELOW))
