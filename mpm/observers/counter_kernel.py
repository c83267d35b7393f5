"""The kernel of a counter: its fields, and what is compiled into the launches that it reads in."""

from typing import Any

import numpy as np

from mpm.backend import is_shared, put, ti
from mpm.backend.launching import Launcher
from mpm.state.ledger import add
from mpm.state.packs import LANES
from mpm.state.particles import ParticleFields

REGION_NUMBERS = 7  # numbers of a region as the kernel reads it
REGION, BOUNDS, INNER = range(3)  # the regions, in the order of their numbers
ORIGIN, WEIGHTS, POINT = range(3 * REGION_NUMBERS, 3 * REGION_NUMBERS + 9, 3)
"""Where the grid's origin and the distance's numbers follow on those of the regions."""
FRAME, PLACE, TURN, FRAME_NUMBERS = POINT, POINT + 3, POINT + 6, 15
"""Where the numbers begin that `RegionCounter.place` sets: the point, and the frame's position and rotation."""
COUNTER_ROWS = 2  # rows of six numbers that a reading takes
DISTANCE, NEWLY_EXITED, EXITED_FROM_REGION, IN_REGION, EXITED, IN_INNER, NEAR, PROBED, CLEARANCE = range(9)
COUNTED, LATCHING = 1, 2  # what is done with a particle: counted, and counted when it leaves the bounds
WAS_IN_REGION, HAS_EXITED = 1, 2  # flags that a particle keeps between readings
FAR = 1.0  # clearance [m] where no point is near the probe


@ti.func
def pose_of(numbers: ti.template()):
    """Return position [m] (3,) and rotation matrix (3, 3) from twelve numbers, the matrix row by row."""
    return (ti.Vector([numbers[d] for d in range(3)]),
            ti.Matrix([[numbers[3 + 3 * i + j] for j in range(3)] for i in range(3)]))


@ti.data_oriented
class CounterKernel:
    """What a `RegionCounter` compiles: see there for the arguments.
    shape: of the collider that particles are near, or None. n_points: of those looked up in the probe, or 0."""

    def __init__(self, particles: ParticleFields, index: int, shape: Any, reach: float, probe: Any, n_points: int,
                 margin: float, per_particle: bool) -> None:
        self.particles, self.index, self.shape, self.reach = particles, index, shape, reach
        self.probe, self.margin, self.per_particle = probe, margin, per_particle
        self.counts_near, self.has_points, self.on_gpu = shape is not None, n_points > 0, is_shared()
        # in a field, because kernels take Python's numbers for single precision
        self.numbers = ti.field(ti.f64, FRAME + FRAME_NUMBERS)
        self.roles, self.flags = (ti.field(ti.i8, particles.n_lanes) for _ in range(2))
        self.write_frame = Launcher(self, CounterKernel._write_frame)
        """Writes the numbers of the frame (FRAME_NUMBERS,)."""
        self.points = ti.Vector.field(3, ti.f32, n_points) if n_points else None

    def fill(self, numbers: np.ndarray, roles: np.ndarray, points: np.ndarray | None) -> None:
        """Write what is counted; numbers: of the regions, origin, weights, and of the frame."""
        put(self.numbers, numbers)
        put(self.roles, roles)
        self.flags.fill(0)
        if self.points is not None and points is not None:
            put(self.points, np.asarray(points, np.float32))

    @ti.kernel
    def _write_frame(self, numbers: ti.types.ndarray()):
        ti.loop_config(serialize=True)
        for i in range(ti.static(FRAME_NUMBERS)):
            self.numbers[ti.static(FRAME) + i] = numbers[i]

    @ti.kernel
    def sum_now(self, pose: ti.types.ndarray(), out: ti.types.ndarray(), per_particle: ti.types.ndarray()):
        """Add the sums of the present state, with the collider at a pose (12,), to out (COUNTER_ROWS, 6)."""
        ti.loop_config(serialize=not self.on_gpu)
        for slot in range(self.particles.pack_count[None] * LANES):
            c, R = pose_of(pose)
            self.count_slot(slot, c, R, out, 0, per_particle, 0)

    @ti.func
    def accumulate(self, c, R, out: ti.template(), row, per_particle: ti.template(), reading):
        """Add the sums, with the collider at c, R, to two rows of out from `row` on, which hold zeros.
        Where a counter asks for them, what each particle adds is stored in row `reading` of per_particle."""
        for slot in range(self.particles.pack_count[None] * LANES):
            self.count_slot(slot, c, R, out, row, per_particle, reading)

    @ti.func
    def count_slot(self, slot, c, R, out: ti.template(), row, per_particle: ti.template(), reading):
        """Add one slot's share of the sums, see `accumulate`; the first one's thread also looks up the points."""
        if slot == 0:
            self.probe_points(c, R, out, row)
        if ti.static(self.counts_near):
            self.count_near(slot, c, R, out, row)
        if self.roles[slot] > 0:
            self.count(slot, c, R, out, row)
            if ti.static(self.per_particle):
                per_particle[reading, slot, 0] = ti.cast(self.distance(self.position(slot)), ti.f32)
                per_particle[reading, slot, 1] = ti.cast(self.flags[slot] & WAS_IN_REGION, ti.f32) / WAS_IN_REGION

    @ti.func
    def position(self, slot):
        """Return the world coordinates [m] of a slot's particle in double precision."""
        q, l = slot // LANES, slot % LANES
        return ti.Vector([ti.cast(self.particles.x[d][q][l], ti.f64) + self.numbers[ORIGIN + d] for d in range(3)])

    @ti.func
    def in_frame(self, x):
        """Return a point of the world in the frame of regions and points."""
        r = ti.Vector([x[d] - self.numbers[PLACE + d] for d in range(3)])
        return ti.Vector([self.numbers[TURN + d] * r[0] + self.numbers[TURN + 3 + d] * r[1]
                          + self.numbers[TURN + 6 + d] * r[2] for d in range(3)])

    @ti.func
    def from_frame(self, y):
        """Return a point of that frame in the world."""
        return ti.Vector([self.numbers[TURN + 3 * d] * y[0] + self.numbers[TURN + 3 * d + 1] * y[1]
                          + self.numbers[TURN + 3 * d + 2] * y[2] + self.numbers[PLACE + d] for d in range(3)])

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
        y = self.in_frame(x)
        in_region, in_inner = self.contains(REGION, y), self.contains(INNER, R.transpose() @ (x - c))
        flags = ti.cast(self.flags[slot], ti.i32)
        exited = flags & HAS_EXITED
        if exited == 0 and not in_inner and self.roles[slot] > COUNTED and not self.contains(BOUNDS, y):
            exited = HAS_EXITED
            add(out, row + ti.static(NEWLY_EXITED // 6), ti.static(NEWLY_EXITED % 6), 1.0)
            if flags & WAS_IN_REGION:
                add(out, row + ti.static(EXITED_FROM_REGION // 6), ti.static(EXITED_FROM_REGION % 6), 1.0)
        add(out, row + ti.static(DISTANCE // 6), ti.static(DISTANCE % 6), self.distance(x))
        add(out, row + ti.static(IN_INNER // 6), ti.static(IN_INNER % 6), ti.cast(in_inner, ti.f64))
        add(out, row + ti.static(IN_REGION // 6), ti.static(IN_REGION % 6), ti.cast(in_region, ti.f64))
        add(out, row + ti.static(EXITED // 6), ti.static(EXITED % 6), ti.cast(exited > 0, ti.f64))
        self.flags[slot] = ti.cast(exited + ti.cast(in_region, ti.i32) * WAS_IN_REGION, ti.i8)

    @ti.func
    def count_near(self, slot, c, R, out: ti.template(), row):
        """Count a slot's particle where it is within reach of the collider."""
        r = self.position(slot) - c
        if r.norm_sqr() < ti.static((self.shape.radius + self.reach) ** 2) and \
                self.particles.volume[slot // LANES][slot % LANES] > 0:
            y = ti.cast(R.transpose() @ r, ti.f32)
            if self.shape.is_within(y, self.reach):
                add(out, row + ti.static(NEAR // 6), ti.static(NEAR % 6), 1.0)

    @ti.func
    def probe_points(self, c, R, out: ti.template(), row):
        """Look the points up in the signed distance of the probe; add the clearance, FAR where no point is near."""
        nearest = ti.cast(FAR, ti.f64)
        if ti.static(self.has_points):
            for i in range(self.points.shape[0]):
                r = self.from_frame(ti.cast(self.points[i], ti.f64)) - c
                if r.norm_sqr() < ti.static((self.probe.radius + self.margin) ** 2):
                    _, phi = self.probe.at(ti.cast(R.transpose() @ r, ti.f32))
                    nearest = ti.min(nearest, ti.cast(phi, ti.f64))
                    if phi < self.margin:
                        add(out, row + ti.static(PROBED // 6), ti.static(PROBED % 6), 1.0)
        add(out, row + ti.static(CLEARANCE // 6), ti.static(CLEARANCE % 6), nearest)
