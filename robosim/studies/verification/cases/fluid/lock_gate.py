"""Thin plate between water 10 cm and 5 cm deep.

Measured: relative errors of thrust and of torque about the floor, and the share of particles that cross the plate.
Reference: hydrostatics, F = rho g w (h1^2 - h2^2) / 2 and T = rho g w (h1^3 - h2^3) / 6.
"""

import numpy as np
import trimesh

import mpm
from mpm.geometry.shell import SHELL_FACE
from robosim.studies.verification.cases.beds import UPRIGHT, load_pressure
from robosim.studies.verification.cases.case import Record, TimedSolver, case, grid
from robosim.studies.verification.cases.expectations import Within, each_within

DEEP, SHALLOW, CHAMBER, WIDTH = 0.10, 0.05, 0.10, 0.02
DENSITY, G, SOUND = 1000.0, 9.81, 12.0


def plate(height: float, width: float) -> trimesh.Trimesh:
    """Build a rectangle of 2 triangles in the plane x = 0 that extends past floor, top and sides."""
    y, low = width, -0.05
    corners = [[0, -y, low], [0, y, low], [0, y, height], [0, -y, height]]
    return trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], process=False)


@case(
    source="hydrostatics: F = rho g w (h1^2 - h2^2) / 2, torque about the floor rho g w (h1^3 - h2^3) / 6",
    sweep=grid(thickness_cells=(0.3, 1.0, 2.0), offset_cells=(0.0, 0.25, 0.5, 0.75)),
    quick=[{"thickness_cells": t, "offset_cells": o, "duration": 0.2} for t, o in ((0.3, 0.75), (2.0, 0.0))],
    expectations=(*each_within({"force": 0.03, "torque": 0.03, "crossed": 0.0}),
                  # when errors in the water next to the plate have had time to grow
                  *(Within(name, 0.005, {"duration": 2.0}) for name in ("force", "torque"))),
    main_error="force")
def measure(*, cell: float = 0.005, thickness_cells: float = 0.3, courant: float = 0.4, precision: str = "f32",
            duration: float = 2.0, offset_cells: float = 0.0, face_cells: float = SHELL_FACE) -> Record:
    """Run the case; return the errors of thrust and torque, and the share that crossed the plate.

    cell [m]; duration [s]; offset_cells: distance of the plate from a plane of nodes; face_cells:
    see `mpm.Shell.from_mesh`.
    """
    half, middle = 0.5 * thickness_cells * cell, CHAMBER + offset_cells * cell
    left = mpm.sample_box((0, 0, 0), (middle - half, WIDTH, DEEP), cell / 2)
    right = mpm.sample_box((middle + half, 0, 0), (2 * CHAMBER, WIDTH, SHALLOW), cell / 2)
    water = mpm.NewtonianFluid(bulk_modulus=DENSITY * SOUND**2, density=DENSITY)
    volumes = np.concatenate([
        np.full(len(left), (middle - half) * WIDTH * DEEP / len(left)),
        np.full(len(right), (2 * CHAMBER - middle - half) * WIDTH * SHALLOW / len(right))])
    positions = np.concatenate([left, right])
    surface = np.concatenate([np.full(len(left), DEEP), np.full(len(right), SHALLOW)])
    shell = mpm.Shell.from_mesh(plate(DEEP + 0.05, 2 * WIDTH), thickness_cells * cell, face_cells=face_cells)
    gate = mpm.Collider(shell, friction=0.0, pose=mpm.Pose(np.array([middle, WIDTH / 2, 0.0]), UPRIGHT))
    solver = mpm.Solver(
        grid=mpm.Grid((0, 0, 0), (2 * CHAMBER, WIDTH, DEEP + 4 * cell), cell), colliders=[gate], precision=precision,
        walls=mpm.Walls(lower=("slip", "periodic", "slip"), upper=("slip", "periodic", "slip")),
        bodies=[mpm.Body(water, positions, volume=volumes)], dt=courant * cell / SOUND)
    load_pressure(solver, water, surface - positions[:, 2])
    timed, window = TimedSolver(solver), 0.005
    timed.settle(0.2)
    force, torque = [], []
    for _ in range(round(duration / window)):
        timed.advance(window)
        impulse = solver.collider_impulse(0, about=np.array([middle, WIDTH / 2, 0.0]))
        force.append(impulse.force[0] / window)
        torque.append(impulse.torque[1] / window)
    late = len(force) // 2
    thrust = 0.5 * DENSITY * G * WIDTH * (DEEP**2 - SHALLOW**2)
    moment = DENSITY * G * WIDTH * (DEEP**3 - SHALLOW**3) / 6.0
    side = np.where(solver.positions()[:, 0] > middle, 1, -1)
    crossed = np.mean(side != np.repeat([-1, 1], [len(left), len(right)]))
    errors = {"force": np.mean(force[late:]) / thrust - 1, "torque": np.mean(torque[late:]) / moment - 1,
              "crossed": crossed}
    return timed.record(errors, force_newton=np.mean(force[late:]), force_ripple=np.std(force[late:]) / thrust)
