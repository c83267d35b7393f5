"""Light ball or box at rest on a level bed, lowered from above.

Measured: how far its lowest point is above the bed. Reference: it lies on the bed; a ball dents an elastic one as Hertz
says. It is so light that sand bears it.
"""

import mujoco
import numpy as np

import mpm
from mpm.scene.features import Contact
from robosim.coupling.plugin import GranularPlugin
from robosim.studies.verification.cases.claims import Within
from robosim.studies.verification.cases.record import Record, TimedSolver

NAME = "rest_height"
SOURCE = "statics: what is light lies on the bed; Hertz (1881): dent of a ball (9 F^2 / (16 R E*^2))^(1/3)"
BANDS = {"gap": 0.15}
"""Cells between body and bed."""
CELLS, BEDS = (0.008, 0.005, 0.004), ("elastic", "sand")
BODIES = (("ball", 2e-4), ("ball", 1e-3), ("box", 1e-3), ("box", 0.1))
"""Shapes and masses [kg]."""
SWEEP = [*({"bed": b, "shape": s, "mass": m, "cell": c} for b in BEDS for s, m in BODIES for c in CELLS),
         *({"bed": "sand", "shape": s, "offset_cells": o} for s in ("ball", "box") for o in (0.3, 0.6)),
         *({"bed": "sand", "shape": s, "contact": "near"} for s in ("ball", "box"))]
"""Choices of the runs in a whole report."""
QUICK_SWEEP = [{"bed": "sand", "shape": s} for s in ("ball", "box")]
MAIN_ERROR, RESOLUTION = "gap", "cell"
CLAIMS = tuple(Within("gap", BANDS["gap"], {"contact": "touching", "shape": s, "cell": c})
               for s in ("ball", "box") for c in CELLS)
G, WIDTH, DEPTH = 9.81, 0.096, 0.032
"""[m/s^2]; of the bed [m]."""
RADIUS, HALF = 0.010, (0.016, 0.016, 0.008)
"""Of the ball, and half sizes of the box [m]."""
HOST_STEP, LOWERED, RESTS = 0.002, 0.25, 0.1
"""[s]: of MuJoCo; how long motion is damped; and how long the height is averaged."""

BODY = """
<mujoco>
  <option timestep="{host_step}" integrator="implicitfast" gravity="0 0 -{g}"/>
  <worldbody>
    <body name="body" pos="{x} {x} {z}">
      <freejoint/>
      <geom type="{type}" size="{size}" mass="{mass}" friction="0.3"/>
    </body>
  </worldbody>
</mujoco>
"""


def measure(*, bed: str = "sand", shape: str = "ball", mass: float = 1e-3, cell: float = 0.008,
            offset_cells: float = 0.0, contact: Contact = "touching", precision: str = "f32") -> Record:
    """Run the case; return the gap between body and bed [cells].

    bed: "sand" or "elastic". shape: "ball" or "box". mass [kg]; cell [m]; offset_cells: of the bed's top from a plane
    of nodes. contact: see `mpm.Solver`.
    """
    top, is_elastic, is_ball = DEPTH + offset_cells * cell, bed == "elastic", shape == "ball"
    positions = mpm.sample_box((0.0, 0.0, 0.0), (WIDTH, WIDTH, top), cell / 2)
    law = mpm.Elastic(E=5e5, nu=0.0, density=1000.0) if is_elastic else \
        mpm.DruckerPrager(E=3e5, nu=0.2, density=1500.0, friction_angle_deg=40.0)
    solver = mpm.Solver(
        grid=mpm.Grid((0.0, 0.0, 0.0), (WIDTH, WIDTH, top + 0.06), cell), precision=precision, gravity=(0.0, 0.0, -G),
        bodies=[mpm.Body(law, positions, volume=WIDTH**2 * top / len(positions))], walls=mpm.Walls.all("stick"),
        contact=contact,
        # an elastic bed bears the body alone, not itself
        body_acceleration=np.tile([0.0, 0.0, G], (len(positions), 1)) if is_elastic else None)
    below = RADIUS if is_ball else HALF[2]
    model = mujoco.MjModel.from_xml_string(BODY.format(
        host_step=HOST_STEP, g=G, x=WIDTH / 2, z=top + below + 1.5 * cell, type="sphere" if is_ball else "box",
        size=RADIUS if is_ball else "{} {} {}".format(*HALF), mass=mass))
    data = mujoco.MjData(model)
    plugin = GranularPlugin(model, data, solver, bodies={"body": None})
    timed, heights = TimedSolver(solver), []
    for step in range(round((LOWERED + RESTS) / HOST_STEP)):
        if step * HOST_STEP < LOWERED and step % 5 == 0:
            state = solver.state()
            state["v"] *= 0.8
            solver.load(state)
            data.qvel *= 0.8
        timed.run(plugin.step)
        if step * HOST_STEP >= LOWERED:
            heights.append(data.qpos[2])
    dent = (9 * (mass * G) ** 2 / (16 * RADIUS * law.E**2)) ** (1 / 3) if is_elastic and is_ball else 0.0
    choices = {"bed": bed, "shape": shape, "mass": mass, "cell": cell, "offset_cells": offset_cells,
               "contact": contact, "precision": precision}
    return timed.record(NAME, choices, {"gap": (np.mean(heights) - below - top + dent) / cell},
                        upright=float(data.xmat[1][8]), dent_cells=dent / cell,
                        rise_mm=1e3 * float(heights[-1] - heights[0]))
