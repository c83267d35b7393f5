"""A cube that floats on water, and a ball that swings in it."""

from typing import Literal

import numpy as np
import trimesh

import mpm
from robosim.studies.verification.cases.beds import load_pressure, set_up
from robosim.studies.verification.cases.case import Record, TimedSolver, case, grid
from robosim.studies.verification.cases.coupling.swinging_ball import half_swing
from robosim.studies.verification.cases.expectations import Within
from robosim.studies.verification.cases.rigid_body import G, couple, damp, one_body

DENSITY = 1000.0
SIDE, WIDTH, DEPTH, SOUND, HOST_STEP = 0.08, 0.24, 0.14, 12.0, 0.004
"""Of the cube and its tank."""
RADIUS, STIFFNESS, BALL_SOUND, BALL_STEP = 0.03, 200.0, 30.0, 0.001
"""Of the ball on a spring."""


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
    timed, solver = set_up(mpm.Body(water, positions, volume=volume), (WIDTH, WIDTH, DEPTH + SIDE), cell,
                           precision=precision, walls=mpm.Walls.all("slip"))
    load_pressure(solver, water, DEPTH - positions[:, 2])
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


def hollow(radius: float, wall: float) -> trimesh.Trimesh:
    """Build a wall of a thickness [m] around a hollow of a radius [m] about the origin."""
    inner = trimesh.creation.icosphere(4, radius)
    inner.invert()
    outer = trimesh.creation.icosphere(4, radius + wall)
    return trimesh.Trimesh(np.concatenate([outer.vertices, inner.vertices]),
                           np.concatenate([outer.faces, inner.faces + len(outer.vertices)]), process=False)


@case(
    source="Stokes (1843): a ball of radius a in the middle of a hollow sphere of radius b carries "
           "C = (b^3 + 2 a^3) / (2 (b^3 - a^3)) of the mass of the fluid that it displaces",
    sweep=grid(cell=(0.006, 0.004, 0.003), mass_ratio=(2.0, 0.1)),
    quick=[{"cell": 0.006, "mass_ratio": 2.0, "swings": 1.2}],
    # the water is compressible, which has to be far quicker than the spring
    expectations=[Within("frequency", 0.03, {"cell": 0.003, "mass_ratio": 2.0})],
    main_error="frequency", resolution="cell")
def added_mass(*, cell: float = 0.006, mass_ratio: float = 2.0, radii: float = 2.0, swings: float = 2.0,
               precision: str = "f32", volume_rate: Literal["particle", "cell"] = "particle",
               transfer_interval: float | None = None) -> Record:
    """Ball on a spring in a hollow sphere full of water.

    Measured: relative error of the frequency, which the water's added mass lowers. mass_ratio: of ball to displaced
    water; radii: radius of the hollow over the ball's; swings: periods that are computed."""
    outer = radii * RADIUS
    reach = np.ceil(outer / cell + 3) * cell
    positions = mpm.sample_box((-outer,) * 3, (outer,) * 3, cell / 2)
    distance = np.linalg.norm(positions, axis=1)
    # grains stay half their size off a face; placed nearer, they would put the water under pressure from the start
    positions = positions[(distance < outer - cell / 4) & (distance > RADIUS + cell / 4)]
    volume = 4 / 3 * np.pi * (outer**3 - RADIUS**3) / len(positions)
    water = mpm.NewtonianFluid(bulk_modulus=DENSITY * BALL_SOUND**2, density=DENSITY, volume_rate=volume_rate)
    vessel = mpm.Collider(mpm.Sdf.from_mesh(hollow(outer, 2.5 * cell), spacing=cell / 4), friction=0.0, static=True)
    solver = mpm.Solver(grid=mpm.Grid((-reach,) * 3, (reach,) * 3, cell), precision=precision, colliders=[vessel],
                        bodies=[mpm.Body(water, positions, volume=volume)], gravity=(0, 0, 0),
                        transfer_interval=transfer_interval)
    displaced = DENSITY * 4 / 3 * np.pi * RADIUS**3
    plugin = couple(one_body(f'type="sphere" size="{RADIUS}" mass="{mass_ratio * displaced}" friction="0"', (0, 0, 0),
                             joint=f'<joint type="slide" axis="1 0 0" stiffness="{STIFFNESS}"/>', host_step=BALL_STEP,
                             gravity=(0, 0, 0)), solver)
    plugin.data.qvel[0] = 0.1  # it swings by a tenth of its radius
    ratio = (radii**3 + 2) / (2 * (radii**3 - 1))
    expected = np.sqrt(STIFFNESS / ((mass_ratio + ratio) * displaced))
    timed, places = TimedSolver(solver), [0.0]
    for _ in range(round(swings * 2 * np.pi / expected / BALL_STEP)):
        timed.run(plugin.step)
        places.append(float(plugin.data.qpos[0]))
    frequency, damping = half_swing(np.array(places)[np.argmax(places):], BALL_STEP)  # from its first peak
    return timed.record({"frequency": frequency / expected - 1}, damping_ratio=damping,
                        frequency_in_vacuum=np.sqrt(STIFFNESS / (mass_ratio * displaced)) / expected)
