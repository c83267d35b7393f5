"""Many substeps in one launch: forwards with every state kept, or backwards with bars in place of states."""

from mpm.adjoint.constitutive import Through, revisit, stored, stress_back
from mpm.adjoint.contact import backstop_back, nodes_back
from mpm.adjoint.history import History
from mpm.adjoint.particles import ParticleBars
from mpm.adjoint.transfer import gather_back, scatter_back
from mpm.adjoint.walls import WallTape, fold_back, unfold_back
from mpm.backend import real_type, ti
from mpm.contact import backstop, update_nodes
from mpm.grid import BLOCK, clear
from mpm.mirror import fold, unfold
from mpm.numbers import PARAMETERS
from mpm.particles import LANES
from mpm.strain import keep

POSITIONS, VELOCITIES, ALL = range(3)


class After:
    """Velocities and positions of the grains after a substep, before the backstop."""

    def __init__(self, n_packs: int, precision: str) -> None:
        real = real_type(precision)
        self.x = [ti.Vector.field(LANES, real, n_packs) for _ in range(3)]
        self.v = [ti.Vector.field(LANES, real, n_packs) for _ in range(3)]


@ti.data_oriented
class Sweep:
    """The kernel of one roll-out. materials: whether bars of the laws' numbers are wanted. limit: largest entry of a
    bar of the state, beyond which it is cut; None: not compiled."""

    def __init__(self, solver, history: History, *, materials: bool, limit: float | None) -> None:  # noqa: ANN001
        self.scene, self.particles, self.history = solver._substeps, solver.particles, history
        self.grid, self.walls, self.laws = solver.fields, solver._substeps.walls, solver._substeps.laws
        self.bars = ParticleBars(self.particles, solver.precision)
        self.after = After(self.particles.n_packs, solver.precision)
        self.through = Through(self.laws, self.particles.n_packs, solver.precision)
        self.tape = WallTape(solver.grid, solver.precision)
        real = real_type(solver.precision)
        self.node_bars = ti.Vector.field(4, real, solver.grid.shape)
        self.folded = ti.Vector.field(4, real, solver.grid.shape)
        """Momentum and mass of nodes, after the walls' images were added."""
        self.numbers_bar = ti.field(ti.f64, (len(self.laws), PARAMETERS))
        self.products = ti.Vector.field(4, real, 3)
        """Of one grain, by axis, on their way to sums; see `offset_bar`."""
        self.cell, self.origin = self.scene.cell, self.scene.origin
        self.materials, self.cuts, self.limit = materials, limit is not None, limit or 0.0
        self.tool = solver.features.moving_solids
        self.state_fields = [field for fields in self.bars.named_fields().values() for field in fields]

    @ti.kernel
    def run(self, forward: ti.i32, first: ti.i32, substeps: ti.i32, interval: ti.i32, first_stamp: ti.i32, dt: float,
            motion: ti.types.ndarray(), loss_bar: ti.types.ndarray(), motion_bar: ti.types.ndarray(),
            norms: ti.types.ndarray(), mobile: ti.types.ndarray(), out: ti.types.ndarray()):
        """`substeps` of dt [s] from the state in slot `first` on, each state kept in the next slot, or back over them,
        with bars of the state after them in `bars`.

        motion (1, substeps, 18): of the tool. loss_bar (k, 6, packs, 4): what the loss adds to the bars of positions
        and velocities in slot interval, 2 interval ... Written: motion_bar (substeps, 18), norms (k, 3) of the bars of
        positions, velocities and all in slot 0, interval, 2 interval ..., out: status in its last row.
        """
        ti.loop_config(serialize=True)
        for t in range(substeps):
            s = t if forward > 0 else substeps - 1 - t
            stamp = first_stamp + 2 * t
            gravity = self.scene.numbers.gravity[None]
            corner = ti.Vector([ti.cast(self.origin[0], ti.f64), ti.cast(self.origin[1], ti.f64),
                                ti.cast(self.origin[2], ti.f64)])
            if forward == 0 or t == 0:
                self.history.load(first + s)
            self.scene.mark_blocks(self.particles, stamp)
            clear(self.grid, 0, self.grid.count[None])
            for body in ti.static(range(len(self.laws))):
                self.scene.to_grid(self.particles, self.laws[body], body, dt, out)
            fold(self.grid, self.walls, stamp, dt, gravity)
            if forward == 0:
                self.keep_nodes()
                if (first + s + 1) % interval == 0:
                    self.take_loss(loss_bar, (first + s + 1) // interval - 1)
            update_nodes(self.grid, self.scene, motion, s, dt, gravity, corner, self.cell, out)
            unfold(self.grid, self.walls, stamp, self.scene.numbers.wall_friction[None], corner, self.cell, out,
                   self.tape)
            if forward > 0:
                self.grid.count[None] = 0
                for body in ti.static(range(len(self.laws))):
                    self.scene.to_particles(self.particles, body, dt, stamp + 1)
                if ti.static(len(self.tool) > 0):
                    for body in ti.static(range(len(self.laws))):
                        backstop(self.particles, self.grid, self.scene, motion, s, mobile, dt, self.origin, body,
                                 stamp + 1, out)
                self.history.store(first + s + 1)
                if t == substeps - 1:
                    self.scene.take_status(out)
            else:
                self.back(motion, s, first + s, dt, corner, motion_bar)
                if (first + s) % interval == 0:
                    self.measure(norms, (first + s) // interval)

    @ti.func
    def back(self, motion: ti.template(), s: ti.i32, slot: ti.i32, dt, corner, motion_bar: ti.template()):
        """The adjoint of substep s, from slot on, with its nodes' velocities at hand."""
        self.take_after(slot + 1)
        for index in ti.static(self.tool):
            for body in ti.static(range(len(self.laws))):
                backstop_back(self.scene, self.particles, self.bars, self.after, index, body, motion, s, dt, motion_bar)
        for body in ti.static(range(len(self.laws))):
            gather_back(self.products, self.scene, self.node_bars, self.particles, self.bars, self.after, body, dt)
        unfold_back(self.grid, self.tape, self.node_bars, self.walls, self.scene.numbers.wall_friction[None])
        nodes_back(self.scene, self.node_bars, self.folded, motion, s, dt, corner, motion_bar)
        fold_back(self.grid, self.tape, self.node_bars, self.walls)
        self.history.load_strains(slot)
        for body in ti.static(range(len(self.laws))):
            self.to_grid_back(self.laws[body], body, dt)
        if ti.static(self.cuts):
            for field in ti.static(self.state_fields):
                for q in range(self.particles.n_packs):
                    # written so that what is not a number stays none
                    over, under = field[q] > self.limit, field[q] < -self.limit
                    field[q] = ti.select(over, self.limit, ti.select(under, -self.limit, field[q]))

    @ti.func
    def to_grid_back(self, law: ti.template(), body: ti.template(), dt):
        """Adjoint of scatter, stress and flow of a body; the particles hold the state before. Three loops, because in
        one the compiler takes everything apart into scalars."""
        p = [keep(self.scene.numbers.parameters[body, i]) for i in range(PARAMETERS)]
        for q in range(self.particles.ranges[body][0], self.particles.ranges[body][1]):
            revisit(self.particles, self.through, law, q, dt, stored(self.particles.C, q), p)
        scatter_back(self.products, self.scene, self.node_bars, self.particles, self.bars, self.through.tau, body,
                     -dt * 4.0 / (self.cell * self.cell))
        for q in range(self.particles.ranges[body][0], self.particles.ranges[body][1]):
            rate_bar, p_bar = stress_back(self.particles, self.bars, self.through, law, q, dt,
                                          stored(self.particles.C, q), p)
            for i in ti.static(range(9)):
                self.bars.C[i][q] = self.bars.C[i][q] + rate_bar[i]
            if ti.static(self.materials):
                for i in ti.static(range(len(p_bar))):
                    self.numbers_bar[body, i] = self.numbers_bar[body, i] + ti.cast(p_bar[i].sum(), ti.f64)

    @ti.func
    def keep_nodes(self):
        """Copy the nodes of active blocks, and clear their bars."""
        for n in range(self.grid.count[None]):
            block = self.grid.active[n] * BLOCK
            for a, b in ti.ndrange(BLOCK, BLOCK):
                for c in ti.static(range(BLOCK)):
                    I = block + ti.Vector([a, b, c])
                    self.folded[I] = self.grid.nodes[I]
                    self.node_bars[I] = ti.Vector.zero(self.grid.nodes.dtype, 4)

    @ti.func
    def take_after(self, slot):
        """Positions and velocities of the state after."""
        for d in ti.static(range(3)):
            for q in range(self.particles.n_packs):
                self.after.x[d][q] = self.history.kept[slot, d, q]
                self.after.v[d][q] = self.history.kept[slot, 3 + d, q]

    @ti.func
    def take_loss(self, loss_bar: ti.template(), k):
        """Add the loss's bars of a reading."""
        for q in range(self.particles.n_packs):
            for l in ti.static(range(LANES)):
                for d in ti.static(range(3)):
                    self.bars.x[d][q][l] = self.bars.x[d][q][l] + loss_bar[k, d, q, l]
                    self.bars.v[d][q][l] = self.bars.v[d][q][l] + loss_bar[k, 3 + d, q, l]

    @ti.func
    def measure(self, norms: ti.template(), s):
        """Norms of the bars of positions and velocities; not finite if any bar is not."""
        for which, fields in ti.static(((POSITIONS, self.bars.x), (VELOCITIES, self.bars.v),
                                        (ALL, self.state_fields))):
            total = ti.cast(0.0, ti.f64)
            for q in range(self.particles.n_packs):
                for field in ti.static(fields):
                    wide = ti.cast(field[q], ti.f64)  # squares leave single precision before their roots do
                    total += wide.dot(wide)
            norms[s, which] = ti.sqrt(total)

    @ti.kernel
    def read(self, interval: ti.i32, out: ti.types.ndarray()):
        """Positions and velocities in slots interval, 2 interval ... into out (k, 6, packs, 4)."""
        ti.loop_config(serialize=True)
        for k in range(out.shape[0]):
            for i in range(6):
                for q in range(self.particles.n_packs):
                    for l in ti.static(range(LANES)):
                        out[k, i, q, l] = self.history.kept[(k + 1) * interval, i, q][l]
