"""Mass that leaves a box tilted about its lip.

A slice of the box, one cell thick, is computed in the box's own frame: gravity turns instead of the box. The box turns
slowly against the fall of the material, so that its centrifugal acceleration is left out.
"""

import math

import numpy as np

import mpm
from robosim.config.materials import MaterialConfig
from robosim.studies.calibration.heap import G, stable_step
from robosim.studies.calibration.measurements import PourExperiment

LIP_CELLS, STEP = 2.0, 0.02
"""Thickness of the wall with the lip, in cells: thinner solids the grid does not see; time [s] of an advance while the
box is tilted: gravity is constant during it."""


def simulate_pour(pour: PourExperiment, card: MaterialConfig, wall_friction: float, times: np.ndarray,
                  seed: int = 0) -> np.ndarray:
    """Return the mass [kg] (n,) that has left the box at times [s] (n,) from the begin of the tilting.

    seed: of the particles' initial places. Raises mpm.SimulationDiverged.
    """
    law, cell = card.make_law(), pour.fill_height / pour.cells
    length, lip = math.ceil(pour.length / cell) * cell, LIP_CELLS * cell
    upper = (2 * length + lip + 4 * cell, cell, max(pour.depth, pour.fill_height) + 4 * cell)
    place = mpm.Pose(np.array([length + lip / 2, cell / 2, 0.0]), mpm.Pose.identity().quaternion)
    wall = mpm.Collider(mpm.Sdf.box((lip / 2, 2 * cell, pour.depth)), static=True, friction=wall_friction, pose=place)
    grains = mpm.sample_box((0, 0, 0), (length, cell, pour.fill_height), cell / 2, np.random.default_rng(seed))
    walls = mpm.Walls(friction=wall_friction, lower=("friction", "periodic", "friction"),
                      upper=("slip", "periodic", "slip"))
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), upper, cell), walls=walls, colliders=[wall],
                        bodies=[mpm.Body(law, grains, volume=length * cell * pour.fill_height / len(grains))],
                        dt=stable_step(law, cell))
    clock, shares = [0.0], [0.0]
    while clock[-1] < times[-1]:
        angle = math.radians(min(pour.tilt_speed * (clock[-1] + STEP / 2), pour.end_angle))
        solver.set_gravity(np.array([G * math.sin(angle), 0.0, -G * math.cos(angle)]))
        solver.advance(STEP)
        clock.append(clock[-1] + STEP)
        shares.append(float(np.mean(solver.positions()[:, 0] > length + lip)))
    solver.close()
    return law.density * pour.length * pour.fill_height * pour.width * np.interp(times, clock, shares)
