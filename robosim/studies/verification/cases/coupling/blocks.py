"""Rigid bodies that rest or slide on beds of sand and of elastic material."""

import math
from dataclasses import dataclass

import numpy as np

import mpm
from robosim.coupling.plugin import Coupling
from robosim.studies.verification.cases.case import Record, TimedSolver, case, grid
from robosim.studies.verification.cases.expectations import Within, each_within
from robosim.studies.verification.cases.rigid_body import G, couple, damp, one_body

BEDS = ("elastic", "sand")
HOST_STEP = 0.002
E, SIDE, MASS = 1e5, 0.1, 1.0
"""Of the bed that bears a block at rest, and of that block."""
ELASTIC_E = 5e5
"""Young's modulus [Pa] of the elastic bed below light bodies."""
CELLS, WIDTH, DEPTH = (0.008, 0.005, 0.004), 0.096, 0.032
"""WIDTH, DEPTH: of the bed on which bodies are lowered [m]."""
RADIUS, HALF = 0.010, (0.016, 0.016, 0.008)
"""Of the ball, and half sizes of the box [m]."""
LOWERED, RESTS = 0.25, 0.1
"""[s]: how long motion is damped; and how long the height is averaged."""
STARTS, MASSES = ("flush", "lowered"), (0.1, 0.25, 2.5, 5.0)
LEVEL = {"bed": "sand", "incline_deg": 0.0, "friction": 0.0}
SLIDE_BED = (0.32, 0.16, 0.032)
SLIDER, HEIGHT = 0.096, 0.03
"""Of the block that slides [m], which is so large that sand bears 5 kg."""
HELD, SLID = 0.15, 0.2
"""[s]: how long the block is kept from sliding; and how long it slides."""
START, SPEED = 0.08, 0.2
"""Where the block's middle lies at first [m], and how fast it begins to slide on a level bed [m/s]."""


@case(
    source="statics: reaction m g; settlement of a bar of Poisson's ratio 0: m g L / (E A)",
    sweep=[*grid(bed=BEDS, coupling=("mobility", "lagged"), offset_cells=(0.0, 0.5))],
    quick=[{"bed": "elastic", "coupling": "mobility", "offset_cells": 0.0}],
    expectations=each_within({"reaction": 0.01, "settlement": 0.05, "drift": 1e-4}, {"coupling": "mobility"}),
    main_error="reaction", units={"drift": "m/s"})
def block_at_rest(*, bed: str = "elastic", coupling: Coupling = "mobility", cell: float = 0.01,
                  offset_cells: float = 0.0, precision: str = "f32", mass: float = MASS) -> Record:
    """Rigid block at rest on an elastic bed or on sand.

    Measured: relative errors of the mean reaction and, on an elastic bed, of the settlement; the drift [m/s] along the
    bed. offset_cells: of the bed's top from a plane of nodes."""
    height, elastic = SIDE + offset_cells * cell, bed == "elastic"
    margin = 0.05 if elastic else 0.0
    positions = mpm.sample_box((margin, margin, 0.0), (margin + SIDE, margin + SIDE, height), cell / 2)
    law = mpm.Elastic(E=E, nu=0.0, density=1000.0) if elastic else \
        mpm.DruckerPrager(E=E, nu=0.2, density=1500.0, friction_angle_deg=30.0)
    width = SIDE + 2 * margin
    solver = mpm.Solver(
        grid=mpm.Grid((0, 0, 0), (width, width, 0.2), cell), precision=precision, walls=mpm.Walls.all("slip"),
        bodies=[mpm.Body(law, positions, volume=SIDE**2 * height / len(positions))],
        # an elastic bed bears the block alone, not itself: what settles is the block's doing
        body_acceleration=np.tile([0.0, 0.0, G], (len(positions), 1)) if elastic else None)
    half = SIDE / 2 + 2 * cell if elastic else 0.3 * SIDE
    mass = mass if elastic else 0.2 * mass
    plugin = couple(one_body(f'type="box" size="{half} {half} 0.02" mass="{mass}" friction="0.5"',
                             (width / 2, width / 2, height + 0.02), host_step=HOST_STEP), solver, coupling)
    timed, forces, places = TimedSolver(solver), [], []
    for step in range(round(1.5 / HOST_STEP)):
        timed.run(plugin.step)
        if step * HOST_STEP < 1.0:
            damp(plugin, 0.9)
        else:
            forces.append(plugin.wrench("body").force[2])
            places.append(plugin.data.qpos[:3].copy())
    weight = plugin.model.body_mass[1] * G
    errors = {"reaction": np.mean(forces) / weight - 1,
              "drift": np.linalg.norm((places[-1] - places[0])[:2]) / (len(places) * HOST_STEP)}
    if elastic:
        sunk = height + 0.02 - np.mean(places, axis=0)[2]
        errors["settlement"] = sunk / (weight * height / (E * SIDE**2)) - 1
    return timed.record(errors, ripple=np.std(forces) / weight, sunk_mm=1e3 * (height + 0.02 - places[-1][2]))


def build_bed(kind: str, size: tuple[float, float, float], cell: float, *, headroom: float,
              gravity: tuple[float, float, float] = (0.0, 0.0, -G), precision: str = "f32") -> mpm.Solver:
    """Build a bed that sticks to its walls, on which light bodies lie and slide.
    kind: "sand" or "elastic", which bears a body but not itself; size, cell, headroom above the bed [m]."""
    length, width, top = size
    positions, elastic = mpm.sample_box((0.0, 0.0, 0.0), size, cell / 2), kind == "elastic"
    law = mpm.Elastic(E=ELASTIC_E, nu=0.0, density=1000.0) if elastic else \
        mpm.DruckerPrager(E=3e5, nu=0.2, density=1500.0, friction_angle_deg=40.0)
    return mpm.Solver(grid=mpm.Grid((0.0, 0.0, 0.0), (length, width, top + headroom), cell), gravity=gravity,
                      bodies=[mpm.Body(law, positions, volume=length * width * top / len(positions))],
                      walls=mpm.Walls.all("stick"), precision=precision,
                      body_acceleration=np.tile(-np.array(gravity), (len(positions), 1)) if elastic else None)


@case(
    source="statics: what is light lies on the bed; Hertz (1881): dent of a ball (9 F^2 / (16 R E*^2))^(1/3)",
    sweep=[*({"bed": b, "shape": s, "mass": m, "cell": c} for b in BEDS for s, m in (
               ("ball", 2e-4), ("ball", 1e-3), ("box", 1e-3), ("box", 0.1)) for c in CELLS),
           *grid(bed=("sand",), shape=("ball", "box"), offset_cells=(0.3, 0.6))],
    quick=grid(bed=("sand",), shape=("ball", "box")),
    expectations=[Within("gap", 0.15, {"shape": s, "cell": c})
                  for s in ("ball", "box") for c in CELLS],
    main_error="gap", resolution="cell", units={"gap": "cells"})
def rest_height(*, bed: str = "sand", shape: str = "ball", mass: float = 1e-3, cell: float = 0.008,
                offset_cells: float = 0.0, precision: str = "f32") -> Record:
    """Light ball or box at rest on a level bed, lowered from above.

    Measured: how far its lowest point is above the bed [cells]. A ball dents an elastic bed; it is so light that sand
    bears it. bed: "sand" or "elastic". shape: "ball" or "box". offset_cells: of the bed's top from a plane of nodes."""
    top, is_elastic, is_ball = DEPTH + offset_cells * cell, bed == "elastic", shape == "ball"
    solver = build_bed(bed, (WIDTH, WIDTH, top), cell, headroom=0.06, precision=precision)
    below = RADIUS if is_ball else HALF[2]
    shape_of = f'type="sphere" size="{RADIUS}"' if is_ball else 'type="box" size="{} {} {}"'.format(*HALF)
    plugin = couple(one_body(f'{shape_of} mass="{mass}" friction="0.3"',
                             (WIDTH / 2, WIDTH / 2, top + below + 1.5 * cell), host_step=HOST_STEP), solver)
    timed, heights = TimedSolver(solver), []
    for step in range(round((LOWERED + RESTS) / HOST_STEP)):
        if step * HOST_STEP < LOWERED and step % 5 == 0:
            damp(plugin, 0.8)
        timed.run(plugin.step)
        if step * HOST_STEP >= LOWERED:
            heights.append(plugin.data.qpos[2])
    dent = (9 * (mass * G) ** 2 / (16 * RADIUS * ELASTIC_E**2)) ** (1 / 3) if is_elastic and is_ball else 0.0
    return timed.record({"gap": (np.mean(heights) - below - top + dent) / cell}, upright=plugin.data.xmat[1][8],
                        dent_cells=dent / cell, rise_mm=1e3 * float(heights[-1] - heights[0]))


@dataclass(frozen=True)
class Slide:
    """Choices of a run."""

    bed: str = "sand"
    """Or "elastic"."""
    start: str = "flush"
    """On the bed, or "lowered" from 1.5 cells above it."""
    mass: float = 0.25
    friction: float = 0.3
    cell: float = 0.008
    coupling: Coupling = "mobility"
    offset_cells: float = 0.0
    """Of the bed's top from a plane of nodes."""
    incline_deg: float = 27.0
    """The block slides down by itself, or with 0 begins with `SPEED`; the drag is then over its weight, less that of
    its friction."""


@case(
    source="Coulomb's law: a = g (sin - mu cos)",
    sweep=[*grid(bed=BEDS, start=STARTS, cell=CELLS, mass=MASSES),
           *grid(bed=BEDS, start=STARTS, cell=CELLS, friction=(0.0,)),
           *({**LEVEL, **one} for one in grid(start=STARTS, cell=CELLS, mass=(0.25, 5.0))),
           *grid(bed=BEDS, mass=(0.001,), start=STARTS), *grid(bed=BEDS, coupling=("lagged",)),
           *grid(bed=("sand",), offset_cells=(0.3, 0.6))],
    quick=[{"bed": "sand", "start": "lowered"}, {"bed": "elastic", "friction": 0.0}, {**LEVEL, "start": "lowered"}],
    # with friction by the incline and by the block's lower face, and without; drag over the weight; the bed gives way
    # under a heavy block
    expectations=(*(Within("acceleration", 0.05, one)
                    for one in grid(bed=BEDS, start=STARTS, cell=CELLS)),
                  *(Within("on_face", 0.05, {"bed": b}) for b in BEDS),
                  Within("acceleration", 0.03, {"friction": 0.0}), Within("drag", 0.03),
                  *(Within("gap", 0.15, {"start": "lowered", "cell": c}) for c in CELLS)),
    main_error="acceleration", resolution="cell", units={"gap": "cells"}, options=Slide)
def sliding_block(run: Slide) -> Record:
    """Rigid block that slides down an incline of sand or elastic material, or along a level bed without friction.

    Measured: the relative error of its acceleration, on a level bed its drag over its weight, and how far it sits above
    the bed. The reference is for a block that lies along the incline. A heavy one tips forward by a degree or more, as
    the bed gives way at its front, and slides on a steeper face: the error `on_face` is that for the face as it lies.
    The block is laid flush, or lowered from above. While it lies on the bed, nothing meets its sides."""
    cell, friction, angle = run.cell, run.friction, math.radians(run.incline_deg)
    gravity, is_level = (G * math.sin(angle), 0.0, -G * math.cos(angle)), run.incline_deg == 0.0
    top = SLIDE_BED[2] + run.offset_cells * cell
    solver = build_bed(run.bed, (*SLIDE_BED[:2], top), cell, headroom=0.1, gravity=gravity)
    heights = solver.bodies[0].positions[:, 2]
    height = top + HEIGHT / 2 + (1.5 * cell if run.start == "lowered" else 0.0)
    size = f"{SLIDER / 2} {SLIDER / 2} {HEIGHT / 2}"
    plugin = couple(one_body(f'type="box" size="{size}" mass="{run.mass}" friction="{friction}"',
                             (START, SLIDE_BED[1] / 2, height), host_step=HOST_STEP, gravity=gravity), solver,
                    run.coupling)
    data, timed, is_top, is_released = plugin.data, TimedSolver(solver), heights > top - 0.5 * cell, False
    speeds, gaps, forces, pitches = [], [], [], []
    for step in range(round((HELD + SLID) / HOST_STEP)):
        if step * HOST_STEP < HELD:
            data.qvel[[0, 3, 4, 5]] = 0.0
            if step % 5 == 0:
                damp(plugin, 0.8)
        elif is_level and not is_released:
            data.qvel[0], is_released = SPEED, True
        timed.run(plugin.step)
        if (step - 10) * HOST_STEP > HELD:
            speeds.append(data.qvel[0])
            grains, below = solver.positions()[is_top], data.qpos[2] - HEIGHT / 2
            is_below = (np.abs(grains[:, :2] - data.qpos[:2]) < SLIDER / 2 - 2 * cell).all(1)
            # the topmost grains reach half of their size higher
            gaps.append(float((below - grains[is_below, 2].mean() - (top - heights.max())) / cell))
            forces.append(plugin.wrench("body").force)
            pitches.append(2.0 * math.asin(data.qpos[5]))
    acceleration = np.polyfit(HOST_STEP * np.arange(len(speeds)), speeds, 1)[0]
    exact = G * (math.sin(angle) - friction * math.cos(angle))
    along, _, normal = np.mean(forces, axis=0)
    if is_level:
        errors = {"drag": (exact - acceleration) / G}
    else:
        # the bed's force is at the angle of friction to the normal of the face, which has tipped by the pitch
        tipped = G * (math.sin(angle) - math.cos(angle) * np.tan(math.atan(friction) - np.array(pitches)).mean())
        errors = {"acceleration": acceleration / exact - 1, "on_face": acceleration / tipped - 1}
    return timed.record(errors | {"gap": np.mean(gaps)}, tangential_share=-along / normal,
                        pitch_deg=math.degrees(pitches[-1]), mean_pitch_deg=math.degrees(np.mean(pitches)))

