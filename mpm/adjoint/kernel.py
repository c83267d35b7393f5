"""Many substeps in one launch: forwards with every state kept, or backwards with bars in place of states."""

from mpm.adjoint.node_contact import backstop_back, nodes_back
from mpm.adjoint.node_tape import NodeTape
from mpm.adjoint.particle_adjoints import ParticleBars
from mpm.adjoint.particle_grid import gather_back, held_bar, scatter_back
from mpm.adjoint.stress_update import Through, revisit, stored, stress_back
from mpm.adjoint.wall_ghosts import WallTape, fold_back, unfold_back
from mpm.backend import real_type, ti
from mpm.boundaries.node_contact import backstop, update_nodes
from mpm.boundaries.wall_ghosts import fold, unfold
from mpm.materials.hencky_strain import keep
from mpm.scene.grid import clear
from mpm.state.history import History
from mpm.state.packs import LANES
from mpm.state.parameters import PARAMETERS
from mpm.stepping.stride import MAX_SUBSTEPS, drift_after, drift_before, hold, stride

POSITIONS, VELOCITIES, ALL = range(3)


class After:
    """Velocities and positions of the grains after a substep, before the backstop."""

    def __init__(self, n_packs: int, precision: str) -> None:
        real = real_type(precision)
        self.x = [ti.Vector.field(LANES, real, n_packs) for _ in range(3)]
        self.v = [ti.Vector.field(LANES, real, n_packs) for _ in range(3)]


@ti.data_oriented
class Sweep:
    """The kernel of one roll-out. depth: the most substeps of a stride. materials: whether bars of the laws' numbers
    are wanted. limit: largest entry of a bar of the state, beyond which it is cut; None: not compiled. soft, svd: see
    `Through`."""

    def __init__(self, solver, history: History, *, depth: int, materials: bool, limit: float | None,  # noqa: ANN001
                 soft: float, svd: bool) -> None:
        self.scene, self.particles, self.history = solver._substeps, solver.particles, history
        self.grid, self.walls, self.laws = solver.fields, solver._substeps.walls, solver._substeps.laws
        self.bars = ParticleBars(self.particles, solver.precision)
        self.after = After(self.particles.n_packs, solver.precision)
        self.through = Through(self.laws, self.particles.n_packs, solver.precision, svd=svd, soft=soft)
        self.depth = depth
        self.tape = WallTape(solver.grid, solver.precision, depth)
        self.nodes = NodeTape(solver.grid, solver.precision, depth)
        self.begin = ti.field(ti.i32, history.kept.shape[0])
        """First slot of the stride that a slot's substep belongs to."""
        real = real_type(solver.precision)
        self.numbers_bar = ti.field(ti.f64, (len(self.laws), PARAMETERS))
        self.products = ti.Vector.field(4, real, 3)
        """Of one grain, by axis, on their way to sums; see `offset_bar`."""
        self.cell, self.origin = self.scene.cell, self.scene.origin
        self.materials, self.cuts, self.limit = materials, limit is not None, limit or 0.0
        self.tool = solver.features.moving_solids
        self.state_fields = self.bars.packs.fields

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
        for _ in range(1):
            corner = self.scene.corner_of_grid()
            done = 0
            while done < substeps:
                begin, span = done, 1
                if forward > 0:
                    if done == 0:
                        self.history.load(first)
                    if ti.static(self.depth > 1):
                        most = ti.min(self.depth, interval - done % interval)
                        most = ti.min(most, MAX_SUBSTEPS - done % interval % MAX_SUBSTEPS)  # as `launches` cuts
                        span = stride(self.scene, motion, done, mobile, dt, most)
                else:
                    begin = self.begin[first + substeps - done - 1] - first
                    span = substeps - done - begin
                for k in range(span):
                    if forward == 0:
                        self.history.load(first + begin + k)
                    if k == 0:
                        self.drift(drift_before(dt, span))
                    self.to_nodes(motion, begin + k, k, first_stamp + 2 * done, dt, corner, forward, out)
                    if forward > 0:
                        self.begin[first + begin + k] = first + begin
                        self.move(motion, begin + k, span * (k == span - 1), first_stamp + 2 * done + 1, dt, mobile,
                                  out)
                        self.history.store(first + begin + k + 1)
                    else:
                        self.nodes.keep(self.grid, self.nodes.velocities, k)
                if forward == 0:
                    for back in range(span):
                        k = span - 1 - back
                        if k < span - 1:
                            self.history.load(first + begin + k)
                            if k == 0:
                                self.drift(drift_before(dt, span))
                            self.nodes.bring(self.grid, k)
                            self.nodes.hold_back(self.grid, k)
                        else:
                            self.nodes.clear_bars(self.grid)
                            if (first + begin + span) % interval == 0:
                                self.take_loss(loss_bar, (first + begin + span) // interval - 1)
                        self.back(motion, begin + k, k, span * (k == span - 1), first + begin + k, dt, corner,
                                  motion_bar)
                        if k == 0:
                            self.drift_back(drift_before(dt, span))
                        if (first + begin + k) % interval == 0:
                            self.measure(norms, (first + begin + k) // interval)
                done += span
            if forward > 0:
                self.scene.take_status(out, 0, self.particles.pack_count[None])

    @ti.func
    def drift(self, dt):
        """Move all grains for dt [s], before their blocks are listed."""
        if ti.static(self.depth > 1):
            for q in range(self.particles.pack_count[None]):
                for d in ti.static(range(3)):
                    x = self.particles.x[d][q]
                    self.particles.x[d][q] = ti.select(dt > 0, self.scene.moved(x + dt * self.particles.v[d][q], d), x)

    @ti.func
    def drift_back(self, dt):
        """Adjoint of `drift`; the particles hold the positions after it."""
        if ti.static(self.depth > 1):
            for q in range(self.particles.pack_count[None]):
                for d in ti.static(range(3)):
                    bar = held_bar(self.scene, self.particles.x[d][q], self.bars.x[d][q], d, dt)
                    self.bars.x[d][q] = bar
                    self.bars.v[d][q] = self.bars.v[d][q] + dt * bar

    @ti.func
    def to_nodes(self, motion: ti.template(), s: ti.i32, k: ti.i32, stamp: ti.i32, dt, corner, forward: ti.i32,
                 out: ti.template()):
        """Substep s of the motion, the k-th of its stride, as far as to the nodes' velocities."""
        gravity = self.scene.numbers.gravity[None]
        if k == 0:
            self.scene.mark_blocks(self.particles, stamp)
            clear(self.grid, 0, self.grid.count[None])
        elif ti.static(self.depth > 1):
            hold(self.grid, 0, self.grid.count[None])
        for body in ti.static(range(len(self.laws))):
            first_pack, last_pack = ti.static(self.particles.ranges[body])
            self.scene.to_grid(self.particles, self.laws[body], body, dt, out, k == 0, first_pack, last_pack, 0)
        fold(self.grid, self.walls, stamp, dt, gravity)
        if forward == 0:
            self.nodes.keep(self.grid, self.nodes.folded, k)
        update_nodes(self.grid, self.scene, motion, s, dt, gravity, corner, self.cell, out, 0, self.grid.count[None])
        self.tape.at[None] = k
        unfold(self.grid, self.walls, stamp, self.scene.numbers.wall_friction[None], corner, self.cell, out, self.tape)

    @ti.func
    def move(self, motion: ti.template(), s: ti.i32, span: ti.i32, stamp: ti.i32, dt, mobile: ti.template(),
             out: ti.template()):
        """From the nodes to the grains, which move for `span` substeps, or stay where it is 0."""
        if span > 0:
            self.grid.count[None] = 0
        for body in ti.static(range(len(self.laws))):
            first_pack, last_pack = ti.static(self.particles.ranges[body])
            self.scene.to_particles(self.particles, body, drift_after(dt, span), stamp, first_pack, last_pack)
        if ti.static(len(self.tool) > 0) and span > 0:
            for body in ti.static(range(len(self.laws))):
                first_pack, last_pack = ti.static(self.particles.ranges[body])
                backstop(self.particles, self.grid, self.scene, motion, s, mobile, drift_after(dt, span), self.origin,
                         body, stamp, out, first_pack, last_pack)

    @ti.func
    def back(self, motion: ti.template(), s: ti.i32, k: ti.i32, span: ti.i32, slot: ti.i32, dt, corner,
             motion_bar: ti.template()):
        """The adjoint of `to_nodes` and `move` of substep s, from slot on, with its nodes' velocities at hand."""
        self.take_after(slot + 1)
        if span > 0:
            for index in ti.static(self.tool):
                for body in ti.static(range(len(self.laws))):
                    backstop_back(self.scene, self.particles, self.bars, self.after, index, body, motion, s,
                                  drift_after(dt, span), motion_bar)
        for body in ti.static(range(len(self.laws))):
            gather_back(self.products, self.scene, self.nodes.bars, self.particles, self.bars, self.after, body,
                        drift_after(dt, span))
        self.tape.at[None] = k
        unfold_back(self.grid, self.tape, self.nodes.bars, self.walls, self.scene.numbers.wall_friction[None])
        nodes_back(self.scene, self.nodes.bars, self.nodes.folded, k, motion, s, dt, corner, motion_bar)
        fold_back(self.grid, self.tape, self.nodes.bars, self.walls)
        self.history.load_strains(slot)
        for body in ti.static(range(len(self.laws))):
            self.to_grid_back(self.laws[body], body, dt, k == 0)
        if ti.static(self.cuts):
            for field in ti.static(self.state_fields):
                for q in range(self.particles.pack_count[None]):
                    # written so that what is not a number stays none
                    over, under = field[q] > self.limit, field[q] < -self.limit
                    field[q] = ti.select(over, self.limit, ti.select(under, -self.limit, field[q]))

    @ti.func
    def to_grid_back(self, law: ti.template(), body: ti.template(), dt, fresh):
        """Adjoint of scatter, stress and flow of a body; the particles hold the state before. Three loops, because in
        one the compiler takes everything apart into scalars."""
        p = [keep(self.scene.numbers.parameters[body, i]) for i in range(PARAMETERS)]
        for q in range(self.particles.ranges[body][0], self.particles.ranges[body][1]):
            revisit(self.particles, self.through, law, q, dt, stored(self.particles.C, q), p)
        scatter_back(self.products, self.scene, self.nodes.bars, self.particles, self.bars, self.through.tau, body,
                     -dt * 4.0 / (self.cell * self.cell), fresh)
        for q in range(self.particles.ranges[body][0], self.particles.ranges[body][1]):
            rate_bar, p_bar = stress_back(self.particles, self.bars, self.through, law, q, dt,
                                          stored(self.particles.C, q), p)
            for i in ti.static(range(9)):
                self.bars.C[i][q] = self.bars.C[i][q] + rate_bar[i]
            if ti.static(self.materials):
                for i in ti.static(range(len(p_bar))):
                    self.numbers_bar[body, i] = self.numbers_bar[body, i] + ti.cast(p_bar[i].sum(), ti.f64)

    @ti.func
    def take_after(self, slot):
        """Positions and velocities of the state after."""
        for d in ti.static(range(3)):
            for q in range(self.particles.pack_count[None]):
                self.after.x[d][q] = self.history.kept[slot, d, q]
                self.after.v[d][q] = self.history.kept[slot, 3 + d, q]

    @ti.func
    def take_loss(self, loss_bar: ti.template(), k):
        """Add the loss's bars of a reading."""
        for q in range(self.particles.pack_count[None]):
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
            for q in range(self.particles.pack_count[None]):
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
                for q in range(self.particles.pack_count[None]):
                    for l in ti.static(range(LANES)):
                        out[k, i, q, l] = self.history.kept[(k + 1) * interval, i, q][l]
