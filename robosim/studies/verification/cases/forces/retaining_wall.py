"""Smooth wall that holds sand: it gives way, or is pushed into it.

Measured: relative error of the force on the wall, once it no longer changes. Reference: Rankine's active and passive
state. In plane strain the cone acts with the friction angle asin(m3) (see `slope`). A slice one cell thick is computed.
"""

import math

import numpy as np

import mpm
from robosim.studies.verification.cases.claims import Within
from robosim.studies.verification.cases.comparison import Comparison
from robosim.studies.verification.cases.forces.earth_pressure import rankine
from robosim.studies.verification.cases.record import Record, TimedSolver

NAME = "retaining_wall"
SOURCE = "Rankine 1857, Phil. Trans. 147:9: 0.5 rho g h^2 (1 -+ sin phi) / (1 +- sin phi) on a smooth wall"
BANDS = {"force": 0.08}
"""Relative error of the force."""
SWEEP = [{"state": s, "cells": n} for s in ("active", "passive") for n in (20, 40, 60)]
"""Choices of the runs in a whole report."""
QUICK_SWEEP = [{"state": s, "cells": 20} for s in ("active", "passive")]
MAIN_ERROR, RESOLUTION = "force", "cells"
CLAIMS = tuple(Within("force", BANDS["force"], {"state": s}) for s in ("active", "passive"))
HEIGHT, LENGTH, DENSITY, NU, E, G = 0.2, 0.6, 1500.0, 0.3, 1e6, 9.81
PHI_DEG = 30.0
WINDOW = 2e-3
"""Time between readings [s]."""
MOTIONS = {"active": (-0.02, 0.01, 0.3), "passive": (0.05, 0.05, 0.5)}
"""Way of the wall [heights], positive into the sand; its speed [m/s]; share of the way after which the force counts."""


def measure(*, state: str = "active", cells: int = 20, phi_deg: float = PHI_DEG, stiffness: float = E,
            contact: str = "touching", precision: str = "f32") -> Record:
    """Run the case; return the relative error of the force.

    state: "active" or "passive"; cells: over the height; phi_deg: friction angle in plane strain; stiffness: Young's
    modulus [Pa]; contact: see `mpm.Solver`.
    """
    cell = HEIGHT / cells
    sand = mpm.DruckerPrager(E=stiffness, nu=NU, density=DENSITY, friction_angle_deg=phi_deg, cone="plane_strain")
    face, length = 8 * cell, math.ceil(LENGTH / cell) * cell
    positions = mpm.sample_box((face, 0, 0), (face + length, cell, HEIGHT), cell / 2)
    volume = length * cell * HEIGHT / len(positions)
    half = np.array([4 * cell, 4 * cell, HEIGHT])
    start = mpm.Pose(np.array([face - half[0], cell / 2, half[2] - 4 * cell]), mpm.Pose.identity().quaternion)
    solver = mpm.Solver(
        grid=mpm.Grid((0, 0, 0), (face + length, cell, 1.25 * HEIGHT), cell), precision=precision,
        colliders=[mpm.Collider(mpm.Sdf.box(tuple(half)), friction=0.0, pose=start)],
        walls=mpm.Walls(lower=("slip", "periodic", "friction"), upper=("slip", "periodic", "slip")),
        bodies=[mpm.Body(sand, positions, volume=volume, stress=mpm.geostatic_stress(positions, volume, sand))],
        contact=contact, gravity=(0, 0, -G),  # pyright: ignore[reportArgumentType]
        dt=0.5 * cell / math.sqrt((sand.lam + 2 * sand.mu) / DENSITY))
    timed = TimedSolver(solver)
    timed.settle(0.05)
    way, speed, counted = MOTIONS[state]
    windows = round(abs(way) * HEIGHT / speed / WINDOW)
    forces, here = [], start
    for k in range(windows):
        there = mpm.Pose(start.position + [(k + 1) / windows * way * HEIGHT, 0, 0], start.quaternion)
        solver.set_collider_motion(0, here, there)
        timed.advance(WINDOW)
        forces.append(-solver.collider_impulse(0).force[0] / WINDOW / cell)
        here = there
    passive = state == "passive"
    force = float(np.mean(forces[round(counted * windows):]))
    expected = 0.5 * DENSITY * G * HEIGHT**2 * rankine(phi_deg, passive)
    choices = {"state": state, "cells": cells, "phi_deg": phi_deg, "stiffness": stiffness, "contact": contact,
               "precision": precision}
    return timed.record(NAME, choices, {"force": force / expected - 1}, force_per_width=force, expected=expected,
                        first=forces[0], most=max(forces), least=min(forces))


def compare(records: list[Record]) -> list[Comparison]:
    """Return the measured force over Rankine's, by cells over the height."""
    measured: dict[str, list] = {}
    for record in records:
        state = str(record.choices["state"])
        measured.setdefault(state, []).append((record.choices["cells"], record.errors["force"] + 1, state))
    return [Comparison(title="force on a wall over Rankine's", x="cells over the height", y="measured over Rankine's",
                       measured=measured, line=((15.0, 1.0), (65.0, 1.0)), uncertainty=BANDS["force"],
                       source=SOURCE)]
