"""Thin plate between water 10 cm and 5 cm deep.

Measured: relative errors of thrust and of torque about the floor, and the share of particles that cross the plate.
Reference: hydrostatics, F = rho g w (h1^2 - h2^2) / 2 and T = rho g w (h1^3 - h2^3) / 6.
"""

import numpy as np
import trimesh

import mpm
from mpm.geometry.shell import SHELL_FACE
from robosim.studies.verification.cases.claims import Within
from robosim.studies.verification.cases.record import Record, TimedSolver

NAME = "lock_gate"
SOURCE = "hydrostatics: F = rho g w (h1^2 - h2^2) / 2, torque about the floor rho g w (h1^3 - h2^3) / 6"
BANDS = {"force": 0.03, "torque": 0.03, "crossed": 0.0, "after 2 s": 0.005}
"""Relative errors of the means over the second half, and the share of particles that changed sides; after 2 s also of
force and torque, when errors in the water next to the plate have had time to grow."""
SWEEP = [{"thickness_cells": t, "offset_cells": o} for t in (0.3, 1.0, 2.0) for o in (0.0, 0.25, 0.5, 0.75)]
"""Choices of the runs in a whole report."""
QUICK_SWEEP = [{"thickness_cells": 0.3, "offset_cells": 0.75, "duration": 0.2},
         {"thickness_cells": 2.0, "offset_cells": 0.0, "duration": 0.2}]
MAIN_ERROR, RESOLUTION = "force", None
CLAIMS = (*(Within(name, BANDS[name]) for name in ("force", "torque", "crossed")),
          *(Within(name, BANDS["after 2 s"], {"duration": 2.0}) for name in ("force", "torque")))
DEEP, SHALLOW, CHAMBER, WIDTH = 0.10, 0.05, 0.10, 0.02
DENSITY, G, SOUND = 1000.0, 9.81, 12.0


def plate(height: float, width: float) -> trimesh.Trimesh:
    """Build a rectangle of 2 triangles in the plane x = 0 that extends past floor, top and sides."""
    y, low = width, -0.05
    corners = [[0, -y, low], [0, y, low], [0, y, height], [0, -y, height]]
    return trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], process=False)


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
    gate = mpm.Collider(mpm.Shell.from_mesh(plate(DEEP + 0.05, 2 * WIDTH), thickness_cells * cell,
                                                  face_cells=face_cells), friction=0.0,
                        pose=mpm.Pose(np.array([middle, WIDTH / 2, 0.0]), mpm.Pose.identity().quaternion))
    solver = mpm.Solver(
        grid=mpm.Grid((0, 0, 0), (2 * CHAMBER, WIDTH, DEEP + 4 * cell), cell), colliders=[gate], precision=precision,
        walls=mpm.Walls(lower=("slip", "periodic", "slip"), upper=("slip", "periodic", "slip")),
        bodies=[mpm.Body(water, positions, volume=volumes)], dt=courant * cell / SOUND)
    state = solver.state()
    state["j"][:, 0] = -DENSITY * G * (surface - positions[:, 2]) / water.bulk_modulus
    solver.load(state)
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
    choices = {"cell": cell, "thickness_cells": thickness_cells, "courant": courant, "precision": precision,
               "offset_cells": offset_cells, "duration": duration, "face_cells": face_cells}
    return timed.record(NAME, choices, errors, force_newton=float(np.mean(force[late:])),
                        force_ripple=float(np.std(force[late:]) / thrust))
