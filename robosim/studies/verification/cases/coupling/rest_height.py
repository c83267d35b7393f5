"""Light ball or box at rest on a level bed, lowered from above.

Measured: how far its lowest point is above the bed. Reference: it lies on the bed; a ball dents an elastic one as Hertz
says. It is so light that sand bears it.
"""

import numpy as np

from mpm.scene.scene import Contact
from robosim.studies.verification.cases.case import Record, TimedSolver, case, grid
from robosim.studies.verification.cases.coupling.bed import ELASTIC_E, build_bed
from robosim.studies.verification.cases.expectations import Within
from robosim.studies.verification.cases.rigid_body import G, couple, damp, one_body

CELLS = (0.008, 0.005, 0.004)
WIDTH, DEPTH = 0.096, 0.032
"""Of the bed [m]."""
RADIUS, HALF = 0.010, (0.016, 0.016, 0.008)
"""Of the ball, and half sizes of the box [m]."""
HOST_STEP, LOWERED, RESTS = 0.002, 0.25, 0.1
"""[s]: of MuJoCo; how long motion is damped; and how long the height is averaged."""


@case(
    source="statics: what is light lies on the bed; Hertz (1881): dent of a ball (9 F^2 / (16 R E*^2))^(1/3)",
    sweep=[*({"bed": b, "shape": s, "mass": m, "cell": c} for b in ("elastic", "sand") for s, m in (
               ("ball", 2e-4), ("ball", 1e-3), ("box", 1e-3), ("box", 0.1)) for c in CELLS),
           *grid(bed=("sand",), shape=("ball", "box"), offset_cells=(0.3, 0.6)),
           *grid(bed=("sand",), shape=("ball", "box"), contact=("near",))],
    quick=grid(bed=("sand",), shape=("ball", "box")),
    expectations=[Within("gap", 0.15, {"contact": "touching", "shape": s, "cell": c})
                  for s in ("ball", "box") for c in CELLS],
    main_error="gap", resolution="cell", units={"gap": "cells"})
def measure(*, bed: str = "sand", shape: str = "ball", mass: float = 1e-3, cell: float = 0.008,
            offset_cells: float = 0.0, contact: Contact = "touching", precision: str = "f32") -> Record:
    """Run the case; return the gap between body and bed [cells].

    bed: "sand" or "elastic". shape: "ball" or "box". mass [kg]; cell [m]; offset_cells: of the bed's top from a plane
    of nodes. contact: see `mpm.Solver`.
    """
    top, is_elastic, is_ball = DEPTH + offset_cells * cell, bed == "elastic", shape == "ball"
    solver = build_bed(bed, (WIDTH, WIDTH, top), cell, headroom=0.06, contact=contact, precision=precision)
    below = RADIUS if is_ball else HALF[2]
    shape_of = f'type="sphere" size="{RADIUS}"' if is_ball else 'type="box" size="{} {} {}"'.format(*HALF)
    plugin = couple(one_body(f'{shape_of} mass="{mass}" friction="0.3"',
                             (WIDTH / 2, WIDTH / 2, top + below + 1.5 * cell), host_step=HOST_STEP), solver)
    data = plugin.data
    timed, heights = TimedSolver(solver), []
    for step in range(round((LOWERED + RESTS) / HOST_STEP)):
        if step * HOST_STEP < LOWERED and step % 5 == 0:
            damp(plugin, 0.8)
        timed.run(plugin.step)
        if step * HOST_STEP >= LOWERED:
            heights.append(data.qpos[2])
    dent = (9 * (mass * G) ** 2 / (16 * RADIUS * ELASTIC_E**2)) ** (1 / 3) if is_elastic and is_ball else 0.0
    return timed.record({"gap": (np.mean(heights) - below - top + dent) / cell},
                        upright=data.xmat[1][8],
                        dent_cells=dent / cell, rise_mm=1e3 * float(heights[-1] - heights[0]))
