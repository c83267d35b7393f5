"""Heap of a round column that is let go: its cylinder is gone at once, or lifted.

A quarter is computed, between two planes of symmetry. A ring's height is the volume of its particles over its area, not
its topmost particle: that changes smoothly with the material's numbers, and little with the particles' places.
"""

import math

import numpy as np
import trimesh

import mpm
from mpm.scene.sampling import JITTER
from robosim.config.materials import Law, MaterialConfig
from robosim.studies.calibration.measurements import HeapExperiment

G = 9.81
COURANT = 0.5
"""Share of the time in which a sound wave passes a cell that a substep lasts, as in the case column_collapse."""
FALL_TIMES = 6.0
"""Duration in units of sqrt(height / g): twice the time after which Lube et al. (2004) found columns at rest."""
REACH = 1.5
"""Room for the heap, in units of the rim that Lube et al. (2004) measured for sand; one of less friction leans on the
grid's sides. Source: J. Fluid Mech. 508:175, r = r0 (1 + 1.24 a), r0 (1 + 1.6 sqrt(a)) from a = 1.7."""
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
    fall = FALL_TIMES * math.sqrt(heap.height / G)
    if heap.lift_speed is not None:
        lift_cylinder(solver, heap)
    solver.advance(fall)
    positions, volume = solver.positions(), float(np.max(solver.bodies[0].volume or 0.0))
    solver.close()
    return ring_heights(np.hypot(positions[:, 0], positions[:, 1]), volume, heap.radius / heap.cells, distances)


def make_column(heap: HeapExperiment, law: Law, floor_friction: float, seed: int) -> mpm.Solver:
    """Build the column before its release; scenes of one experiment share compiled kernels."""
    cell = heap.radius / heap.cells
    grains = fill_column(heap.radius, heap.height, cell, np.random.default_rng(seed))
    room = math.ceil(REACH * rim(heap.radius, heap.height) / cell) * cell
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


def lift_cylinder(solver: mpm.Solver, heap: HeapExperiment) -> None:
    """Lift the cylinder until it is above the column's top."""
    assert heap.lift_speed is not None
    cell = heap.radius / heap.cells
    risen = 0.0
    step = min(LIFT_STEP, cell / heap.lift_speed)
    while risen < heap.height:
        begin, risen = risen, risen + heap.lift_speed * step
        solver.set_collider_motion(0, cylinder_pose(heap, begin), cylinder_pose(heap, risen))
        solver.advance(step)


def cylinder_pose(heap: HeapExperiment, risen: float) -> mpm.Pose:
    """Return the pose of the cylinder's middle when it is raised by `risen` [m]."""
    middle = heap.height / 2 + heap.radius / heap.cells + risen
    return mpm.Pose(np.array([0.0, 0.0, middle]), mpm.Pose.identity().quaternion)


def rim(radius: float, height: float) -> float:
    """Return the radius [m] of the deposit of a column of sand, by Lube et al. (2004)."""
    a = height / radius
    return radius * (1 + (1.24 * a if a < 1.7 else 1.6 * math.sqrt(a)))


def fill_column(radius: float, height: float, cell: float, rng: np.random.Generator) -> np.ndarray:
    """Return positions [m] (n, 3) of a quarter column: four jittered particles a cell.

    Every second site of a lattice of half cells, so that their number does not depend on the jitter.
    """
    half = cell / 2
    n, layers = math.ceil(radius / half), max(round(height / half), 2)
    sites = np.stack(np.meshgrid(np.arange(n), np.arange(n), np.arange(layers), indexing="ij"), -1).reshape(-1, 3)
    grains = (sites[sites.sum(1) % 2 == 0] + 0.5) * (half, half, height / layers)
    grains = grains[np.hypot(grains[:, 0], grains[:, 1]) <= radius]
    grains += rng.uniform(-JITTER, JITTER, grains.shape) * half
    distances = np.hypot(grains[:, 0], grains[:, 1])
    grains[:, :2] *= np.minimum(1.0, INSIDE * radius / distances)[:, None]  # or some would lie in the cylinder's wall
    return grains


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
