"""Rigid block at rest on an elastic bed or on sand.

Measured: relative errors of the mean reaction and of the settlement, and the drift [m/s] along the bed. Reference:
statics, the reaction m g and the settlement m g L / (E A) of a bar of Poisson's ratio 0.
"""

import numpy as np

import mpm
from mpm.scene.scene import Contact
from robosim.coupling.plugin import Coupling
from robosim.studies.verification.cases.case import Record, TimedSolver, case, grid
from robosim.studies.verification.cases.expectations import each_within
from robosim.studies.verification.cases.rigid_body import couple, damp, one_body

E, SIDE, MASS, G = 1e5, 0.1, 1.0, 9.81
HOST_STEP = 0.002


@case(
    source="statics: reaction m g; settlement of a bar of Poisson's ratio 0: m g L / (E A)",
    sweep=[*grid(bed=("elastic", "sand"), coupling=("mobility", "lagged"), offset_cells=(0.0, 0.5)),
           *grid(bed=("elastic", "sand"), contact=("touching",))],
    quick=[{"bed": "elastic", "coupling": "mobility", "offset_cells": 0.0}],
    expectations=[one for contact in ("near", "touching") for one in each_within(
        {"reaction": 0.01, "settlement": 0.05, "drift": 1e-4}, {"coupling": "mobility", "contact": contact})],
    main_error="reaction", units={"drift": "m/s"})
def measure(*, bed: str = "elastic", coupling: Coupling = "mobility", cell: float = 0.01, offset_cells: float = 0.0,
            precision: str = "f32", mass: float = MASS, contact: Contact = "near") -> Record:
    """Run the case; return the errors of reaction, drift and, on an elastic bed, settlement.

    cell [m]; offset_cells: of the bed's top from a plane of nodes; mass [kg]. contact: see `mpm.Solver`.
    """
    height = SIDE + offset_cells * cell
    elastic = bed == "elastic"
    margin = 0.05 if elastic else 0.0
    box = (margin, margin, 0.0), (margin + SIDE, margin + SIDE, height)
    positions = mpm.sample_box(*box, cell / 2)
    law = mpm.Elastic(E=E, nu=0.0, density=1000.0) if elastic else \
        mpm.DruckerPrager(E=E, nu=0.2, density=1500.0, friction_angle_deg=30.0)
    width = SIDE + 2 * margin
    solver = mpm.Solver(
        grid=mpm.Grid((0, 0, 0), (width, width, 0.2), cell), precision=precision, walls=mpm.Walls.all("slip"),
        bodies=[mpm.Body(law, positions, volume=SIDE**2 * height / len(positions))], contact=contact,
        # an elastic bed bears the block alone, not itself: what settles is the block's doing
        body_acceleration=np.tile([0.0, 0.0, G], (len(positions), 1)) if elastic else None)
    half = SIDE / 2 + 2 * cell if elastic else 0.3 * SIDE
    mass = mass if elastic else 0.2 * mass
    plugin = couple(one_body(f'type="box" size="{half} {half} 0.02" mass="{mass}" friction="0.5"',
                             (width / 2, width / 2, height + 0.02), host_step=HOST_STEP), solver, coupling)
    data = plugin.data
    timed, forces, places = TimedSolver(solver), [], []
    for step in range(round(1.5 / HOST_STEP)):
        timed.run(plugin.step)
        if step * HOST_STEP < 1.0:
            damp(plugin, 0.9)
        else:
            forces.append(plugin.wrench("body").force[2])
            places.append(data.qpos[:3].copy())
    weight = plugin.model.body_mass[1] * G
    errors = {"reaction": np.mean(forces) / weight - 1,
              "drift": np.linalg.norm((places[-1] - places[0])[:2]) / (len(places) * HOST_STEP)}
    if elastic:
        sunk = height + 0.02 - np.mean(places, axis=0)[2]
        errors["settlement"] = sunk / (weight * height / (E * SIDE**2)) - 1
    return timed.record(errors, ripple=np.std(forces) / weight, sunk_mm=1e3 * (height + 0.02 - places[-1][2]))
