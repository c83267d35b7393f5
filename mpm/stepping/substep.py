"""One launch of the field: all substeps of a host step in one serial kernel, touching only blocks with material."""

from mpm.backend import ti
from mpm.boundaries.coulomb import tool_axes, tool_origin
from mpm.boundaries.mobile_contact import begin_mobiles, meet, move_mobiles
from mpm.boundaries.node_contact import backstop, update_nodes
from mpm.boundaries.shell_sides import gather_cut, keep_for_cut, label_grains, label_nodes, scatter_cut
from mpm.boundaries.wall_ghosts import NoTape, fold, fold_periodic, open_homes, unfold, unfold_periodic
from mpm.materials.hencky_strain import FULL, INTEGRATORS, keep
from mpm.materials.stress_update import stress
from mpm.observers.tally import ROWS as TALLY_ROWS
from mpm.scene.grid import GHOST, clear, first_nodes, mark_pack
from mpm.state.ledger import FIRST_COLLIDER_ROW, GRAVITY_ROW, add, lift
from mpm.state.packs import LANES
from mpm.state.parameters import PARAMETERS
from mpm.stepping.stride import drift_after, drift_before, hold, stride
from mpm.transfers.particle_grid import gather_lane, lane, scatter_lane, weights

SPEED_LIMIT = 1.0
"""Cells that a grain may travel in a substep before the run counts as diverged."""


@ti.data_oriented
class Substeps:
    """The kernel of one solver; reads the solver's fields and features, both fixed."""

    def __init__(self, scene) -> None:  # noqa: ANN001  (a Solver; importing it here would be a cycle)
        self.particles, self.grid = scene.particles, scene.fields
        self.target = scene.fields.nodes
        """Where grains are scattered to."""
        self.numbers, self.cuts, self.mobiles = scene.numbers, scene.cuts, scene.mobiles
        self.features, self.colliders = scene.features, scene.colliders
        self.node_contact, self.node_owner = scene.node_contact, scene.node_owner
        self.laws = [body.material for body in scene.bodies]
        self.walls, self.tape = scene.numbers.walls, NoTape()
        self.cell = scene.grid.cell
        self.origin = tuple(float(c) for c in scene.grid.origin)
        self.cells = tuple(int(c) for c in scene.grid.cells)
        self.span = tuple(float(c) * self.cell for c in scene.grid.cells)
        self.corner = GHOST * self.cell
        self.logarithm, self.exponential = INTEGRATORS[scene.features.integrator]
        self.first_collider_row = FIRST_COLLIDER_ROW
        self.rows = FIRST_COLLIDER_ROW + len(scene.colliders) + 2
        self.momentum, self.status = self.rows - 2, self.rows - 1
        self.is_periodic = any(scene.features.periodic)
        self.mobile_place = tuple(scene.features.mobile.index(i) if i in scene.features.mobile else -1
                                  for i in range(len(scene.colliders)))
        self.meets_colliders = len(scene.colliders) > 0
        self.tally, self.first_tally_row = scene.tally, self.rows
        self.tallies = scene.tally is not None
        self.keeps = len(scene.features.mobile) > 0  # a coupled step may be taken back
        self.kept = scene.particles.snapshot() if self.keeps else None
        self.sample = scene.sample
        self.samples = scene.sample is not None
        self.tally_place = scene.features.moving_colliders.index(scene.tally.index) if self.tallies else -1

    @ti.kernel
    def mark(self, stamp: ti.i32):
        """List the blocks of the first substep; later ones are listed at the end of the substep before."""
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.mark_blocks(self.particles, stamp)

    @ti.kernel
    def run(self, substeps: ti.i32, first_stamp: ti.i32, dt: float, motion: ti.types.ndarray(),
            mobile: ti.types.ndarray(), out: ti.types.ndarray(), first: ti.i32, interval: ti.i32,
            ranks: ti.types.ndarray(), seen: ti.types.ndarray(), keep: ti.i32, stay: ti.i32):
        """Advance by `substeps` of dt [s]; motion (k, substeps, 18) of the moving colliders; mobile: those that contact
        moves (see `mobility`), read and written; out: ledger, status and what the tally read after every `interval`
        substeps, `first` of which lie in earlier launches of the advance; ranks: what it says of single grains then;
        seen: the sample after the last substep; keep: whether the state is first copied, to return to; stay: the most
        substeps between two transfers."""
        ti.loop_config(serialize=True)
        for _ in range(1):
            if ti.static(self.keeps):  # noqa: SIM102  (decided when compiling)
                if keep > 0:
                    self.kept.copy()
                    if ti.static(self.tallies):
                        self.tally.keep_flags()
            self.advance(substeps, first_stamp, dt, motion, 0, mobile, out, first, interval, ranks, 0, stay)
            for body in ti.static(range(len(self.laws))):
                first_pack, last_pack = ti.static(self.particles.ranges[body])
                self.take_momentum(self.particles, body, self.corner_of_grid(), out, first_pack, last_pack)
            self.take_status(out, 0, self.particles.pack_count[None])
            if ti.static(self.samples):
                self.sample.take(seen, 0)

    @ti.func
    def advance(self, substeps: ti.i32, first_stamp: ti.i32, dt, motion: ti.template(), first_row: ti.i32,
                mobile: ti.template(), out: ti.template(), first: ti.i32, interval: ti.i32, ranks: ti.template(),
                earlier: ti.i32, stay: ti.i32):
        """`substeps` with rows of the motion from first_row on, in strides of at most `stay`; see `run` and `look`."""
        left, stamp, span = 0, first_stamp, 1
        for s in range(substeps):
            fresh = left == 0
            if fresh:
                stamp, span = first_stamp + s, 1
                if ti.static(self.features.strides):
                    most = ti.min(ti.min(stay, substeps - s), interval - (first + s) % interval)
                    span = stride(self, motion, first_row + s, mobile, dt, most)
                    if span > 1:
                        self.drift(self.particles, drift_before(dt, span), stamp, 0, self.particles.pack_count[None])
                left = span
            left -= 1
            self.substep(first_row + s, stamp, dt, motion, mobile, out, fresh, span * (left == 0))
            if ti.static(self.tallies):
                self.look(motion, first_row + s, first + s + 1, interval, out, ranks, earlier)

    @ti.func
    def corner_of_grid(self):
        """The grid's origin in double precision."""
        return ti.Vector([ti.cast(self.origin[0], ti.f64), ti.cast(self.origin[1], ti.f64),
                          ti.cast(self.origin[2], ti.f64)])

    @ti.func
    def substep(self, s: ti.i32, stamp: ti.i32, dt, motion: ti.template(), mobile: ti.template(), out: ti.template(),
                fresh, span: ti.i32):
        """One substep, the s-th of the motion. fresh: nodes take momentum and mass from the grains, not from the
        substep before. span: 0, or the substeps of the stride that ends with this one; then grains move, and the blocks
        of the next one are listed."""
        gravity = self.numbers.gravity[None]
        corner = self.corner_of_grid()
        if fresh:
            clear(self.grid, 0, self.grid.count[None])
        elif ti.static(self.features.strides):
            hold(self.grid, 0, self.grid.count[None])
        if ti.static(len(self.features.mobile) > 0):
            begin_mobiles(self, mobile, motion, s, dt)
        if ti.static(len(self.features.shells) > 0):
            if fresh:
                if ti.static(self.is_periodic):
                    open_homes(self.grid, self.features.periodic, self.cells, stamp)
                label_nodes(self, motion, s, stamp, corner)
                label_grains(self, self.particles, motion, s)
            self.cuts.count[None] = 0
        for body in ti.static(range(len(self.laws))):
            first_pack, last_pack = ti.static(self.particles.ranges[body])
            self.to_grid(self.particles, self.laws[body], body, dt, out, fresh, first_pack, last_pack, 0)
        if ti.static(len(self.features.shells) > 0):
            scatter_cut(self)
        if ti.static(self.is_periodic):
            fold_periodic(self.grid, self.features.periodic, self.cells, stamp)
        fold(self.grid, self.walls, stamp, dt, gravity)
        update_nodes(self.grid, self, motion, s, dt, gravity, corner, self.cell, out, 0, self.grid.count[None])
        if ti.static(len(self.features.mobile) > 0):
            meet(self, mobile, corner, out)
            move_mobiles(self, mobile, motion, s, dt)
        unfold(self.grid, self.walls, stamp, self.numbers.wall_friction[None], corner, self.cell, out, self.tape)
        if ti.static(self.is_periodic):
            unfold_periodic(self.grid, self.features.periodic, self.cells)
        if span > 0:
            self.grid.count[None] = 0
        for body in ti.static(range(len(self.laws))):
            first_pack, last_pack = ti.static(self.particles.ranges[body])
            self.to_particles(self.particles, body, drift_after(dt, span), stamp + span, first_pack, last_pack)
        if ti.static(len(self.features.shells) > 0):
            gather_cut(self, motion, s, mobile, drift_after(dt, span), corner, stamp + span, out)
        if ti.static(len(self.features.moving_solids) > 0) and span > 0:
            for body in ti.static(range(len(self.laws))):
                first_pack, last_pack = ti.static(self.particles.ranges[body])
                backstop(self.particles, self.grid, self, motion, s, mobile, drift_after(dt, span), self.origin, body,
                         stamp + span, out, first_pack, last_pack)

    @ti.func
    def look(self, motion: ti.template(), s: ti.i32, done: ti.i32, interval: ti.i32, out: ti.template(),
             ranks: ti.template(), earlier: ti.i32):
        """Let the tally read after every `interval` substeps; `done` are behind, and `earlier` readings of others."""
        if done % interval == 0:
            k = ti.static(self.tally_place)
            read = done // interval - 1
            self.tally.accumulate(ti.cast(tool_origin(motion, k, s), ti.f64), ti.cast(tool_axes(motion, k, s), ti.f64),
                                  out, self.first_tally_row + ti.static(TALLY_ROWS) * read)
            if ti.static(self.tally.ranks):
                self.tally.rank(ranks, earlier + read)

    @ti.func
    def mark_blocks(self, P: ti.template(), stamp: ti.i32):
        """List the blocks that the stencils of all grains reach."""
        self.grid.count[None] = 0
        last = -1
        for q in range(P.pack_count[None]):
            last = mark_pack(self.grid, P.x, q, 1.0 / self.cell, last, stamp)

    @ti.func
    def drift(self, P: ti.template(), dt, stamp: ti.i32, first_pack, last_pack):
        """Move the grains of a stretch of packs for dt [s], and list the blocks that their stencils reach now, besides
        those listed."""
        last = -1
        for q in range(first_pack, last_pack):
            for r in ti.static(range(3)):
                P.x[r][q] = self.moved(P.x[r][q] + dt * P.v[r][q], r)
            last = mark_pack(self.grid, P.x, q, 1.0 / self.cell, last, stamp)

    @ti.func
    def to_grid(self, P: ti.template(), law: ti.template(), body: ti.template(), dt, out: ti.template(), fresh,
                first_pack, last_pack, shift):
        """Strain, plastic flow, stress of a stretch of a body's packs; then the stress's push to the grid (shift:
        nodes along x from the target's beginning), and momentum and mass where it is fresh."""
        p = [keep(self.numbers.parameters[body, i]) for i in range(PARAMETERS)]
        density = self.numbers.densities[body]
        force = -dt * 4.0 / (self.cell * self.cell)
        for q in range(first_pack, last_pack):
            C = [keep(P.C[i][q]) for i in range(9)]
            tau = stress(self, P, law, q, dt, C, p)
            volume = P.volume[q]
            mass = density * volume
            brought = mass * ti.cast(fresh, self.grid.nodes.dtype)
            momentum = [keep(brought * P.v[d][q]) for d in range(3)]
            if ti.static(self.features.body_acceleration):
                for d in ti.static(range(3)):
                    momentum[d] += dt * mass * P.acceleration[d][q]
                self.credit_acceleration(P, q, dt * mass, out)
            self.spread(P, q, momentum, brought, force * volume, C, tau, fresh, shift)

    @ti.func
    def credit_acceleration(self, P: ti.template(), q, factor, out: ti.template()):
        """The impulse, factor times body acceleration, of a pack: credited with gravity."""
        for l in ti.static(range(4)):
            x = ti.Vector([ti.cast(P.x[d][q][l], ti.f64) + self.origin[d] for d in range(3)])
            p = ti.cast(factor[l], ti.f64) * ti.Vector([ti.cast(P.acceleration[d][q][l], ti.f64) for d in range(3)])
            moment = x.cross(p)
            for d in ti.static(range(3)):
                add(out, GRAVITY_ROW, d, p[d])
                add(out, GRAVITY_ROW, 3 + d, moment[d])

    @ti.func
    def spread(self, P: ti.template(), q, p: ti.template(), mass, force, C: ti.template(), tau: ti.template(), fresh,
               shift):
        """Scatter a pack: momentum p (3), mass, and affine momentum Q = force tau + mass C, per cell."""
        Q = [keep((force * tau[FULL[i]] + mass * C[i]) * self.cell) for i in range(9)]
        base, f = first_nodes(self.grid, P.x, q, 1.0 / self.cell)
        px = p[0] - Q[0] * f[0] - Q[1] * f[1] - Q[2] * f[2]
        py = p[1] - Q[3] * f[0] - Q[4] * f[1] - Q[5] * f[2]
        pz = p[2] - Q[6] * f[0] - Q[7] * f[1] - Q[8] * f[2]
        wx, wy, wz = weights(f[0]), weights(f[1]), weights(f[2])
        zero = self.numbers.zero[None]
        for l in range(LANES):  # unrolled it is a fifth slower, and takes half as long again to compile
            node = [keep(base[0][l] + shift), keep(base[1][l]), keep(base[2][l])]
            if ti.static(len(self.features.shells) > 0):
                if P.side[q][l] != 0:
                    keep_for_cut(self.cuts, q, l, node, f, [px, py, pz], mass, Q, fresh)
                else:
                    scatter_lane(
                        self.target, node, ti.Vector([px[l], py[l], pz[l], mass[l]]),
                        ti.Vector([Q[0][l], Q[3][l], Q[6][l], zero]), ti.Vector([Q[1][l], Q[4][l], Q[7][l], zero]),
                        ti.Vector([Q[2][l], Q[5][l], Q[8][l], zero]), lane(wx, l), lane(wy, l), lane(wz, l))
            else:
                scatter_lane(
                    self.target, node, ti.Vector([px[l], py[l], pz[l], mass[l]]),
                    ti.Vector([Q[0][l], Q[3][l], Q[6][l], zero]), ti.Vector([Q[1][l], Q[4][l], Q[7][l], zero]),
                    ti.Vector([Q[2][l], Q[5][l], Q[8][l], zero]), lane(wx, l), lane(wy, l), lane(wz, l))

    @ti.func
    def to_particles(self, P: ti.template(), body: ti.template(), dt, next_stamp: ti.i32, first_pack, last_pack):
        """Velocity and affine velocity of a stretch of a body's packs; where dt > 0, its grains move for that time [s],
        and the blocks of the next substep are listed."""
        last = -1
        for q in range(first_pack, last_pack):
            v, B, f = self.gathered(P, q)
            gradient = 4.0 / self.cell
            for r in ti.static(range(3)):
                P.v[r][q] = v[r]
                for c in ti.static(range(3)):
                    P.C[3 * r + c][q] = gradient * (B[3 * r + c] - v[r] * f[c])
            if dt > 0:
                for r in ti.static(range(3)):
                    P.x[r][q] = self.moved(P.x[r][q] + dt * v[r], r)
                last = mark_pack(self.grid, P.x, q, 1.0 / self.cell, last, next_stamp)
        if ti.static(P.counts[body] % LANES > 0):  # noqa: SIM102  (decided when compiling)
            if first_pack < last_pack and last_pack == P.ranges[body][1]:
                self.still(P, last_pack - 1, ti.static(P.counts[body] % LANES))

    @ti.func
    def gathered(self, P: ti.template(), q):
        """Velocity (three packs) at pack q, its moments about the first node, per cell (nine), and offsets."""
        base, f = first_nodes(self.grid, P.x, q, 1.0 / self.cell)
        wx, wy, wz = weights(f[0]), weights(f[1]), weights(f[2])
        v = [keep(f[0] * 0.0) for _ in range(3)]
        B = [keep(f[0] * 0.0) for _ in range(9)]
        for l in range(LANES):  # as in `spread`
            value, moment_i, moment_j, moment_k = gather_lane(
                self.grid.nodes, [keep(base[d][l]) for d in range(3)], lane(wx, l), lane(wy, l), lane(wz, l))
            for r in ti.static(range(3)):
                v[r][l] = value[r]
                B[3 * r][l] = moment_i[r]
                B[3 * r + 1][l] = moment_j[r]
                B[3 * r + 2][l] = moment_k[r]
        return v, B, f

    @ti.func
    def still(self, P: ti.template(), q, filled: ti.template()):
        """Lanes without a grain rest: carried along, they would run into nodes without mass, and their strain away."""
        for l in ti.static(range(filled, LANES)):
            for d in ti.static(range(3)):
                P.v[d][q][l] = 0.0
            for i in ti.static(range(9)):
                P.C[i][q][l] = 0.0

    @ti.func
    def moved(self, x, axis: ti.template()):
        """A coordinate (or a pack of them) after a move: wrapped on a periodic axis, held by the walls on another."""
        low = self.corner
        high = self.corner + self.span[axis]
        result = x
        if ti.static(self.features.periodic[axis]):
            result = ti.select(x < low, x + self.span[axis], ti.select(x >= high, x - self.span[axis], x))
        else:  # holds a grain that an inaccurate step would carry through a wall
            result = ti.max(ti.min(x, high), low)
        return result

    @ti.func
    def take_momentum(self, P: ti.template(), body: ti.template(), corner, out: ti.template(), first_pack, last_pack):
        """Momentum of a stretch of a body's packs about the world's origin, affine part included."""
        density = self.numbers.densities[body]
        quarter = 0.25 * self.cell * self.cell
        total, turning = ti.Vector.zero(ti.f64, 3), ti.Vector.zero(ti.f64, 3)
        for q in range(first_pack, last_pack):
            spin = [keep(quarter * (P.C[7][q] - P.C[5][q])), keep(quarter * (P.C[2][q] - P.C[6][q])),
                    keep(quarter * (P.C[3][q] - P.C[1][q]))]
            for l in ti.static(range(4)):
                m = ti.cast(density * P.volume[q][l], ti.f64)
                x = ti.Vector([ti.cast(P.x[d][q][l], ti.f64) for d in range(3)]) + corner
                p = m * ti.Vector([ti.cast(P.v[d][q][l], ti.f64) for d in range(3)])
                total += p
                turning += x.cross(p) + m * ti.Vector([ti.cast(spin[d][l], ti.f64) for d in range(3)])
        for d in ti.static(range(3)):
            add(out, self.momentum, d, total[d])
            add(out, self.momentum, 3 + d, turning[d])

    @ti.func
    def take_status(self, out: ti.template(), first_pack, last_pack):
        """Sum of squared velocities (not finite if anything is not) and the largest speed of a stretch of packs."""
        total = ti.cast(0.0, ti.f64)
        fastest = ti.cast(0.0, ti.f64)
        for q in range(first_pack, last_pack):
            v2 = self.particles.v[0][q] ** 2 + self.particles.v[1][q] ** 2 + self.particles.v[2][q] ** 2
            total += ti.cast(v2.sum(), ti.f64)
            fastest = ti.max(fastest, ti.cast(v2.max(), ti.f64))
        add(out, self.status, 0, total)
        lift(out, self.status, 1, ti.sqrt(fastest))
