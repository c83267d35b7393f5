"""A cube that floats on water."""

from typing import Literal

import numpy as np

import mpm
from robosim.studies.verification.cases.beds import hydrostatic_stress, set_up
from robosim.studies.verification.cases.case import Record, case, grid
from robosim.studies.verification.cases.expectations import Within
from robosim.studies.verification.cases.rigid_body import G, couple, damp, one_body

DENSITY = 1000.0
SIDE, WIDTH, DEPTH, SOUND, HOST_STEP = 0.08, 0.24, 0.14, 12.0, 0.004
"""Of the cube and its tank."""


def accepted(cell: float, density_ratio: float) -> float:
    """Return the tolerance of the draught [sides]: half a cell plus 2 % of it."""
    return 0.5 * cell / SIDE + 0.02 * density_ratio


@case(
    source="Archimedes: draught / side = density / density of water",
    sweep=[*grid(cell=(0.01, 0.008), offset_cells=(0.0, 0.5), fixed=(False, True))],
    quick=[{"cell": 0.008, "offset_cells": 0.5, "fixed": True}],
    expectations=(*(Within("draught", accepted(c, 0.8), {"cell": c, "fixed": False}) for c in (0.01, 0.008)),
                  Within("thrust", 0.03, {"cell": 0.008, "fixed": True})),
    main_error="draught", resolution="cell")
def floating_cube(*, density_ratio: float = 0.8, cell: float = 0.01, offset_cells: float = 0.0, fixed: bool = False,
                  duration: float = 1.2, precision: str = "f32",
                  volume_rate: Literal["particle", "cell"] = "particle") -> Record:
    """Floating cube, lighter than water.

    Measured: error of the draught in sides, and with a fixed cube the relative error of the thrust. offset_cells: of
    the cube's middle from a node along x."""
    middle = WIDTH / 2 + offset_cells * cell
    # on a layer of the grains' lattice: what is cut out is the cube's volume
    bottom = round(0.03 / (cell / 2)) * cell / 2 if fixed else DEPTH - 0.5 * SIDE
    positions = mpm.sample_box((0, 0, 0), (WIDTH, WIDTH, DEPTH), cell / 2)
    volume = WIDTH**2 * DEPTH / len(positions)
    offset = np.abs(positions - [middle, WIDTH / 2, bottom + SIDE / 2]).max(1)
    positions = positions[offset > SIDE / 2]
    water = mpm.NewtonianFluid(bulk_modulus=DENSITY * SOUND**2, density=DENSITY, volume_rate=volume_rate)
    stress = hydrostatic_stress(water, DEPTH - positions[:, 2])
    timed, solver = set_up(mpm.Body(water, positions, volume=volume, stress=stress), (WIDTH, WIDTH, DEPTH + SIDE), cell,
                           precision=precision, walls=mpm.Walls.all("slip"))
    # a fixed cube hangs on a joint that is far too heavy to be moved
    joint = '<joint type="slide" axis="0 0 1" armature="1e9"/>' if fixed else "<freejoint/>"
    half = SIDE / 2
    plugin = couple(one_body(
        f'type="box" size="{half} {half} {half}" mass="{density_ratio * DENSITY * SIDE**3}" friction="0"',
        (middle, WIDTH / 2, bottom + SIDE / 2), joint=joint, host_step=HOST_STEP), solver)
    data, thrusts, draughts, tilts = plugin.data, [], [], []
    for step in range(round(duration / HOST_STEP)):
        timed.run(plugin.step)
        if step * HOST_STEP < duration / 2:  # to rest: a little of all motion is taken away
            damp(plugin, 0.97)
        else:
            thrusts.append(plugin.wrench("body").force[2])
            low = data.xpos[1][2] - SIDE / 2
            draughts.append((len(positions) * volume / WIDTH**2 - low) / (1 - SIDE**2 / WIDTH**2))
            tilts.append(data.xmat[1][8])
    thrust = np.mean(thrusts) / (DENSITY * G * SIDE**3) - 1
    error = np.mean(draughts) / SIDE - density_ratio
    errors = {"thrust": thrust} if fixed else {"draught": error, "weight": thrust + 1 - density_ratio}
    return timed.record(errors, accepted=accepted(cell, density_ratio),
                        tilt_deg=np.degrees(np.arccos(min(np.mean(tilts), 1.0))))
