"""Smooth wall that holds sand: it gives way, or is pushed into it.

Measured: relative error of the force on the wall, once it no longer changes. Reference: Rankine's active and passive
state. In plane strain the cone acts with the friction angle asin(m3) (see `slope`). A slice one cell thick is computed.
"""

import math

import numpy as np

import mpm
from mpm.scene.scene import Contact
from robosim.studies.verification.cases.beds import SLICE, UPRIGHT, carry, courant_step, resting_body
from robosim.studies.verification.cases.case import Comparison, Record, TimedSolver, case, grid
from robosim.studies.verification.cases.expectations import Within
from robosim.studies.verification.cases.forces.earth_pressure import rankine

HEIGHT, LENGTH, DENSITY, NU, E, G = 0.2, 0.6, 1500.0, 0.3, 1e6, 9.81
PHI_DEG = 30.0
WINDOW = 2e-3
"""Time between readings [s]."""
MOTIONS = {"active": (-0.02, 0.01, 0.3), "passive": (0.05, 0.05, 0.5)}
"""Way of the wall [heights], positive into the sand; its speed [m/s]; share of the way after which the force counts."""


def compare(records: list[Record]) -> list[Comparison]:
    """Return the measured force over Rankine's, by cells over the height."""
    measured: dict[str, list] = {}
    for record in records:
        state = str(record.choices["state"])
        measured.setdefault(state, []).append((record.choices["cells"], record.errors["force"] + 1, state))
    return [Comparison(title="force on a wall over Rankine's", x="cells over the height", y="measured over Rankine's",
                       measured=measured, line=((15.0, 1.0), (65.0, 1.0)), uncertainty=0.08)]


@case(
    source="Rankine 1857, Phil. Trans. 147:9: 0.5 rho g h^2 (1 -+ sin phi) / (1 +- sin phi) on a smooth wall",
    sweep=grid(state=("active", "passive"), cells=(20, 40, 60)),
    quick=grid(state=("active", "passive"), cells=(20,)),
    expectations=[Within("force", 0.08, {"state": s}) for s in ("active", "passive")],
    main_error="force", resolution="cells", compare=compare)
def measure(*, state: str = "active", cells: int = 20, phi_deg: float = PHI_DEG, stiffness: float = E,
            contact: Contact = "touching", precision: str = "f32") -> Record:
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
    start = mpm.Pose(np.array([face - half[0], cell / 2, half[2] - 4 * cell]), UPRIGHT)
    solver = mpm.Solver(
        grid=mpm.Grid((0, 0, 0), (face + length, cell, 1.25 * HEIGHT), cell), precision=precision,
        colliders=[mpm.Collider(mpm.Sdf.box(tuple(half)), friction=0.0, pose=start)],
        walls=SLICE, bodies=[resting_body(sand, positions, volume)], contact=contact, gravity=(0, 0, -G),
        dt=courant_step(0.5, cell, sand))
    timed = TimedSolver(solver)
    timed.settle(0.05)
    way, speed, counted = MOTIONS[state]
    windows = round(abs(way) * HEIGHT / speed / WINDOW)
    forces = [-solver.collider_impulse(0).force[0] / WINDOW / cell
              for _ in carry(timed, lambda k: [k / windows * way * HEIGHT, 0, 0], windows, WINDOW)]
    force = float(np.mean(forces[round(counted * windows):]))
    expected = 0.5 * DENSITY * G * HEIGHT**2 * rankine(phi_deg, state == "passive")
    return timed.record({"force": force / expected - 1}, force_per_width=force, expected=expected,
                        first=forces[0], most=max(forces), least=min(forces))
