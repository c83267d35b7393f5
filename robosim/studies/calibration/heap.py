"""Heap of a round column that is let go: its cylinder is gone at once, or lifted.

A quarter is computed, between two planes of symmetry. A ring's height is the volume of its particles over its area, not
its topmost particle: that changes smoothly with the material's numbers, and little with the particles' places.
"""

import math

import numpy as np
import trimesh

import mpm
from robosim.config.materials import Law, MaterialConfig
from robosim.studies.calibration.measurements import HeapExperiment
from robosim.studies.columns import fill_column, rim

G = 9.81
COURANT = 0.5
"""Share of the time in which a sound wave passes a cell that a substep lasts, as in the case column_collapse."""
FALL_TIMES = 6.0
"""Duration in units of sqrt(height / g): twice the time after which Lube et al. (2004) found columns at rest."""
REACH = 1.5
"""Room for the heap, in units of the rim of sand; one of less friction leans on the grid's sides."""
WALL_CELLS = 2.5
"""Thickness of the lifted cylinder, outwards, in cells; the grid does not see thinner solids."""
INSIDE = 0.999
"""Largest distance of a particle from the axis, in radii of the column."""
LIFT_STEP = 0.02
"""Time [s] of an advance while the cylinder rises."""


def simulate_heap(heap: HeapExperiment, card: MaterialConfig, floor_friction: float, distances: np.ndarray,
                  seed: int = 0) -> np.ndarray:
    """Return the heights [m] (n,) of the heap at distances [m] (n,) from its axis.

    seed: of the particles' initial places. Raises mpm.SimulationDiverged.
    """
    solver = make_column(heap, card.make_law(), floor_friction, seed)
    if heap.lift_speed is not None:
        lift_cylinder(solver, heap, heap.lift_speed)
    solver.advance(FALL_TIMES * math.sqrt(heap.height / G))
    positions, volume = solver.positions(), float(np.max(solver.bodies[0].volume or 0.0))
    solver.close()
    return ring_heights(np.hypot(positions[:, 0], positions[:, 1]), volume, heap.radius / heap.cells, distances)


def make_column(heap: HeapExperiment, law: Law, floor_friction: float, seed: int) -> mpm.Solver:
    """Build the column before its release; scenes of one experiment share compiled kernels."""
    cell = heap.radius / heap.cells
    grains = fill_column(heap.radius, heap.height, cell, np.random.default_rng(seed))
    distances = np.hypot(grains[:, 0], grains[:, 1])
    grains[:, :2] *= np.minimum(1.0, INSIDE * heap.radius / distances)[:, None]  # out of the cylinder's wall
    room = math.ceil(REACH * rim(heap.radius, heap.height / heap.radius) / cell) * cell
    walls = mpm.Walls(friction=floor_friction, lower=("roller", "roller", "friction"),
                      upper=("friction", "friction", "slip"))
    colliders = []
    if heap.lift_speed is not None:
        tube = trimesh.creation.annulus(heap.radius, heap.radius + WALL_CELLS * cell, heap.height + 2 * cell)
        colliders = [mpm.Collider(mpm.Sdf.from_mesh(tube, spacing=cell / 3, margin=2 * cell), friction=floor_friction,
                                  pose=cylinder_pose(heap, 0.0))]
    volume = math.pi * heap.radius**2 * heap.height / 4 / len(grains)
    return mpm.Solver(grid=mpm.Grid((0, 0, 0), (room, room, heap.height + 4 * cell), cell), walls=walls,
                      bodies=[mpm.Body(law, grains, volume=volume)], colliders=colliders, dt=stable_step(law, cell))


def stable_step(law: Law, cell: float) -> float | None:
    """Return the substep [s] of a solid; None, the solver's own choice, for a fluid."""
    if isinstance(law, mpm.NewtonianFluid):
        return None
    return COURANT * cell / math.sqrt((law.lam + 2 * law.mu) / law.density)


def lift_cylinder(solver: mpm.Solver, heap: HeapExperiment, speed: float) -> None:
    """Lift the cylinder until it is above the column's top; speed [m/s]."""
    risen, step = 0.0, min(LIFT_STEP, heap.radius / heap.cells / speed)
    while risen < heap.height:
        begin, risen = risen, risen + speed * step
        solver.set_collider_motion(0, cylinder_pose(heap, begin), cylinder_pose(heap, risen))
        solver.advance(step)


def cylinder_pose(heap: HeapExperiment, risen: float) -> mpm.Pose:
    """Return the pose of the cylinder's middle when it is raised by `risen` [m]."""
    middle = heap.height / 2 + heap.radius / heap.cells + risen
    return mpm.Pose(np.array([0.0, 0.0, middle]), mpm.Pose.identity().quaternion)


def ring_heights(particles: np.ndarray, volume: float, cell: float, distances: np.ndarray) -> np.ndarray:
    """Return heights [m] (n,) at distances [m] (n,) of a quarter heap; particles: distances of all [m], volume: of one.

    Rings as wide as a cell, two cells the innermost, with linear interpolation between their middles.
    """
    rings = max(int(particles.max() / cell) + 2, 3)
    edges = np.concatenate([[0.0], cell * np.arange(2, rings + 2)])
    counts, _ = np.histogram(particles, edges)
    heights = counts * volume / (math.pi / 4 * np.diff(edges**2))
    middles = np.sqrt((edges[1:] ** 2 + edges[:-1] ** 2) / 2)
    return np.interp(distances, middles, heights)
