"""Rigid block that slides down an incline of sand or of elastic material, or along a level bed without friction.

Measured: the relative error of its acceleration, on a level bed its drag over its weight, and how far it sits above the
bed. Reference: Coulomb's law, g (sin - mu cos), for a block that lies along the incline. A heavy one tips forward by a
degree or more, as the bed gives way at its front, and slides on a steeper face: the error `on_face` is that for the
face as it lies. The block is laid flush, or lowered from above. While it lies on the bed, nothing meets its sides.
"""

import math
from dataclasses import dataclass

import numpy as np

import mpm
from mpm.scene.scene import Contact
from robosim.coupling.plugin import Coupling
from robosim.studies.verification.cases.case import Record, TimedSolver, case, grid
from robosim.studies.verification.cases.coupling.bed import build_bed
from robosim.studies.verification.cases.expectations import Within
from robosim.studies.verification.cases.rigid_body import G, couple, damp, one_body

BEDS, STARTS, CELLS, MASSES = ("elastic", "sand"), ("flush", "lowered"), (0.008, 0.005, 0.004), (0.1, 0.25, 2.5, 5.0)
"""Cells [m], masses [kg]."""
LEVEL = {"bed": "sand", "incline_deg": 0.0, "friction": 0.0}
TOUCHING = {"contact": "touching"}
INCLINE_DEG = 27.0
BED = (0.32, 0.16, 0.032)
SIDE, HEIGHT = 0.096, 0.03
"""Of the block [m], which is so large that sand bears 5 kg."""
HOST_STEP, HELD, SLID = 0.002, 0.15, 0.2
"""[s]: of MuJoCo; how long the block is kept from sliding; and how long it slides."""
START, SPEED = 0.08, 0.2
"""Where the block's middle lies at first [m], and how fast it begins to slide on a level bed [m/s]."""


@dataclass(frozen=True)
class Slide:
    """Choices of a run."""

    bed: str = "sand"
    """Or "elastic"."""
    start: str = "flush"
    """On the bed, or "lowered" from 1.5 cells above it."""
    mass: float = 0.25
    """[kg]"""
    friction: float = 0.3
    cell: float = 0.008
    """[m]"""
    coupling: Coupling = "mobility"
    offset_cells: float = 0.0
    """Of the bed's top from a plane of nodes."""
    contact: Contact = "touching"
    """See `mpm.Solver`."""
    incline_deg: float = INCLINE_DEG
    """The block slides down by itself, or with 0 begins with `SPEED`; the drag is then over its weight, less that of
    its friction."""


@case(
    source="Coulomb's law: a = g (sin - mu cos)",
    sweep=[*grid(bed=BEDS, start=STARTS, cell=CELLS, mass=MASSES),
           *grid(bed=BEDS, start=STARTS, cell=CELLS, friction=(0.0,)),
           *({**LEVEL, **one} for one in grid(start=STARTS, cell=CELLS, mass=(0.25, 5.0))),
           *grid(bed=BEDS, mass=(0.001,), start=STARTS), *grid(bed=BEDS, coupling=("lagged",)),
           *grid(bed=BEDS, contact=("near",)), *grid(bed=("sand",), offset_cells=(0.3, 0.6))],
    quick=[{"bed": "sand", "start": "lowered"}, {"bed": "elastic", "friction": 0.0}, {**LEVEL, "start": "lowered"}],
    # with friction by the incline and by the block's lower face, and without; drag over the weight; the bed gives way
    # under a heavy block
    expectations=(*(Within("acceleration", 0.05, {**TOUCHING, **one})
                    for one in grid(bed=BEDS, start=STARTS, cell=CELLS)),
                  *(Within("on_face", 0.05, {**TOUCHING, "bed": b}) for b in BEDS),
                  Within("acceleration", 0.03, {**TOUCHING, "friction": 0.0}), Within("drag", 0.03, TOUCHING),
                  *(Within("gap", 0.15, {**TOUCHING, "start": "lowered", "cell": c}) for c in CELLS)),
    main_error="acceleration", resolution="cell", units={"gap": "cells"}, options=Slide)
def measure(run: Slide) -> Record:
    """Run the case; return the error of the acceleration, or with incline_deg 0 the drag."""
    cell, friction, incline_deg = run.cell, run.friction, run.incline_deg
    angle = math.radians(incline_deg)
    gravity = (G * math.sin(angle), 0.0, -G * math.cos(angle))
    top = BED[2] + run.offset_cells * cell
    solver = build_bed(run.bed, (*BED[:2], top), cell, headroom=0.1, contact=run.contact, gravity=gravity)
    positions = mpm.sample_box((0.0, 0.0, 0.0), (*BED[:2], top), cell / 2)
    height = top + HEIGHT / 2 + (1.5 * cell if run.start == "lowered" else 0.0)
    size = f"{SIDE / 2} {SIDE / 2} {HEIGHT / 2}"
    plugin = couple(one_body(f'type="box" size="{size}" mass="{run.mass}" friction="{friction}"',
                             (START, BED[1] / 2, height), host_step=HOST_STEP, gravity=gravity), solver, run.coupling)
    data = plugin.data
    timed, speeds, gaps, shares, pitches, is_released = TimedSolver(solver), [], [], [], [], False
    is_top = positions[:, 2] > top - 0.5 * cell
    for step in range(round((HELD + SLID) / HOST_STEP)):
        if step * HOST_STEP < HELD:
            data.qvel[[0, 3, 4, 5]] = 0.0
            if step % 5 == 0:
                damp(plugin, 0.8)
        elif incline_deg == 0.0 and not is_released:
            data.qvel[0], is_released = SPEED, True
        timed.run(plugin.step)
        if (step - 10) * HOST_STEP > HELD:
            speeds.append(data.qvel[0])
            gaps.append(_gap(data.qpos, solver.positions()[is_top], top - positions[:, 2].max(), cell))
            shares.append(plugin.wrench("body").force)
            pitches.append(2.0 * math.asin(data.qpos[5]))
    acceleration = np.polyfit(HOST_STEP * np.arange(len(speeds)), speeds, 1)[0]
    exact = G * (math.sin(angle) - friction * math.cos(angle))
    along, _, normal = np.mean(shares, axis=0)
    if incline_deg == 0.0:
        errors = {"drag": (exact - acceleration) / G}
    else:
        # the bed's force is at the angle of friction to the normal of the face, which has tipped by the pitch
        tipped = G * (math.sin(angle) - math.cos(angle) * np.tan(math.atan(friction) - np.array(pitches)).mean())
        errors = {"acceleration": acceleration / exact - 1, "on_face": acceleration / tipped - 1}
    errors["gap"] = np.mean(gaps)
    return timed.record(errors, tangential_share=-along / normal, pitch_deg=math.degrees(pitches[-1]),
                        mean_pitch_deg=math.degrees(np.mean(pitches)))


def _gap(place: np.ndarray, grains: np.ndarray, half: float, cell: float) -> float:
    """Return the cells between the block and the bed under it, whose topmost grains (n, 3) reach half [m] higher."""
    is_below = (np.abs(grains[:, :2] - place[:2]) < SIDE / 2 - 2 * cell).all(1)
    return float((place[2] - HEIGHT / 2 - grains[is_below, 2].mean() - half) / cell)
