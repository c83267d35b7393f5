"""The adjoint kernel: many substeps in one launch, forwards with every state kept, or backwards over them."""

from mpm.adjoint.node_tape import NodeTape, ParticleAdjoints
from mpm.adjoint.stress_update import ForwardIntermediates
from mpm.adjoint.wall_ghosts import WallTape
from mpm.backend import real_type, ti
from mpm.materials.material import PARAMETERS
from mpm.rollout.phases import ReverseStep, reverse_phases
from mpm.state.active_blocks import mark_all
from mpm.state.fields import Fields
from mpm.state.packs import LANES
from mpm.state.particle_motion import drift_before, move_pack
from mpm.state.particles import ParticleFields
from mpm.stepping.cpu import add_status, run_phase, run_phases
from mpm.stepping.phases import Step, split_phases
from mpm.stepping.snapshots import StateBank
from mpm.stepping.stride import MAX_SUBSTEPS, kick_of, limit_stride, survey
from mpm.stepping.thread_group import ThreadGroup

POSITIONS, VELOCITIES, ALL = range(3)


class Moved:
    """Velocities and positions of the particles after a substep, before penetration is corrected."""

    def __init__(self, particles: ParticleFields, precision: str) -> None:
        real, n_packs = real_type(precision), particles.n_packs
        self.x = [ti.Vector.field(LANES, real, n_packs) for _ in range(3)]
        self.v = [ti.Vector.field(LANES, real, n_packs) for _ in range(3)]
        self.has_sides = particles.side is not None
        self.side = ti.Vector.field(LANES, real, n_packs) if self.has_sides else None
        """Sides of shells during the substep: a state has those of the substep before."""
        self.place_of_side = next(i for i, field in enumerate(particles.state_fields) if field is particles.side) \
            if self.has_sides else -1  # among the fields of a state


@ti.data_oriented
class AdjointKernel:
    """The kernel of one rollout.
    history: the states after every substep. depth: the most substeps of a stride. materials: whether adjoints of the
    laws' parameters are computed. limit: largest entry of an adjoint of the state, to which larger ones are clipped;
    None: not compiled. soft, svd: see `ForwardIntermediates`."""

    def __init__(self, fields: Fields, history: StateBank, *, depth: int, materials: bool,
                 limit: float | None, soft: float, svd: bool) -> None:
        self.fields, self.history = fields, history
        precision, n_packs = fields.features.precision, fields.particles.n_packs
        self.node_phases, self.particle_phases = split_phases(fields)
        self.reverse_phases = reverse_phases(fields)
        self.bars = ParticleAdjoints(fields.particles, precision)
        self.after = Moved(fields.particles, precision)
        self.intermediates = ForwardIntermediates(fields.laws, n_packs, precision, svd=svd, soft=soft)
        self.depth, self.halves = depth, int(fields.features.strides)
        """The most substeps of a stride; whether it begins with half a kick, one update of nodes more."""
        self.tape = WallTape(fields.grid, precision, depth + self.halves)
        self.nodes = NodeTape(fields.grid, precision, depth + self.halves)
        self.begin = ti.field(ti.i32, history.slots)  # first slot of the stride that a slot's substep belongs to
        self.parameter_bars = ti.field(ti.f64, (fields.parameters.densities.shape[0], PARAMETERS))
        """Adjoints of the parameters of each body's law."""
        self.products = ti.Vector.field(4, real_type(precision), 3)
        """Of one particle, by axis, on their way to sums; see `add_offset_bars`."""
        self.materials, self.clips, self.limit = materials, limit is not None, limit or 0.0
        self.state_bars = self.bars.packs.fields

    @ti.kernel
    def run(self, forward: ti.i32, first: ti.i32, substeps: ti.i32, interval: ti.i32, first_stamp: ti.i32, dt: float,
            motion: ti.types.ndarray(), loss_bar: ti.types.ndarray(), motion_bar: ti.types.ndarray(),
            norms: ti.types.ndarray(), mobile: ti.types.ndarray(), out: ti.types.ndarray()):
        """Run `substeps` of dt [s] from the state in slot `first` on and store every state; or reverse them.
        To reverse them, `bars` hold the adjoints of the state after them. motion (1, substeps, COLUMNS): of the tool.
        loss_bar (k, 6, packs, LANES): what the loss adds to the adjoints of positions and velocities in slot interval,
        2 interval ... Written: motion_bar (substeps, COLUMNS); norms (k, 3) of the adjoints of positions, velocities
        and all in slot 0, interval, 2 interval ...; out: status in its last row."""
        ti.loop_config(serialize=True)
        for _ in range(1):
            done = 0
            while done < substeps:
                begin, span = done, 1
                if forward > 0:
                    if done == 0:
                        self.history.restore(first)
                    if ti.static(self.depth > 1):
                        most = ti.min(self.depth, interval - done % interval)
                        most = ti.min(most, MAX_SUBSTEPS - done % interval % MAX_SUBSTEPS)  # as launches are split
                        found = survey(self.fields, self.fields.particles, 0, self.fields.particles.pack_count[None])
                        span = ti.max(limit_stride(self.fields, motion, done, mobile, dt, most, found), 1)
                else:
                    begin = self.begin[first + substeps - done - 1] - first
                    span = substeps - done - begin
                for k in range(span + self.halves):
                    if forward == 0:
                        self.restore_before(first + begin, k)
                    if k == 0:
                        self.drift(0.5 * dt * span)
                    row, kick, strain, moved = self.plan(begin, k, span, dt)
                    stamp = first_stamp + 2 * done
                    step = ti.static(Step(row, stamp, dt, kick, strain, ti.cast(k == 0, ti.i32), moved, span * dt,
                                          motion, mobile, out, tape=self.tape))
                    self.update_nodes(step, k, forward)
                    if forward == 0:
                        self.nodes.record(self.fields.grid, self.nodes.velocities, k)
                    if forward > 0 or k < self.halves:
                        run_phases(self.fields, self.particle_phases, ti.static(ThreadGroup()), step)
                        self.history.store(self.slot_after(first + begin, k))
                    if forward > 0 and k >= self.halves:
                        self.begin[first + begin + k - self.halves] = first + begin
                if forward == 0:
                    self.reverse_stride(first, begin, span, interval, dt, motion, loss_bar, motion_bar, norms)
                done += span
            if forward > 0:
                add_status(self.fields, self.fields.particles, out, 0, self.fields.particles.pack_count[None])

    @ti.func
    def plan(self, begin: ti.i32, k: ti.i32, span: ti.i32, dt):
        """Return the row of the motion table, kick [s], strain [s] and span of the k-th update of nodes in a stride."""
        row, kick, strain, moved = begin + k, dt, dt, 1
        if ti.static(self.halves > 0):
            row, moved = begin + ti.max(k - 1, 0), span * (k == span)
            kick, strain = kick_of(dt, ti.min(k, 1), span - k), dt * ti.min(k, 1)
        return row, kick, strain, moved

    @ti.func
    def slot_after(self, begin: ti.i32, k: ti.i32):
        """Return the slot of the state after the k-th update of nodes in the stride that begins with slot `begin`."""
        slot = begin + k + 1 - self.halves
        if ti.static(self.halves > 0):
            slot = ti.select(k == 0, self.history.slots - 1, slot)  # what half a kick leads to is kept aside
        return slot

    @ti.func
    def restore_before(self, begin: ti.i32, k: ti.i32):
        """Restore the state before the k-th update of nodes in a stride."""
        slot = begin
        if k > 0:
            slot = self.slot_after(begin, k - 1)
        self.history.restore(slot)

    @ti.func
    def update_nodes(self, step: ti.template(), k: ti.i32, forward: ti.i32):
        """Run the phases of the k-th substep of a stride that change nodes; record what their adjoints need."""
        if k == 0:
            mark_all(self.fields.grid, self.fields.particles, 1.0 / self.fields.cell, step.stamp)
        self.tape.at[None] = k
        for phase in ti.static(self.node_phases):
            if ti.static(phase.name == "update nodes"):  # noqa: SIM102  (decided when compiling)
                if forward == 0:
                    self.nodes.record(self.fields.grid, self.nodes.folded, k)
            run_phase(self.fields, phase, ti.static(ThreadGroup()), step)

    @ti.func
    def reverse_stride(self, first: ti.i32, begin: ti.i32, span: ti.i32, interval: ti.i32, dt, motion: ti.template(),
                       loss_bar: ti.template(), motion_bar: ti.template(), norms: ti.template()):
        """Reverse the substeps begin .. begin + span - 1, which have just been repeated."""
        for reverse in range(span + self.halves):
            k = span + self.halves - 1 - reverse
            if reverse > 0:
                self.restore_before(first + begin, k)
                if k == 0:
                    self.drift(0.5 * dt * span)
                self.nodes.restore(self.fields.grid, k)
            else:
                self.nodes.clear_bars(self.fields.grid)
                if (first + begin + span) % interval == 0:
                    self.add_loss(loss_bar, (first + begin + span) // interval - 1)
            row, kick, strain, moved = self.plan(begin, k, span, dt)
            slot = first + begin
            if k > 0:
                slot = self.slot_after(first + begin, k - 1)
            self.read_moved(self.slot_after(first + begin, k))
            for adjoint in ti.static(self.reverse_phases):
                adjoint(self, ti.static(ReverseStep(row, begin, k, moved, slot, dt, kick, strain, span * dt,
                                                    ti.cast(k == 0, ti.i32), motion, motion_bar)))
            if ti.static(self.clips):
                self.clip()
            if k == 0:
                self.restore_before(first + begin, 0)
                self.drift_back(0.5 * dt * span)
                if (first + begin) % interval == 0:
                    self.measure(norms, (first + begin) // interval)

    @ti.func
    def drift(self, dt):
        """Move all particles for dt [s], before their blocks are listed."""
        if ti.static(self.halves > 0):
            for q in range(self.fields.particles.pack_count[None]):
                time = drift_before(self.fields, self.fields.particles, q, dt)
                for d in ti.static(range(3)):
                    if dt > 0:
                        move_pack(self.fields, self.fields.particles, q, d, time * self.fields.particles.v[d][q])

    @ti.func
    def drift_back(self, dt):
        """Adjoint of `drift`; the particles hold the positions before it. None that drifts reaches a wall."""
        if ti.static(self.halves > 0):
            for q in range(self.fields.particles.pack_count[None]):
                time = drift_before(self.fields, self.fields.particles, q, dt)
                for d in ti.static(range(3)):
                    self.bars.v[d][q] = self.bars.v[d][q] + time * self.bars.x[d][q]

    @ti.func
    def clip(self):
        """Clip the adjoints of the state to the limit; written so that NaN propagates."""
        for field in ti.static(self.state_bars):
            for q in range(self.fields.particles.pack_count[None]):
                over, under = field[q] > self.limit, field[q] < -self.limit
                field[q] = ti.select(over, self.limit, ti.select(under, -self.limit, field[q]))

    @ti.func
    def read_moved(self, slot):
        """Read positions and velocities of a slot's state, and the sides that its particles had."""
        if ti.static(self.after.has_sides):
            for q in range(self.fields.particles.pack_count[None]):
                self.after.side[q] = self.history.states[slot, ti.static(self.after.place_of_side), q]
        for d in ti.static(range(3)):
            for q in range(self.fields.particles.pack_count[None]):
                self.after.x[d][q] = self.history.states[slot, d, q]
                self.after.v[d][q] = self.history.states[slot, 3 + d, q]

    @ti.func
    def add_loss(self, loss_bar: ti.template(), k):
        """Add the loss's adjoints of positions and velocities at a reading."""
        for q in range(self.fields.particles.pack_count[None]):
            for l in ti.static(range(LANES)):
                for d in ti.static(range(3)):
                    self.bars.x[d][q][l] = self.bars.x[d][q][l] + loss_bar[k, d, q, l]
                    self.bars.v[d][q][l] = self.bars.v[d][q][l] + loss_bar[k, 3 + d, q, l]

    @ti.func
    def measure(self, norms: ti.template(), s):
        """Store the norms of the adjoints of positions, velocities and all; not finite if any entry is not."""
        for which, fields in ti.static(((POSITIONS, self.bars.x), (VELOCITIES, self.bars.v), (ALL, self.state_bars))):
            total = ti.cast(0.0, ti.f64)
            for q in range(self.fields.particles.pack_count[None]):
                for field in ti.static(fields):
                    wide = ti.cast(field[q], ti.f64)  # squares leave single precision before their roots do
                    total += wide.dot(wide)
            norms[s, which] = ti.sqrt(total)

    @ti.kernel
    def read(self, interval: ti.i32, out: ti.types.ndarray()):
        """Read positions and velocities in slots interval, 2 interval ... into out (k, 6, packs, LANES)."""
        ti.loop_config(serialize=True)
        for k in range(out.shape[0]):
            for i in range(6):
                for q in range(self.fields.particles.pack_count[None]):
                    for l in ti.static(range(LANES)):
                        out[k, i, q, l] = self.history.states[(k + 1) * interval, i, q][l]
