"""What a task reads of the grains after every step: where they are, which were lost, what touches, in one launch."""

from typing import NamedTuple

import numpy as np

from mpm.backend import allocating, put, ti
from mpm.errors import InvalidValue
from mpm.geometry.region import Region
from mpm.geometry.rigid_motion import Pose
from mpm.geometry.shell import Shell
from mpm.state.packs import LANES

ROW = 7
"""Numbers of a region as the kernel reads it."""
ORIGIN, GOAL, WEIGHTS = range(3 * ROW, 3 * ROW + 9, 3)
"""Where the grid's origin and the distance's numbers follow on those of the regions."""
ROWS = 2
"""Rows of six numbers that a reading takes."""
DISTANCE, NEWLY_LOST, LOST_ON_TARGET, ON_TARGET, LOST, HELD, TOUCHING, PROBED, CLEARANCE = range(9)
COUNTED, LOSING = 1, 2
"""What is done with a grain: counted, and counted when lost."""
WAS_ON_TARGET, IS_LOST = 1, 2
"""Flags that a grain keeps from step to step."""
MAX_LOOKS = 64
"""Readings in one advance."""
FAR = 1.0
"""Clearance [m] where no point is near the tool."""


class Tallied(NamedTuple):
    """Sums over the counted grains."""

    distance: float
    """Weighted Manhattan distances to the goal [m]."""
    newly_lost: int
    """Grains that left the bounds since the last reading; each is lost once and for good."""
    lost_on_target: int
    """Those of them that were over the target at the last reading."""
    on_target: int
    lost: int
    held: int
    """Grains in the tool's interior."""
    touching: int
    """Grains (all, not only the counted ones) whose centre is within the reach of the tool's surface."""
    probed: int
    """Points of the scenery within the margin of the probe."""
    clearance: float
    """Smallest distance [m] of those points to the probe."""
    ranks: np.ndarray | None = None
    """With `ranks`: distance [m] of each counted grain, and 1 where it is on target (n, 2), float32."""


@ti.data_oriented
class Tally:
    """Reads a solver's grains against a goal, a target, bounds and a tool.

    chosen: indices of the counted grains; losing: those of them whose loss is counted, None: all. goal [m] (3,),
    weights (3,): of the Manhattan distance. target, bounds: in the world; interior: in the frame of collider `tool`; a
    grain in it is never lost. reach: [m] from the tool within which grains count as touching; None: not looked
    at. points: [m] (n, 3), scenery that is looked up in the signed distance `probe`, in the tool's frame, with a margin
    [m]; None: none. ranks: what each grain adds, too.

    A solver that it is attached to (`Solver.attach`) also reads within an advance.
    """

    def __init__(self, solver, chosen: np.ndarray, *, goal: np.ndarray, weights: np.ndarray,  # noqa: ANN001
                 target: Region, bounds: Region, interior: Region, tool: int, reach: float | None = None,
                 points: np.ndarray | None = None, probe=None, margin: float = 0.0,
                 ranks: bool = False, losing: np.ndarray | None = None) -> None:  # noqa: ANN001
        if reach is not None and isinstance(solver.colliders[tool].sdf, Shell):
            raise InvalidValue("Tally: reach with a shell as tool; accepted: a solid, or reach=None")
        self.particles, self.tool, self.solver = solver.particles, solver.colliders[tool].sdf, solver
        self.reach, self.margin, self.index = reach or 0.0, margin, tool
        self.touches, self.looks, self.ranks = reach is not None, points is not None, ranks
        counted = np.zeros(self.particles.n_lanes, np.int8)
        counted[self.particles.index[chosen]] = COUNTED
        counted[self.particles.index[chosen if losing is None else losing]] = COUNTED + LOSING
        self.probe = probe
        self.points = None
        with allocating():
            # in a field, because kernels take Python's numbers for single precision
            numbers = np.concatenate([target.row, bounds.row, interior.row, solver.grid.origin, goal, weights])
            self.numbers = ti.field(ti.f64, len(numbers))
            put(self.numbers, numbers)
            self.counted, self.flags, self.kept = (ti.field(ti.i8, len(counted)) for _ in range(3))
            put(self.counted, counted)
            if points is not None:
                self.points = ti.Vector.field(3, ti.f32, len(points))
                put(self.points, np.asarray(points, np.float32))
                probe.allocate()
        self._out = np.zeros((ROWS, 6))
        self.slots = self.particles.index[chosen]
        """Rows of a reading's ranks that belong to the counted grains."""
        self.ranks_shape = (len(counted) if ranks else 1, 2)
        """Numbers of single grains in one reading."""
        self._ranks = np.zeros((1, *self.ranks_shape), np.float32)

    def restart(self) -> None:
        """Forget who was lost or on target before: what is so now counts as found so."""
        self._keep_first()
        self.flags.fill(0)
        self.read()

    def _keep_first(self) -> None:
        """What a solver is to be returned to is copied before it changes."""
        if self.solver.tally is self:
            self.solver.way_back.copy_now()

    def keep(self) -> None:
        """Remember who was lost or on target, to return to with `rewind`."""
        self._copy(False)

    def rewind(self) -> None:
        """Back to what was kept last."""
        self._copy(True)

    @ti.kernel
    def _copy(self, back: bool):
        ti.loop_config(serialize=True)
        for slot in range(self.particles.pack_count[None] * LANES):
            if back:
                self.flags[slot] = self.kept[slot]
            else:
                self.kept[slot] = self.flags[slot]

    @ti.func
    def keep_flags(self):
        """As `keep`, within a launch."""
        for slot in range(self.particles.pack_count[None] * LANES):
            self.kept[slot] = self.flags[slot]

    def read(self) -> Tallied:
        """The present state."""
        self._keep_first()
        pose: Pose = self.solver.collider_pose(self.index)
        self._out[:] = 0.0
        self._sum(np.concatenate([pose.position, pose.matrix.ravel()]), self._out, self._ranks)
        return self.said(self._out, self._ranks[0])

    def said(self, rows: np.ndarray, ranks: np.ndarray) -> Tallied:
        """What two rows of sums and the numbers of single grains say."""
        sums = rows.ravel()
        return Tallied(float(sums[DISTANCE]), *[int(v) for v in sums[NEWLY_LOST:CLEARANCE]], float(sums[CLEARANCE]),
                       ranks[self.slots] if self.ranks else None)

    @ti.kernel
    def _sum(self, pose: ti.types.ndarray(), out: ti.types.ndarray(), ranks: ti.types.ndarray()):
        ti.loop_config(serialize=True)
        for _ in range(1):
            c = ti.Vector([pose[k] for k in range(3)])
            R = ti.Matrix([[pose[3 + 3 * i + j] for j in range(3)] for i in range(3)])
            self.accumulate(c, R, out, 0)
            if ti.static(self.ranks):
                self.rank(ranks, 0)

    @ti.func
    def rank(self, ranks: ti.template(), reading):
        """What each counted grain adds, after `accumulate`."""
        for slot in range(self.particles.pack_count[None] * LANES):
            if self.counted[slot] > 0:
                ranks[reading, slot, 0] = ti.cast(self.distance(self.place(slot)), ti.f32)
                ranks[reading, slot, 1] = ti.cast(self.flags[slot] & WAS_ON_TARGET, ti.f32) / WAS_ON_TARGET

    @ti.func
    def accumulate(self, c, R, out: ti.template(), row):
        """Sums with the tool at c, R into two rows of out, which hold zeros, from `row` on."""
        add(out, row, CLEARANCE, FAR)
        for slot in range(self.particles.pack_count[None] * LANES):
            if ti.static(self.touches):
                self.touch(slot, c, R, out, row)
            if self.counted[slot] > 0:
                self.count(slot, c, R, out, row)
        if ti.static(self.looks):
            self.look(c, R, out, row)

    @ti.func
    def place(self, slot):
        """World coordinates of a slot's grain, in double precision."""
        q, l = slot // LANES, slot % LANES
        return ti.Vector([ti.cast(self.particles.x[d][q][l], ti.f64) + self.numbers[ORIGIN + d] for d in range(3)])

    @ti.func
    def distance(self, x):
        """Weighted Manhattan distance to the goal."""
        total = ti.cast(0.0, ti.f64)
        for d in ti.static(range(3)):
            total += self.numbers[WEIGHTS + d] * ti.abs(x[d] - self.numbers[GOAL + d])
        return total

    @ti.func
    def holds(self, region: ti.template(), x):
        """Whether a region holds a point in its frame."""
        base = ti.static(ROW * region)
        u = ti.Vector([(x[d] - self.numbers[base + d]) * self.numbers[base + 3 + d] for d in range(3)])
        upright = ti.abs(u[2]) < 1.0
        flat = u[0] * u[0] + u[1] * u[1] < 1.0
        if self.numbers[base + 6] < 0.5:
            flat = ti.abs(u[0]) < 1.0 and ti.abs(u[1]) < 1.0
        return upright and flat

    @ti.func
    def count(self, slot, c, R, out: ti.template(), row):
        """One grain's share of the sums."""
        x = self.place(slot)
        on_target, held = self.holds(0, x), self.holds(2, R.transpose() @ (x - c))
        flags = ti.cast(self.flags[slot], ti.i32)
        lost = flags & IS_LOST
        if lost == 0 and not held and self.counted[slot] > COUNTED and not self.holds(1, x):
            lost = IS_LOST
            add(out, row, NEWLY_LOST, 1.0)
            if flags & WAS_ON_TARGET:
                add(out, row, LOST_ON_TARGET, 1.0)
        add(out, row, DISTANCE, self.distance(x))
        add(out, row, HELD, ti.cast(held, ti.f64))
        add(out, row, ON_TARGET, ti.cast(on_target, ti.f64))
        add(out, row, LOST, ti.cast(lost > 0, ti.f64))
        self.flags[slot] = ti.cast(lost + ti.cast(on_target, ti.i32) * WAS_ON_TARGET, ti.i8)

    @ti.func
    def touch(self, slot, c, R, out: ti.template(), row):
        """Whether a slot's grain touches the tool."""
        r = self.place(slot) - c
        if r.norm_sqr() < ti.static((self.tool.radius + self.reach) ** 2) and \
                self.particles.volume[slot // LANES][slot % LANES] > 0:
            y = ti.cast(R.transpose() @ r, ti.f32)
            if not self.tool.beyond(y, self.reach):
                _, phi = self.tool.at(y)
                if phi < self.reach:
                    add(out, row, TOUCHING, 1.0)

    @ti.func
    def look(self, c, R, out: ti.template(), row):
        """Points of the scenery near the probe."""
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
    """To one of the sums."""
    out[row + ti.static(place // 6), ti.static(place % 6)] += value

