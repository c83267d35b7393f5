"""Floating cube, lighter than water.

Measured: error of the draught in sides, and with a fixed cube the relative error of the thrust. Reference: Archimedes'
principle, draught / side = density / density of water.
"""

from typing import Literal

import mujoco
import numpy as np

import mpm
from mpm.scene.features import Contact
from robosim.coupling.plugin import GranularPlugin
from robosim.studies.verification.cases.claims import Within
from robosim.studies.verification.cases.record import Record, TimedSolver

NAME = "floating_cube"
SOURCE = "Archimedes: draught / side = density / density of water"
BANDS = {"cells": 0.5, "share": 0.02, "thrust": 0.03}
"""Accepted error of the draught: half a cell plus a share of it; of the thrust on a fixed immersed cube, relative."""
SWEEP = [*({"cell": c, "offset_cells": o, "fixed": f} for c in (0.01, 0.008) for o in (0.0, 0.5)
           for f in (False, True)),
         *({"cell": 0.008, "offset_cells": o, "fixed": True, "contact": "touching"} for o in (0.0, 0.5))]
"""Choices of the runs in a whole report."""
QUICK_SWEEP = [{"cell": 0.008, "offset_cells": 0.5, "fixed": True}]
MAIN_ERROR, RESOLUTION = "draught", "cell"
CLAIMS = (*(Within("draught", BANDS["cells"] * c / 0.08 + BANDS["share"] * 0.8, {"cell": c, "fixed": False})
            for c in (0.01, 0.008)), Within("thrust", BANDS["thrust"], {"cell": 0.008, "fixed": True}))
SIDE, WIDTH, DEPTH = 0.08, 0.24, 0.14
DENSITY, G, SOUND = 1000.0, 9.81, 12.0
HOST_STEP = 0.004

CUBE = """
<mujoco>
  <option timestep="{host_step}" integrator="implicitfast"/>
  <worldbody>
    <body name="cube" pos="{x} {y} {z}">
      {joint}
      <geom type="box" size="{half} {half} {half}" mass="{mass}" friction="0"/>
    </body>
  </worldbody>
</mujoco>
"""


def measure(*, density_ratio: float = 0.8, cell: float = 0.01, offset_cells: float = 0.0, fixed: bool = False,
            duration: float = 1.2, contact: Contact = "near", precision: str = "f32",
            volume_rate: Literal["particle", "cell"] = "particle") -> Record:
    """Run the case; return the error of the draught, or with `fixed` of the thrust on an immersed cube.

    cell [m]; duration [s]; offset_cells: of the cube's middle from a node along x. contact: see `mpm.Solver`;
    volume_rate: see `mpm.NewtonianFluid`.
    """
    middle = WIDTH / 2 + offset_cells * cell
    # on a layer of the grains' lattice: what is cut out is the cube's volume
    bottom = round(0.03 / (cell / 2)) * cell / 2 if fixed else DEPTH - 0.5 * SIDE
    positions = mpm.sample_box((0, 0, 0), (WIDTH, WIDTH, DEPTH), cell / 2)
    volume = WIDTH**2 * DEPTH / len(positions)
    offset = np.abs(positions - [middle, WIDTH / 2, bottom + SIDE / 2]).max(1)
    positions = positions[offset > SIDE / 2]
    water = mpm.NewtonianFluid(bulk_modulus=DENSITY * SOUND**2, density=DENSITY, volume_rate=volume_rate)
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (WIDTH, WIDTH, DEPTH + SIDE), cell), precision=precision,
                        bodies=[mpm.Body(water, positions, volume=volume)], walls=mpm.Walls.all("slip"),
                        contact=contact)
    state = solver.state()
    state["j"][:, 0] = -DENSITY * G * (DEPTH - positions[:, 2]) / water.bulk_modulus
    solver.load(state)
    # a fixed cube hangs on a joint that is far too heavy to be moved
    joint = '<joint type="slide" axis="0 0 1" armature="1e9"/>' if fixed else "<freejoint/>"
    model = mujoco.MjModel.from_xml_string(CUBE.format(
        host_step=HOST_STEP, x=middle, y=WIDTH / 2, z=bottom + SIDE / 2, half=SIDE / 2, joint=joint,
        mass=density_ratio * DENSITY * SIDE**3))
    data = mujoco.MjData(model)
    plugin = GranularPlugin(model, data, solver, bodies={"cube": None})
    timed, thrusts, draughts, tilts = TimedSolver(solver), [], [], []
    for step in range(round(duration / HOST_STEP)):
        timed.run(plugin.step)
        if step * HOST_STEP < duration / 2:  # to rest: a little of all motion is taken away
            state = solver.state()
            state["v"] *= 0.97
            solver.load(state)
            data.qvel *= 0.97
        else:
            thrusts.append(plugin.wrench("cube").force[2])
            low = data.xpos[1][2] - SIDE / 2
            draughts.append((len(positions) * volume / WIDTH**2 - low) / (1 - SIDE**2 / WIDTH**2))
            tilts.append(data.xmat[1][8])
    thrust = np.mean(thrusts) / (DENSITY * G * SIDE**3) - 1
    error = np.mean(draughts) / SIDE - density_ratio
    choices = {"density_ratio": density_ratio, "cell": cell, "offset_cells": offset_cells, "fixed": fixed,
               "contact": contact, "precision": precision, "volume_rate": volume_rate}
    top = np.percentile(solver.positions()[np.abs(solver.positions()[:, 0] - middle) > 0.07, 2], 99)
    errors = {"thrust": thrust} if fixed else {"draught": error, "weight": thrust + 1 - density_ratio}
    return timed.record(NAME, choices, errors, accepted=BANDS["cells"] * cell / SIDE + BANDS["share"] * density_ratio,
                        tilt_deg=float(np.degrees(np.arccos(min(np.mean(tilts), 1.0)))),
                        draught_from_highest_grains=float((top - (data.xpos[1][2] - SIDE / 2)) / SIDE))
