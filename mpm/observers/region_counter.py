"""Counts of particles in regions, near a collider and out of bounds, taken inside a launch."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from mpm.backend import put
from mpm.geometry.region import Region
from mpm.geometry.rigid_motion import Pose, check_pose
from mpm.geometry.shape import Shape
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


@dataclass(frozen=True, kw_only=True, eq=False)
class Counting:
    """What a `RegionCounter` counts. Regions and points are fixed in the world, or in the frame that `place` moves."""

    point: np.ndarray
    """Point [m] (3,) that distances are measured to."""
    weights: np.ndarray
    """Weights (3,) of the axes in the Manhattan distance."""
    region: Region
    """Region in which particles are counted."""
    bounds: Region
    """Region that particles leave when they exit."""
    inner: Region
    """Region in the frame of the collider; a particle in it does not count as outside the bounds."""
    index: int
    """The collider."""
    reach: float | None = None
    """Distance [m] of the collider's surface within which particles count as near; None: not counted."""
    points: np.ndarray | None = None
    """Points (n, 3) [m] that are compared with the signed distance `probe`; None: no points."""
    probe: Shape | None = None
    """Signed distance in the collider's frame."""
    margin: float = 0.0
    """Distance [m] to the probe within which a point is counted."""
    per_particle: bool = False
    """Whether a reading has the values of each particle."""
    latching: np.ndarray | None = None
    """Indices of the counted particles whose exit from the bounds is counted and remembered; None: all."""


class RegionCounter:
    """Counts the particles of a solver in regions, near a collider and out of bounds.
    counted: indices of the counted particles. counting: the fields of `Counting`. After `Solver.attach` it is evaluated
    within advances."""

    def __init__(self, solver: Any, counted: np.ndarray, **counting: Any) -> None:
        given = Counting(**counting)
        fields = solver.fields
        self._solver, self.tenure, self.particles = solver, solver.tenure, fields.particles
        self.index, self.per_particle = given.index, given.per_particle
        roles = np.zeros(self.particles.n_lanes, np.int8)
        roles[self.particles.index[counted]] = COUNTED
        roles[self.particles.index[counted if given.latching is None else given.latching]] = COUNTED + LATCHING
        near = None if given.reach is None else fields.colliders[given.index].sdf
        n_points, looked_up = 0, None
        if given.points is not None and given.probe is not None:
            given.probe.lay_out()
            n_points, looked_up = len(given.points), given.probe.signature()
        self.kernel: CounterKernel = self.tenure.assembly.take(
            ("counter", given.index, given.reach, n_points, looked_up, given.margin, given.per_particle),
            lambda: CounterKernel(fields.particles, given.index, near, given.reach or 0.0, given.probe, n_points,
                                  given.margin, given.per_particle))
        region, bounds, inner, weights, points = given.region, given.bounds, given.inner, given.weights, given.points
        origin, per_particle = np.asarray(fields.origin), given.per_particle
        self._point, self.frame = np.asarray(given.point, float), Pose.identity()
        own = [region.row, bounds.row, inner.row, origin, weights, self.frame_numbers(self.frame)]
        self.kernel.fill(np.concatenate(own), roles, points)
        self._out, self._frame_numbers = np.zeros((COUNTER_ROWS, 6)), np.zeros(FRAME_NUMBERS)
        self.slots = self.particles.index[counted]
        """Rows of the per-particle values of a launch that belong to the counted particles."""
        self.per_particle_shape = (len(roles) if per_particle else 1, 2)
        """Shape of the per-particle values of one reading."""
        self._per_particle = np.zeros((1, *self.per_particle_shape), np.float32)

    def place(self, frame: Pose) -> None:
        """Move point, region, bounds and points with a frame, from where they were given to a pose of it.
        Distances are measured along the axes of the world. Raises InvalidValue for what is no pose."""
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
        self.tenure.check_open()
        return self.kernel.flags.to_numpy()[self.particles.index]

    def load(self, state: np.ndarray) -> None:
        """Take over flags that `state` returned; raises InvalidValue for those of another scene."""
        flags = np.zeros(self.particles.n_lanes, np.int8)
        flags[self.particles.index] = read_array({"flags": state}, "flags", self.particles.index.shape)
        self._set_state_aside()
        put(self.kernel.flags, flags)

    def _set_state_aside(self) -> None:
        """Complete a pending checkpoint of the solver before the flags change; raise InvalidValue if it is closed."""
        self.tenure.check_open()
        self._solver.before_flags_change(self)

    def read(self) -> Counts:
        """Return the counts of the current state."""
        self._set_state_aside()
        pose: Pose = self._solver.collider_pose(self.index)
        self._out[:] = 0.0
        self.kernel.sum_now(np.concatenate([pose.position, pose.matrix.ravel()]), self._out, self._per_particle)
        return self.counts_from(self._out, self._per_particle[0])

    def all_counts(self, rows: np.ndarray, per_particle: np.ndarray, readings: Iterable[int]) -> list[Counts]:
        """Return the counts of some readings of an advance, by their numbers.
        rows (readings COUNTER_ROWS, 6), per_particle (readings, ...): what the kernel wrote for all of them."""
        return [self.counts_from(rows[COUNTER_ROWS * k : COUNTER_ROWS * (k + 1)], per_particle[k]) for k in readings]

    def counts_from(self, rows: np.ndarray, per_particle: np.ndarray) -> Counts:
        """Return the counts for two rows of sums, and the numbers of single particles."""
        sums = rows.ravel()
        return Counts(float(sums[DISTANCE]), *[int(v) for v in sums[NEWLY_EXITED:CLEARANCE]], float(sums[CLEARANCE]),
                      per_particle[self.slots] if self.per_particle else None)
