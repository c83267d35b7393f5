"""Counts of particles in regions, near a collider and out of bounds, taken inside a launch."""

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from mpm.backend import put
from mpm.geometry.region import Region
from mpm.geometry.rigid_motion import Pose, check_pose
from mpm.observers.counter_kernel import (
    CLEARANCE,
    COUNTED,
    COUNTER_ROWS,
    DISTANCE,
    FRAME_NUMBERS,
    LATCHING,
    NEWLY_EXITED,
    CounterKernel,
)
from mpm.scene.validation import read_array

MAX_READINGS = 64
"""Readings in one advance."""


class Counts(NamedTuple):
    """One reading of a `RegionCounter`: sums over the counted particles."""

    distance: float
    """Sum of weighted Manhattan distances [m] to the point."""
    newly_exited: int
    """Particles that left the bounds since the last reading; each is counted once."""
    exited_from_region: int
    """Those of them that were in the region at the last reading."""
    in_region: int
    """Particles in the region."""
    exited: int
    """Particles that have ever left the bounds."""
    in_inner: int
    """Particles in the region `inner`, which moves with the collider."""
    near: int
    """Particles (all, not only the counted ones) whose centre is within `reach` of the collider's surface."""
    probed: int
    """Points within the margin of the probe."""
    clearance: float
    """Smallest distance [m] of those points to the probe."""
    per_particle: np.ndarray | None = None
    """Distance [m] of each counted particle, and 1 where it is in the region (n, 2), float32, if asked for."""


class RegionCounter:
    """Counts the particles of a solver in regions, near a collider and out of bounds.

    - counted: indices of the counted particles. latching: those of them whose exit from the bounds is counted and
      remembered; None: all.
    - point [m] (3,), weights (3,): `distance` is the weighted Manhattan distance to this point.
    - region, bounds: fixed in the world, or in the frame that `place` moves. inner: fixed in the frame of collider
      `index`; a particle in it does not count as outside the bounds.
    - reach: particles within this distance [m] of the collider's surface count as near; None: not counted.
    - points: (n, 3) [m], as region and bounds. They are probed: compared with the signed distance `probe`, in the
      collider's frame, and a margin [m]. None: no points.
    - per_particle: whether a reading has the values of each particle.

    After `Solver.attach` it is evaluated within advances.
    """

    def __init__(self, solver: Any, counted: np.ndarray, *, point: np.ndarray, weights: np.ndarray, region: Region,
                 bounds: Region, inner: Region, index: int, reach: float | None = None,
                 points: np.ndarray | None = None, probe: Any = None, margin: float = 0.0, per_particle: bool = False,
                 latching: np.ndarray | None = None) -> None:
        shape = solver.fields.colliders[index].sdf
        self.solver, self.tenure, self.particles = solver, solver.tenure, solver.particles
        self.index, self.per_particle = index, per_particle
        roles = np.zeros(self.particles.n_lanes, np.int8)
        roles[self.particles.index[counted]] = COUNTED
        roles[self.particles.index[counted if latching is None else latching]] = COUNTED + LATCHING
        near, n_points, looked_up = None if reach is None else shape, 0, None
        if points is not None:
            probe.lay_out()
            n_points, looked_up = len(points), probe.signature()
        self.kernel: CounterKernel = solver.assembly.take(
            ("counter", index, reach, n_points, looked_up, margin, per_particle),
            lambda: CounterKernel(solver.particles, index, near, reach or 0.0, probe, n_points, margin, per_particle))
        self._point, self.frame = np.asarray(point, float), Pose.identity()
        own = [region.row, bounds.row, inner.row, solver.grid.origin, weights, self.frame_numbers(self.frame)]
        self.kernel.fill(np.concatenate(own), roles, points)
        self._out, self._frame_numbers = np.zeros((COUNTER_ROWS, 6)), np.zeros(FRAME_NUMBERS)
        self.slots = self.particles.index[counted]
        """Rows of the per-particle values of a launch that belong to the counted particles."""
        self.per_particle_shape = (len(roles) if per_particle else 1, 2)
        """Shape of the per-particle values of one reading."""
        self._per_particle = np.zeros((1, *self.per_particle_shape), np.float32)

    def place(self, frame: Pose) -> None:
        """Move point, region, bounds and points with a frame, from where they were given to a pose of it.

        Distances are measured along the axes of the world. Raises InvalidValue for what is no pose.
        """
        self._set_state_aside()
        self.frame = check_pose("RegionCounter.place", frame)
        self._frame_numbers[:] = self.frame_numbers(self.frame)
        self.kernel.write_frame(self._frame_numbers)

    def frame_numbers(self, frame: Pose) -> np.ndarray:
        """Return what the kernel reads of a frame: the point there, position [m] and rotation, row by row (15,)."""
        return np.concatenate([frame.apply(self._point[None])[0], frame.position, frame.matrix.ravel()])

    def restart(self) -> None:
        """Forget which particles have left the bounds; those outside now are not counted as newly exited."""
        self._set_state_aside()
        self.kernel.flags.fill(0)
        self.read()

    def state(self) -> np.ndarray:
        """Return the flags (n_particles,), int8, that particles keep between readings."""
        self.solver.check_open(self.tenure)
        return self.kernel.flags.to_numpy()[self.particles.index]

    def load(self, state: np.ndarray) -> None:
        """Take over flags that `state` returned; raises InvalidValue for those of another scene."""
        flags = np.zeros(self.particles.n_lanes, np.int8)
        flags[self.particles.index] = read_array({"flags": state}, "flags", self.particles.index.shape)
        self._set_state_aside()
        put(self.kernel.flags, flags)

    def _set_state_aside(self) -> None:
        """Complete a pending checkpoint of the solver before the flags change; raise InvalidValue if it is closed."""
        self.solver.check_open(self.tenure)
        if self.solver.counter is self:
            self.solver.rollback.store_pending()

    def read(self) -> Counts:
        """Return the counts of the current state."""
        self._set_state_aside()
        pose: Pose = self.solver.collider_pose(self.index)
        self._out[:] = 0.0
        self.kernel.sum_now(np.concatenate([pose.position, pose.matrix.ravel()]), self._out, self._per_particle)
        return self.counts_from(self._out, self._per_particle[0])

    def all_counts(self, rows: np.ndarray, per_particle: np.ndarray, readings: Iterable[int]) -> list[Counts]:
        """Return the counts of some readings of an advance, by their numbers.

        rows (readings COUNTER_ROWS, 6), per_particle (readings, ...): what the kernel wrote for all of them.
        """
        return [self.counts_from(rows[COUNTER_ROWS * k : COUNTER_ROWS * (k + 1)], per_particle[k]) for k in readings]

    def counts_from(self, rows: np.ndarray, per_particle: np.ndarray) -> Counts:
        """Return the counts for two rows of sums, and the numbers of single particles."""
        sums = rows.ravel()
        return Counts(float(sums[DISTANCE]), *[int(v) for v in sums[NEWLY_EXITED:CLEARANCE]], float(sums[CLEARANCE]),
                      per_particle[self.slots] if self.per_particle else None)
