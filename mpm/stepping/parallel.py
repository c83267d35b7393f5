"""Substeps for several threads, or for a graphics card: a kernel each, in which every phase is a loop over parts.

A part is a stretch of packs, or of the list of active blocks. On a CPU there are a few for each thread, and each
scatters to an array of its own; these are added in their order, so that grains are the same to the bit whatever thread
comes first, with no atomic addition to a node. On a graphics card every pack is a part, and all add to the same nodes.
The ledger's sums are atomic on both: right to rounding.

One thread is served better by the single launch of `substep`.
"""

import numpy as np

from mpm.backend import is_concurrent, is_shared, real_type, thread_count, ti
from mpm.boundaries.node_contact import backstop, update_nodes
from mpm.boundaries.wall_ghosts import fold, fold_wall, unfold, unfold_wall
from mpm.errors import InvalidValue
from mpm.scene.features import Features
from mpm.scene.grid import BLOCK, GridFields, clear
from mpm.stepping.stride import drift_after, fastest_square, hold, stride_of
from mpm.stepping.substep import Substeps

SIDES = 6
CARD_PARTS = 4096
"""Parts of the list of blocks on a graphics card; not measured, for want of one."""
CARD_GROUP = 64
"""Parts that a group of a card's threads takes; not measured either."""
PARTS = 2
"""Parts for each thread of a CPU: one that wakes late leaves some to the others."""
TURNS = 512
"""Turns of a loop that Taichi 1.7.4 gives a thread of a CPU at least, whatever it is told: each part is as many, of
which one works."""


def are_shared(features: Features) -> bool:
    """Whether several threads advance a scene. One does where lists grow as grains and nodes are met; raises
    InvalidValue for these on a graphics card, where a single thread is slow."""
    serial = [name for name, has in (("thin shells", features.shells), ("mobile colliders", features.mobile),
                                     ("periodic sides", any(features.periodic))) if has]
    if serial and is_shared():
        raise InvalidValue(f"Solver: {', '.join(serial)} on a graphics card; accepted there: solids that move or "
                           f"stand, walls; everything with mpm.init(arch=\"cpu\")")
    return is_concurrent() and not serial


def substeps_of(scene) -> Substeps:  # noqa: ANN001  (a Solver)
    """The kernels that advance a solver's scene."""
    return Substeps(scene) if scene.shares is None else Phases(scene)


class Shares:
    """What threads have to themselves, and what they agree on."""

    def __init__(self, grid: GridFields, n_packs: int, precision: str) -> None:
        self.parts = n_packs if is_shared() else PARTS * thread_count()
        self.block_parts = CARD_PARTS if is_shared() else self.parts
        self.packs_each = -(-n_packs // self.parts)
        self.nodes = None
        """Momentum and mass as each part scatters them, one part after the other along x; zero between substeps."""
        if not is_shared():
            nx, ny, nz = grid.nodes.shape
            self.nodes = ti.Vector.field(4, real_type(precision), (self.parts * nx, ny, nz))
        self.fastest = ti.field(real_type(precision), ())
        """Largest squared speed of a grain [m^2/s^2]."""


@ti.data_oriented
class Phases(Substeps):
    """The kernels of one solver, called as `Substeps` is."""

    def __init__(self, scene) -> None:  # noqa: ANN001  (a Solver; see Substeps)
        super().__init__(scene)
        self.shares = scene.shares
        self.parts, self.block_parts, self.packs_each = (scene.shares.parts, scene.shares.block_parts,
                                                         scene.shares.packs_each)
        self.shared, self.width = is_shared(), scene.fields.nodes.shape[0]
        self.turns = 1 if self.shared else TURNS
        if not self.shared:
            self.target = scene.shares.nodes

    # as Substeps is called -------------------------------------------------------------------------------------------
    def mark(self, stamp: int) -> None:
        """List the blocks of the first substep."""
        if not self.shared:
            self.shares.nodes.fill(0.0)  # an interrupted substep leaves what was scattered
        self.drift_all(0.0, stamp)

    def run(self, substeps: int, first_stamp: int, dt: float, motion: np.ndarray, mobile: np.ndarray, out: np.ndarray,
            first: int, interval: int, ranks: np.ndarray, seen: np.ndarray, keep: int, stay: int) -> None:
        """See `Substeps.run`."""
        on_card = [Copy(array) for array in (motion, mobile, out, ranks, seen)] if self.shared else None
        motion_, mobile_, out_, ranks_, seen_ = [copy.there for copy in on_card] if on_card else (
            motion, mobile, out, ranks, seen)
        if substeps == 0:  # only to compile
            self.substep_in_phases(0, 0, dt, motion_, mobile_, out_, 1, 0, 0, 0)
        left, stamp, span = 0, first_stamp, 1
        for s in range(substeps):
            fresh = left == 0
            if fresh:
                stamp, span = first_stamp + s, 1
                if self.features.strides:
                    most = min(stay, substeps - s, interval - (first + s) % interval)
                    span = self.substeps_of_stride(s, dt, motion_, mobile_, most)
                    if span > 1:
                        self.drift_all(0.5 * dt * (span - 1), stamp)
                left = span
            left -= 1
            moved = span * (left == 0)
            self.substep_in_phases(s, stamp, dt, motion_, mobile_, out_, int(fresh), moved, self.parts,
                                   self.block_parts)
            if self.tallies and (first + s + 1) % interval == 0:
                self.read(motion_, s, first + s + 1, interval, out_, ranks_)
        self.sum_up(out_, seen_)
        for copy in on_card or ():
            copy.back()

    # kernels ---------------------------------------------------------------------------------------------------------
    @ti.kernel
    def substep_in_phases(self, s: ti.i32, stamp: ti.i32, dt: float, motion: ti.types.ndarray(),
                          mobile: ti.types.ndarray(), out: ti.types.ndarray(), fresh: ti.i32, span: ti.i32,
                          parts: ti.i32, block_parts: ti.i32):
        """One substep; see `Substeps.substep`. parts, block_parts: how many there are, 0 to do nothing."""
        if ti.static(self.shared):
            ti.loop_config(block_dim=CARD_GROUP)
            for part in range(block_parts):
                self.begin_nodes(part, fresh)
        ti.loop_config(block_dim=CARD_GROUP)
        for turn in range(parts * self.turns):
            if turn % self.turns == 0:
                self.scatter(turn // self.turns, dt, out, fresh)
        if ti.static(self.shared):
            for w in ti.static(range(SIDES)):
                ti.loop_config(block_dim=CARD_GROUP)
                for part in range(block_parts):
                    self.fold_part(part, w, stamp, dt)
        else:
            for turn in range(block_parts * self.turns):
                if turn % self.turns == 0:
                    self.gather_parts(turn // self.turns, fresh)
            ti.loop_config(serialize=True)  # waking a thread takes longer than a wall
            for _ in range(ti.min(parts, 1)):
                fold(self.grid, self.walls, stamp, dt, self.numbers.gravity[None])
        ti.loop_config(block_dim=CARD_GROUP)
        for turn in range(block_parts * self.turns):
            if turn % self.turns == 0:
                self.update_part(turn // self.turns, motion, s, dt, out)
        if ti.static(self.shared):
            for back in ti.static(range(SIDES)):
                ti.loop_config(block_dim=CARD_GROUP)
                for part in range(block_parts):
                    self.unfold_part(part, ti.static(SIDES - 1 - back), stamp, out)
        else:
            ti.loop_config(serialize=True)
            for _ in range(ti.min(parts, 1)):
                unfold(self.grid, self.walls, stamp, self.numbers.wall_friction[None], self.corner_of_grid(), self.cell,
                       out, self.tape)
        ti.loop_config(block_dim=CARD_GROUP)
        for turn in range(parts * self.turns):
            if turn % self.turns == 0:
                self.gather(turn // self.turns, motion, s, mobile, dt, stamp, span, out)
        self.grid.count[None] = self.grid.count[None] * (span == 0)
        ti.loop_config(serialize=not self.shared)
        for row in range(ti.static(self.grid.stamp.shape[0] * self.grid.stamp.shape[1]) * (span > 0)):
            self.list_row(row, stamp + span)

    @ti.kernel
    def drift_all(self, dt: float, stamp: ti.i32):
        """Move all grains for dt [s], and list the blocks that their stencils reach now, besides those of the stamp."""
        ti.loop_config(block_dim=CARD_GROUP)
        for turn in range(self.parts * self.turns):
            if turn % self.turns == 0:
                for body in ti.static(range(len(self.laws))):
                    first, last = self.packs_of(body, turn // self.turns)
                    self.drift(self.particles, dt, stamp, first, last)
        self.grid.count[None] = 0
        ti.loop_config(serialize=not self.shared)
        for row in range(ti.static(self.grid.stamp.shape[0] * self.grid.stamp.shape[1])):
            self.list_row(row, stamp)

    @ti.kernel
    def substeps_of_stride(self, s: ti.i32, dt: float, motion: ti.types.ndarray(), mobile: ti.types.ndarray(),
                           most: ti.i32) -> ti.i32:
        """Substeps of the stride that begins with s; see `stride`."""
        self.shares.fastest[None] = 0.0
        ti.loop_config(block_dim=CARD_GROUP)
        for turn in range(self.parts * self.turns):
            if turn % self.turns == 0:
                first = turn // self.turns * self.packs_each
                last = ti.min(first + self.packs_each, self.particles.pack_count[None])
                ti.atomic_max(self.shares.fastest[None], fastest_square(self.particles, first, last))
        return stride_of(self, motion, s, mobile, dt, most, self.shares.fastest[None])

    @ti.kernel
    def read(self, motion: ti.types.ndarray(), s: ti.i32, done: ti.i32, interval: ti.i32, out: ti.types.ndarray(),
             ranks: ti.types.ndarray()):
        """What the tally reads, by one thread."""
        ti.loop_config(serialize=True)
        for _ in range(1):
            if ti.static(self.tallies):
                self.look(motion, s, done, interval, out, ranks, 0)

    @ti.kernel
    def sum_up(self, out: ti.types.ndarray(), seen: ti.types.ndarray()):
        """Momentum, status and sample at the end of a launch."""
        ti.loop_config(block_dim=CARD_GROUP)
        for turn in range(self.parts * self.turns):
            if turn % self.turns == 0:
                for body in ti.static(range(len(self.laws))):
                    first, last = self.packs_of(body, turn // self.turns)
                    self.take_momentum(self.particles, body, self.corner_of_grid(), out, first, last)
                    self.take_status(out, first, last)
        ti.loop_config(serialize=True)
        for _ in range(1):
            if ti.static(self.samples):
                self.sample.take(seen, 0)

    # a part of a phase -----------------------------------------------------------------------------------------------
    @ti.func
    def packs_of(self, body: ti.template(), part):
        """First and last + 1 pack of a part that are a body's."""
        begin, end = ti.static(self.particles.ranges[body])
        return ti.max(part * self.packs_each, begin), ti.min((part + 1) * self.packs_each, end)

    @ti.func
    def blocks_of(self, part):
        """First and last + 1 active block of a part."""
        count = self.grid.count[None]
        each = (count + self.block_parts - 1) // self.block_parts
        return ti.min(part * each, count), ti.min((part + 1) * each, count)

    @ti.func
    def begin_nodes(self, part, fresh):
        """Momentum of the substep before, or none."""
        first, last = self.blocks_of(part)
        if fresh > 0:
            clear(self.grid, first, last)
        elif ti.static(self.features.strides):
            hold(self.grid, first, last)

    @ti.func
    def scatter(self, part, dt, out: ti.template(), fresh):
        """Stress and transfer of a part's packs."""
        shift = 0
        if ti.static(not self.shared):
            shift = part * self.width
        for body in ti.static(range(len(self.laws))):
            first, last = self.packs_of(body, part)
            self.to_grid(self.particles, self.laws[body], body, dt, out, fresh > 0, first, last, shift)

    @ti.func
    def gather_parts(self, part, fresh):
        """Add up what all parts have scattered to a part's blocks, and the momentum of the substep before where not
        fresh."""
        first, last = self.blocks_of(part)
        for n in range(first, last):
            corner = self.grid.active[n] * BLOCK
            for a, b in ti.ndrange(BLOCK, BLOCK):
                for c in ti.static(range(BLOCK)):
                    I = corner + ti.Vector([a, b, c])
                    total = ti.Vector.zero(self.grid.nodes.dtype, 4)
                    if fresh == 0:
                        q = self.grid.nodes[I]
                        total = ti.Vector([q[3] * q[0], q[3] * q[1], q[3] * q[2], q[3]])
                    for other in ti.static(range(self.parts)):
                        J = I + ti.Vector([other * self.width, 0, 0])
                        total += self.target[J]
                        self.target[J] = ti.Vector.zero(self.grid.nodes.dtype, 4)
                    self.grid.nodes[I] = total

    @ti.func
    def fold_part(self, part, w: ti.template(), stamp, dt):
        """See `fold_wall`."""
        first, last = self.blocks_of(part)
        fold_wall(self.grid, self.walls, w, stamp, dt, self.numbers.gravity[None], first, last)

    @ti.func
    def update_part(self, part, motion: ti.template(), s, dt, out: ti.template()):
        """See `update_nodes`."""
        first, last = self.blocks_of(part)
        update_nodes(self.grid, self, motion, s, dt, self.numbers.gravity[None], self.corner_of_grid(), self.cell, out,
                     first, last)

    @ti.func
    def unfold_part(self, part, w: ti.template(), stamp, out: ti.template()):
        """See `unfold_wall`."""
        first, last = self.blocks_of(part)
        unfold_wall(self.grid, self.walls, w, stamp, self.numbers.wall_friction[None], self.corner_of_grid(), self.cell,
                    out, self.tape, first, last)

    @ti.func
    def gather(self, part, motion: ti.template(), s, mobile: ti.template(), dt, stamp, span, out: ti.template()):
        """Velocities of a part's packs; they move at the end of a stride, when the backstop looks at them, too."""
        for body in ti.static(range(len(self.laws))):
            first, last = self.packs_of(body, part)
            self.to_particles(self.particles, body, drift_after(dt, span), stamp + span, first, last)
            if ti.static(len(self.features.moving_solids) > 0):  # noqa: SIM102  (decided when compiling)
                if span > 0:
                    backstop(self.particles, self.grid, self, motion, s, mobile, drift_after(dt, span), self.origin,
                             body, stamp + span, out, first, last)

    @ti.func
    def list_row(self, row, stamp):
        """Put the blocks of a row of the grid on the list that carry a stamp: in their order on a CPU, in any on a
        graphics card."""
        i, j = row // self.grid.stamp.shape[1], row % self.grid.stamp.shape[1]
        for k in range(self.grid.stamp.shape[2]):
            if self.grid.stamp[i, j, k] == stamp:
                self.grid.active[ti.atomic_add(self.grid.count[None], 1)] = ti.Vector([i, j, k])


class Copy:
    """An array on the graphics card during a launch."""

    def __init__(self, array: np.ndarray) -> None:
        self.array = array
        self.there = ti.ndarray(ti.f64 if array.dtype == np.float64 else ti.f32, array.shape)
        self.there.from_numpy(array)

    def back(self) -> None:
        """Bring what was written."""
        self.array[:] = self.there.to_numpy()
