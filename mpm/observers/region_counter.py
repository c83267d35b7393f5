"""Counts of particles in regions, near a collider and out of bounds, taken inside a launch."""

from typing import Any, NamedTuple

import numpy as np

from mpm.backend import allocating, put, ti
from mpm.errors import InvalidValue
from mpm.geometry.region import Region
from mpm.geometry.rigid_motion import Pose
from mpm.geometry.shell import Shell
from mpm.state.packs import LANES

REGION_NUMBERS = 7
"""Numbers of a region as the kernel reads it."""
REGION, BOUNDS, INNER = range(3)
"""The regions, in the order of their numbers."""
ORIGIN, POINT, WEIGHTS = range(3 * REGION_NUMBERS, 3 * REGION_NUMBERS + 9, 3)
"""Where the grid's origin and the distance's numbers follow on those of the regions."""
COUNTER_ROWS = 2
"""Rows of six numbers that a reading takes."""
DISTANCE, NEWLY_EXITED, EXITED_FROM_REGION, IN_REGION, EXITED, IN_INNER, NEAR, PROBED, CLEARANCE = range(9)
COUNTED, LATCHING = 1, 2
"""What is done with a particle: counted, and counted when it leaves the bounds."""
WAS_IN_REGION, HAS_EXITED = 1, 2
"""Flags that a particle keeps between readings."""
MAX_READINGS = 64
"""Readings in one advance."""
FAR = 1.0
"""Clearance [m] where no point is near the probe."""


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


@ti.data_oriented
class RegionCounter:
    """Counts the particles of a solver in regions, near a collider and out of bounds.

    - counted: indices of the counted particles. latching: those of them whose exit from the bounds is counted and
      remembered; None: all.
    - point [m] (3,), weights (3,): `distance` is the weighted Manhattan distance to this point.
    - region, bounds: fixed in the world. inner: fixed in the frame of collider `index`; a particle in it does not count
      as outside the bounds.
    - reach: particles within this distance [m] of the collider's surface count as near; None: not counted.
    - points: (n, 3) [m] in the world. They are probed: compared with the signed distance `probe`, in the collider's
      frame, and a margin [m]. None: no points.
    - per_particle: whether a reading has the values of each particle.

    After `Solver.attach` it is evaluated within advances. Raises InvalidValue for a shell with a reach.
    """

    def __init__(self, solver: Any, counted: np.ndarray, *, point: np.ndarray, weights: np.ndarray, region: Region,
                 bounds: Region, inner: Region, index: int, reach: float | None = None,
                 points: np.ndarray | None = None, probe: Any = None, margin: float = 0.0, per_particle: bool = False,
                 latching: np.ndarray | None = None) -> None:
        shape = solver.colliders[index].sdf
        if reach is not None and isinstance(shape, Shell):
            raise InvalidValue("RegionCounter: reach from a shell; accepted: a solid, or reach=None")
        self.solver, self.particles, self.shape, self.index = solver, solver.particles, shape, index
        self.reach, self.margin = reach or 0.0, margin
        self.counts_near, self.has_points, self.per_particle = reach is not None, points is not None, per_particle
        roles = np.zeros(self.particles.n_lanes, np.int8)
        roles[self.particles.index[counted]] = COUNTED
        roles[self.particles.index[counted if latching is None else latching]] = COUNTED + LATCHING
        self.probe, self.points = probe, None
        with allocating():
            # in a field, because kernels take Python's numbers for single precision
            numbers = np.concatenate([region.row, bounds.row, inner.row, solver.grid.origin, point, weights])
            self.numbers = ti.field(ti.f64, len(numbers))
            put(self.numbers, numbers)
            self.roles, self.flags = (ti.field(ti.i8, len(roles)) for _ in range(2))
            put(self.roles, roles)
            if points is not None:
                self.points = ti.Vector.field(3, ti.f32, len(points))
                put(self.points, np.asarray(points, np.float32))
                probe.allocate()
        self._out = np.zeros((COUNTER_ROWS, 6))
        self.slots = self.particles.index[counted]
        """Rows of the per-particle values of a launch that belong to the counted particles."""
        self.per_particle_shape = (len(roles) if per_particle else 1, 2)
        """Shape of the per-particle values of one reading."""
        self._per_particle = np.zeros((1, *self.per_particle_shape), np.float32)

    def restart(self) -> None:
        """Forget which particles have left the bounds; those outside now are not counted as newly exited."""
        self._set_state_aside()
        self.flags.fill(0)
        self.read()

    def _set_state_aside(self) -> None:
        """Complete a pending checkpoint of the solver before the flags change."""
        if self.solver.counter is self:
            self.solver.rollback.store_pending()

    def read(self) -> Counts:
        """Return the counts of the current state."""
        self._set_state_aside()
        pose: Pose = self.solver.collider_pose(self.index)
        self._out[:] = 0.0
        self._sum(np.concatenate([pose.position, pose.matrix.ravel()]), self._out, self._per_particle)
        return self.counts_from(self._out, self._per_particle[0])

    def counts_from(self, rows: np.ndarray, per_particle: np.ndarray) -> Counts:
        """Return the counts for two rows of sums, and the numbers of single particles."""
        sums = rows.ravel()
        return Counts(float(sums[DISTANCE]), *[int(v) for v in sums[NEWLY_EXITED:CLEARANCE]], float(sums[CLEARANCE]),
                      per_particle[self.slots] if self.per_particle else None)

    @ti.kernel
    def _sum(self, pose: ti.types.ndarray(), out: ti.types.ndarray(), per_particle: ti.types.ndarray()):
        ti.loop_config(serialize=True)
        for _ in range(1):
            c = ti.Vector([pose[k] for k in range(3)])
            R = ti.Matrix([[pose[3 + 3 * i + j] for j in range(3)] for i in range(3)])
            self.accumulate(c, R, out, 0)
            if ti.static(self.per_particle):
                self.list_particles(per_particle, 0)

    @ti.func
    def list_particles(self, per_particle: ti.template(), reading):
        """Store what each counted particle adds, after `accumulate`."""
        for slot in range(self.particles.pack_count[None] * LANES):
            if self.roles[slot] > 0:
                per_particle[reading, slot, 0] = ti.cast(self.distance(self.position(slot)), ti.f32)
                per_particle[reading, slot, 1] = ti.cast(self.flags[slot] & WAS_IN_REGION, ti.f32) / WAS_IN_REGION

    @ti.func
    def accumulate(self, c, R, out: ti.template(), row):
        """Add the sums, with the collider at c, R, to two rows of out from `row` on, which hold zeros."""
        add(out, row, CLEARANCE, FAR)
        for slot in range(self.particles.pack_count[None] * LANES):
            if ti.static(self.counts_near):
                self.count_near(slot, c, R, out, row)
            if self.roles[slot] > 0:
                self.count(slot, c, R, out, row)
        if ti.static(self.has_points):
            self.probe_points(c, R, out, row)

    @ti.func
    def position(self, slot):
        """Return the world coordinates [m] of a slot's particle in double precision."""
        q, l = slot // LANES, slot % LANES
        return ti.Vector([ti.cast(self.particles.x[d][q][l], ti.f64) + self.numbers[ORIGIN + d] for d in range(3)])

    @ti.func
    def distance(self, x):
        """Return the weighted Manhattan distance [m] to the point."""
        total = ti.cast(0.0, ti.f64)
        for d in ti.static(range(3)):
            total += self.numbers[WEIGHTS + d] * ti.abs(x[d] - self.numbers[POINT + d])
        return total

    @ti.func
    def contains(self, region: ti.template(), x):
        """Return whether a region contains a point in its frame."""
        base = ti.static(REGION_NUMBERS * region)
        u = ti.Vector([(x[d] - self.numbers[base + d]) * self.numbers[base + 3 + d] for d in range(3)])
        upright = ti.abs(u[2]) < 1.0
        flat = u[0] * u[0] + u[1] * u[1] < 1.0
        if self.numbers[base + 6] < 0.5:
            flat = ti.abs(u[0]) < 1.0 and ti.abs(u[1]) < 1.0
        return upright and flat

    @ti.func
    def count(self, slot, c, R, out: ti.template(), row):
        """Add one particle's share of the sums."""
        x = self.position(slot)
        in_region, in_inner = self.contains(REGION, x), self.contains(INNER, R.transpose() @ (x - c))
        flags = ti.cast(self.flags[slot], ti.i32)
        exited = flags & HAS_EXITED
        if exited == 0 and not in_inner and self.roles[slot] > COUNTED and not self.contains(BOUNDS, x):
            exited = HAS_EXITED
            add(out, row, NEWLY_EXITED, 1.0)
            if flags & WAS_IN_REGION:
                add(out, row, EXITED_FROM_REGION, 1.0)
        add(out, row, DISTANCE, self.distance(x))
        add(out, row, IN_INNER, ti.cast(in_inner, ti.f64))
        add(out, row, IN_REGION, ti.cast(in_region, ti.f64))
        add(out, row, EXITED, ti.cast(exited > 0, ti.f64))
        self.flags[slot] = ti.cast(exited + ti.cast(in_region, ti.i32) * WAS_IN_REGION, ti.i8)

    @ti.func
    def count_near(self, slot, c, R, out: ti.template(), row):
        """Count a slot's particle where it is within reach of the collider."""
        r = self.position(slot) - c
        if r.norm_sqr() < ti.static((self.shape.radius + self.reach) ** 2) and \
                self.particles.volume[slot // LANES][slot % LANES] > 0:
            y = ti.cast(R.transpose() @ r, ti.f32)
            if not self.shape.is_beyond(y, self.reach):
                _, phi = self.shape.at(y)
                if phi < self.reach:
                    add(out, row, NEAR, 1.0)

    @ti.func
    def probe_points(self, c, R, out: ti.template(), row):
        """Look the points up in the signed distance of the probe."""
        nearest = ti.cast(FAR, ti.f64)
        for i in range(self.points.shape[0]):
            r = ti.cast(self.points[i], ti.f64) - c
            if r.norm_sqr() < ti.static((self.probe.radius + self.margin) ** 2):
                _, phi = self.probe.at(ti.cast(R.transpose() @ r, ti.f32))
                nearest = ti.min(nearest, ti.cast(phi, ti.f64))
                if phi < self.margin:
                    add(out, row, PROBED, 1.0)
        add(out, row, CLEARANCE, nearest - FAR)


@ti.func
def add(out: ti.template(), row, place: ti.template(), value):
    """Add to one of the sums."""
    out[row + ti.static(place // 6), ti.static(place % 6)] += value
