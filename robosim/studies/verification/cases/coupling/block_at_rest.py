"""Rigid block at rest on an elastic bed or on sand.

Measured: relative errors of the mean reaction and of the settlement, and the drift [m/s] along the bed. Reference:
statics, the reaction m g and the settlement m g L / (E A) of a bar of Poisson's ratio 0.
"""

import mujoco
import numpy as np

import mpm
from mpm.scene.features import Contact
from robosim.coupling.plugin import GranularPlugin
from robosim.studies.verification.cases.claims import Within
from robosim.studies.verification.cases.record import Record, TimedSolver

NAME = "block_at_rest"
SOURCE = "statics: reaction m g; settlement of a bar of Poisson's ratio 0: m g L / (E A)"
BANDS = {"reaction": 0.01, "settlement": 0.05, "drift": 1e-4}
"""Relative errors of the mean reaction over half a second and of the settlement; drift along the bed [m/s]."""
SWEEP = [*({"bed": b, "coupling": c, "offset_cells": o} for b in ("elastic", "sand") for c in ("mobility", "lagged")
           for o in (0.0, 0.5)),
         *({"bed": b, "contact": "touching"} for b in ("elastic", "sand"))]
"""Choices of the runs in a whole report."""
QUICK_SWEEP = [{"bed": "elastic", "coupling": "mobility", "offset_cells": 0.0}]
MAIN_ERROR, RESOLUTION = "reaction", None
CLAIMS = tuple(Within(name, bound, {"coupling": "mobility", "contact": c}) for c in ("near", "touching")
               for name, bound in BANDS.items())
E, SIDE, MASS, G = 1e5, 0.1, 1.0, 9.81
HOST_STEP = 0.002

BLOCK = """
<mujoco>
  <option timestep="{host_step}" integrator="implicitfast"/>
  <worldbody>
    <body name="block" pos="{x} {x} {z}">
      <freejoint/>
      <geom type="box" size="{half} {half} 0.02" mass="{mass}" friction="0.5"/>
    </body>
  </worldbody>
</mujoco>
"""


def measure(*, bed: str = "elastic", coupling: str = "mobility", cell: float = 0.01, offset_cells: float = 0.0,
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
    model = mujoco.MjModel.from_xml_string(BLOCK.format(host_step=HOST_STEP, x=width / 2, z=height + 0.02, half=half,
                                                        mass=mass if elastic else 0.2 * mass))
    data = mujoco.MjData(model)
    plugin = GranularPlugin(model, data, solver, bodies={"block": None}, coupling=coupling)  # pyright: ignore[reportArgumentType]
    timed, forces, places = TimedSolver(solver), [], []
    for step in range(round(1.5 / HOST_STEP)):
        timed.run(plugin.step)
        if step * HOST_STEP < 1.0:
            state = solver.state()
            state["v"] *= 0.9
            solver.load(state)
            data.qvel *= 0.9
        else:
            forces.append(plugin.wrench("block").force[2])
            places.append(data.qpos[:3].copy())
    weight = model.body_mass[1] * G
    errors = {"reaction": np.mean(forces) / weight - 1,
              "drift": np.linalg.norm((places[-1] - places[0])[:2]) / (len(places) * HOST_STEP)}
    if elastic:
        sunk = height + 0.02 - np.mean(places, axis=0)[2]
        errors["settlement"] = sunk / (weight * height / (E * SIDE**2)) - 1
    choices = {"bed": bed, "coupling": coupling, "cell": cell, "offset_cells": offset_cells, "contact": contact,
               "precision": precision}
    return timed.record(NAME, choices, errors, ripple=float(np.std(forces) / weight),
                        sunk_mm=float(1e3 * (height + 0.02 - places[-1][2])))
