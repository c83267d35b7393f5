"""Simulated experiments: a heap of a round column that is let go, and the mass that leaves a box tilted about its lip.

A quarter of the column is computed, between two planes of symmetry. A ring's height is the volume of its particles over
its area, not its topmost particle: that changes smoothly with the material's numbers, and little with the particles'
places. A slice of the box, one cell thick, is computed in the box's own frame: gravity turns instead of the box. The
box turns slowly against the fall of the material, so that its centrifugal acceleration is left out."""

import math

import numpy as np
import trimesh

import mpm
from robosim.config.materials import Law, MaterialConfig
from robosim.studies.calibration.measurements import HeapExperiment, PourExperiment
from robosim.studies.verification.cases.beds import courant_step, fill_column, rim

G = 9.81
LIP_CELLS, STEP = 2.0, 0.02
"""Thickness of the wall with the lip, in cells: thinner solids the grid does not see; time [s] of an advance while the
box is tilted: gravity is constant during it."""


def simulate_heap(heap: HeapExperiment, card: MaterialConfig, floor_friction: float, distances: np.ndarray,
                  seed: int = 0) -> np.ndarray:
    """Return the heights [m] (n,) of the heap at distances [m] (n,) from its axis.
    seed: of the particles' initial places. Raises mpm.SimulationDiverged."""
    solver = make_column(heap, card.make_law(), floor_friction, seed)
    let_go(heap, solver)
    heights = heights_of(heap, solver, distances)
    solver.close()
    return heights


def let_go(heap: HeapExperiment, solver: mpm.Solver) -> None:
    """Lift the cylinder, where there is one, until it is above the column's top, and wait until the heap is at rest."""
    if heap.lift_speed is not None:
        risen, step = 0.0, min(0.02, heap.radius / heap.cells / heap.lift_speed)
        while risen < heap.height:
            begin, risen = risen, risen + heap.lift_speed * step
            solver.set_collider_motion(0, cylinder_pose(heap, begin), cylinder_pose(heap, risen))
            solver.advance(step)
    solver.advance(6.0 * math.sqrt(heap.height / G))  # Lube et al. (2004) found columns at rest after half of it


def heights_of(heap: HeapExperiment, solver: mpm.Solver, distances: np.ndarray) -> np.ndarray:
    """Return the heights [m] (n,) of the heap at distances [m] (n,) from its axis."""
    positions, volume = solver.positions(), float(np.max(solver.bodies[0].volume or 0.0))
    return ring_heights(np.hypot(positions[:, 0], positions[:, 1]), volume, heap.radius / heap.cells, distances)


def make_column(heap: HeapExperiment, law: Law, floor_friction: float, seed: int) -> mpm.Solver:
    """Build the column before its release; scenes of one experiment share compiled kernels."""
    cell = heap.radius / heap.cells
    grains = fill_column(heap.radius, heap.height, cell, np.random.default_rng(seed))
    distances = np.hypot(grains[:, 0], grains[:, 1])
    grains[:, :2] *= np.minimum(1.0, 0.999 * heap.radius / distances)[:, None]  # out of the cylinder's wall
    # a heap of less friction than sand leans on the grid's sides
    room = math.ceil(1.5 * rim(heap.radius, heap.height / heap.radius) / cell) * cell
    walls = mpm.Walls(friction=floor_friction, lower=("roller", "roller", "friction"),
                      upper=("friction", "friction", "slip"))
    colliders = []
    if heap.lift_speed is not None:
        # outwards as thick as the grid sees
        tube = trimesh.creation.annulus(heap.radius, heap.radius + 2.5 * cell, heap.height + 2 * cell)
        colliders = [mpm.Collider(mpm.Sdf.from_mesh(tube, spacing=cell / 3, margin=2 * cell), friction=floor_friction,
                                  pose=cylinder_pose(heap, 0.0))]
    volume = math.pi * heap.radius**2 * heap.height / 4 / len(grains)
    return mpm.Solver(grid=mpm.Grid((0, 0, 0), (room, room, heap.height + 4 * cell), cell), walls=walls,
                      bodies=[mpm.Body(law, grains, volume=volume)], colliders=colliders, dt=stable_step(law, cell))


def stable_step(law: Law, cell: float) -> float | None:
    """Return the substep [s] of a solid; None, the solver's own choice, for a fluid."""
    return None if isinstance(law, mpm.NewtonianFluid) else courant_step(0.5, cell, law)


def cylinder_pose(heap: HeapExperiment, risen: float) -> mpm.Pose:
    """Return the pose of the cylinder's middle when it is raised by `risen` [m]."""
    middle = heap.height / 2 + heap.radius / heap.cells + risen
    return mpm.Pose(np.array([0.0, 0.0, middle]), mpm.Pose.identity().quaternion)


def ring_heights(particles: np.ndarray, volume: float, cell: float, distances: np.ndarray) -> np.ndarray:
    """Return heights [m] (n,) at distances [m] (n,) of a quarter heap; particles: distances of all [m], volume: of one.
    Rings as wide as a cell, two cells the innermost, with linear interpolation between their middles."""
    rings = max(int(particles.max() / cell) + 2, 3)
    edges = np.concatenate([[0.0], cell * np.arange(2, rings + 2)])
    counts, _ = np.histogram(particles, edges)
    heights = counts * volume / (math.pi / 4 * np.diff(edges**2))
    middles = np.sqrt((edges[1:] ** 2 + edges[:-1] ** 2) / 2)
    return np.interp(distances, middles, heights)


def simulate_pour(pour: PourExperiment, card: MaterialConfig, wall_friction: float, times: np.ndarray,
                  seed: int = 0) -> np.ndarray:
    """Return the mass [kg] (n,) that has left the box at times [s] (n,) from the begin of the tilting.
    seed: of the particles' initial places. Raises mpm.SimulationDiverged."""
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
