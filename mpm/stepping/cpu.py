"""The stepper of a CPU: all substeps of a launch in one kernel, touching only blocks with material.
With several threads each has a part of the packs and scatters to an array of its own; these are added in their order,
so that particles are the same to the bit in every run, with no atomic addition to a node. Each also has its own copy of
the ledger."""

import time
from collections.abc import Callable, Sequence

import numpy as np

from mpm.backend import once, ti
from mpm.backend.launching import Launcher
from mpm.boundaries.coulomb import collider_axes, collider_origin
from mpm.observers.counter_kernel import COUNTER_ROWS, CounterKernel
from mpm.observers.reading_kernels import SampleKernel
from mpm.state.active_blocks import mark_all
from mpm.state.fields import Fields
from mpm.state.ledger import Stripe, add, add_stripes, maximise
from mpm.state.packs import LANES, count_packs, pack_at, packs_of_body
from mpm.state.particle_motion import drift_packs, mark_active_lanes
from mpm.state.particles import AT_WALL
from mpm.state.sleepers import CHECK_INTERVAL, adopt_rest
from mpm.stepping.phases import Launch, Step, phases_of
from mpm.stepping.sleep_check import check_sleep
from mpm.stepping.snapshots import StateBank
from mpm.stepping.stride import kick_of, limit_stride, survey
from mpm.stepping.thread_group import (
    ALONE,
    TURNS,
    ThreadGroup,
    count_of,
    is_left_alone,
    last_part,
    part_of,
    synchronize,
)

ARGUMENTS = len(Launch._fields) - len(Launch._field_defaults)
"""Arguments of `CpuStepper.run`, without the numbers of the thread group."""
NOWHERE, CHECKPOINT, UNDO = range(3)  # where a launch first copies the state to
RETRY_AFTER = 1.0
"""Seconds after which a thread that was left alone tries again whether the others have cores."""


@ti.data_oriented
class CpuStepper:
    """The kernels that advance one scene on a CPU.
    counter: the kernel of a `RegionCounter` that takes readings within launches, or None. sample: that of a `Sample`
    taken at the end of a launch, or None. checkpoint, undo: where a launch first copies the state to when `run` asks
    for it, or none."""

    def __init__(self, fields: Fields, counter: CounterKernel | None = None, sample: SampleKernel | None = None,
                 checkpoint: Sequence[StateBank] = (), undo: Sequence[StateBank] = ()) -> None:
        self.fields, self.counter, self.sample = fields, counter, sample
        self.checkpoint, self.undo = list(checkpoint), list(undo)
        self.phases = phases_of(fields)
        self.threads = max(fields.parts, 1)
        self.numbers, self._retry_at = np.zeros(3, np.int64), 0.0
        """Of the group, see there; and when a thread that was left alone tries again with the others [s]."""
        self._stripes = np.zeros((0, 6))  # what each thread adds to the ledger
        self.surveys = ti.Vector.field(2, fields.real, self.threads)  # what each thread has found, see `survey`
        self.has_counter, self.has_sample = counter is not None, sample is not None
        self.counter_row = fields.features.moving_colliders.index(counter.index) if self.has_counter else -1
        """Row of the counter's collider in the motion table."""
        self._run: Callable[..., None] = Launcher(self, CpuStepper.run)

    def launch(self, launch: Launch) -> None:
        """Advance by the substeps of a launch."""
        if self.threads == 1:
            self._run(*launch[:ARGUMENTS], self.numbers)
            return
        out, tries = launch.out, time.monotonic() >= self._retry_at
        if tries:
            self.numbers[ALONE] = 0
        if self._stripes.shape != (self.threads * len(out), 6):
            self._stripes = np.zeros((self.threads * len(out), 6))
        self._stripes[:] = 0.0
        self._run(*launch._replace(out=self._stripes)[:ARGUMENTS], self.numbers)
        add_stripes(out, self._stripes, self.fields.rows.status)
        if tries and self.numbers[ALONE]:
            self._retry_at = time.monotonic() + RETRY_AFTER

    @ti.kernel
    def mark(self, stamp: ti.i32):
        """List the active blocks of the first substep; those of later ones are listed at the end of the one before."""
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.list_blocks(stamp)

    @ti.func
    def list_blocks(self, stamp: ti.i32):
        """List the blocks that all particles reach, of a state that may be another than the last substep left."""
        if ti.static(self.fields.features.sleep):
            adopt_rest(self.fields, self.fields.particles)
            self.fields.grid.count[None] = 0
            key = -1
            for place in range(count_packs(self.fields)):
                key = mark_active_lanes(self.fields, self.fields.particles, pack_at(self.fields, place), key, stamp)
        else:
            mark_all(self.fields.grid, self.fields.particles, 1.0 / self.fields.cell, stamp)

    @ti.kernel
    def run(self, substeps: ti.i32, stamp: ti.i32, dt: float, motion: ti.types.ndarray(), mobile: ti.types.ndarray(),
            out: ti.types.ndarray(), done: ti.i32, interval: ti.i32, per_particle: ti.types.ndarray(),
            sampled: ti.types.ndarray(), copy_to: ti.i32, max_stride: ti.i32, numbers: ti.types.ndarray()):
        """Advance by the substeps of a launch, see `Launch`. numbers: of the thread group."""
        if ti.static(self.threads == 1):
            ti.loop_config(serialize=True)
            for _ in range(1):
                self.run_thread(ti.static(ThreadGroup()), ti.static(
                    Launch(substeps, stamp, dt, motion, mobile, out, done, interval, per_particle, sampled, copy_to,
                           max_stride)))
        else:
            for turn in range(ti.static(self.threads * TURNS)):
                if turn % TURNS == 0:
                    alone = ti.cast(numbers[ALONE], ti.i32)
                    group = ti.static(ThreadGroup(turn // TURNS, self.threads, numbers, alone))
                    if turn == 0 or alone == 0:
                        stripe = ti.static(Stripe(out, turn // TURNS * (out.shape[0] // self.threads)))
                        self.run_thread(group, ti.static(Launch(substeps, stamp, dt, motion, mobile, stripe, done,
                                                                interval, per_particle, sampled, copy_to, max_stride)))

    @ti.func
    def run_thread(self, group: ti.template(), launch: ti.template()):
        """Advance as one thread of a group."""
        # as local variables: arguments of a kernel would be loaded from memory wherever they are used
        substeps, stamp, dt, done = launch.substeps, launch.stamp, launch.dt, launch.done
        interval, max_stride, first_row = launch.interval, launch.max_stride, 0
        local = ti.static(launch._replace(substeps=substeps, stamp=stamp, dt=dt, done=done, interval=interval,
                                          max_stride=max_stride, first_row=first_row))
        if group.thread == 0:
            for kind, banks in ti.static(enumerate((self.checkpoint, self.undo))):
                if launch.copy_to == kind + 1:
                    for bank in ti.static(banks):
                        bank.store(0)
        alone = self.advance(group, local)
        if group.thread == 0 or alone == 0:
            for part in range(group.thread, last_part(ti.static(group._replace(alone=alone)))):
                begin, end = part_of(count_packs(self.fields), part, group)
                self.sum_momentum(launch.out, begin, end)
                add_status(self.fields, self.fields.particles, launch.out, begin, end)
        if ti.static(self.has_sample):  # noqa: SIM102  (decided when compiling)
            if group.thread == 0:
                self.sample.take(launch.sampled, 0)

    @ti.func
    def advance(self, group: ti.template(), launch: ti.template()):
        """Advance in strides of at most `launch.max_stride` substeps.
        Where particles get too fast the launch ends, and the number of substeps until then stands in the output's
        status row. All threads of a group run the same loop: the values by which they branch change only before a
        barrier. Returns whether the first thread is left alone."""
        left, stamp, span, alone = 0, launch.stamp, 1, group.alone
        present = ti.static(group._replace(alone=alone))
        if group.thread == 0:
            self.fields.particles.halted[None] = 0
        synchronize(present)
        last_check, next_check = 0, 0
        for s in range(launch.substeps + ti.static(int(self.fields.features.sleep))):
            starts = left == 0
            if ti.static(self.fields.features.sleep):
                if starts and launch.substeps > 0 and (s >= next_check or s == launch.substeps):
                    interval = ti.cast(self.fields.sleepers.limits[CHECK_INTERVAL] / launch.dt, ti.i32)
                    next_check = s + ti.max(interval, 1)
                    if group.thread == 0:
                        check_sleep(self.fields, launch, s, ti.min(next_check + launch.max_stride, launch.substeps) - s,
                                    launch.dt * (s - last_check))
                    synchronize(present)
                    last_check = s
                if s == launch.substeps:
                    break
            if starts:
                stamp, span = launch.stamp + s, 1
                if ti.static(self.fields.features.strides):
                    most = ti.min(ti.min(launch.max_stride, launch.substeps - s),
                                  launch.interval - (launch.done + s) % launch.interval)
                    span = self.plan_stride(present, launch, s, most)
                    for part in range(group.thread, last_part(present)):
                        begin, end = part_of(count_packs(self.fields), part, group)
                        drift_packs(self.fields, self.fields.particles, 0.5 * launch.dt * span, stamp, begin, end)
                    synchronize(present)
                    span = ti.max(span, 1)
                left = span
            left -= 1
            row = launch.first_row + s
            if ti.static(self.fields.features.strides):
                for is_strained in range(1 - ti.cast(starts, ti.i32), 2):  # a stride begins with half a kick
                    kick = kick_of(launch.dt, is_strained, left)
                    run_phases(self.fields, self.phases, present, ti.static(Step(
                        row, stamp, launch.dt, kick, is_strained * launch.dt, 1 - is_strained,
                        is_strained * span * (left == 0), span * launch.dt, launch.motion, launch.mobile,
                        launch.out)))
            else:
                run_phases(self.fields, self.phases, present, ti.static(Step(
                    row, stamp, launch.dt, launch.dt, launch.dt, 1, 1, launch.dt, launch.motion, launch.mobile,
                    launch.out)))
            if self.fields.particles.halted[None] > 0:
                if group.thread == 0:
                    add(launch.out, self.fields.rows.status, 2, ti.cast(s + 1, ti.f64))
                break
            if ti.static(self.has_counter):  # noqa: SIM102  (decided when compiling)
                if group.thread == 0:
                    self.take_reading(launch, row, launch.done + s + 1)
            alone = is_left_alone(present)
            if alone > 0 and group.thread != 0:
                break
        return alone

    @ti.func
    def plan_stride(self, group: ti.template(), launch: ti.template(), s, most: ti.i32):
        """Return the substeps of the stride that begins with substep s of a launch, see `limit_stride`."""
        for part in range(group.thread, last_part(group)):
            begin, end = part_of(count_packs(self.fields), part, group)
            self.surveys[part] = survey(self.fields, self.fields.particles, begin, end)
        synchronize(group)
        found = self.surveys[0]
        for part in ti.static(range(1, group.threads)):
            found = ti.Vector([ti.max(found[0], self.surveys[part][0]), found[1] + self.surveys[part][1]])
        return limit_stride(self.fields, launch.motion, launch.first_row + s, launch.mobile, launch.dt, most, found)

    @ti.func
    def take_reading(self, launch: ti.template(), row: ti.i32, done: ti.i32):
        """Take a reading of the counter after every `launch.interval` substeps, `done` of which are over."""
        if done % launch.interval == 0:
            k = ti.static(self.counter_row)
            reading = done // launch.interval - 1
            self.counter.accumulate(ti.cast(collider_origin(launch.motion, k, row), ti.f64),
                                    ti.cast(collider_axes(launch.motion, k, row), ti.f64), launch.out,
                                    self.fields.rows.count + ti.static(COUNTER_ROWS) * reading, launch.per_particle,
                                    launch.earlier + reading)

    @ti.func
    def sum_momentum(self, out: ti.template(), first, last):
        """Add the momentum of packs first .. last - 1 about the world's origin, affine part included."""
        for body in range(self.fields.parameters.densities.shape[0]):
            begin, end = packs_of_body(self.fields, body, first, last)
            self.sum_body_momentum(self.fields.particles, self.fields.parameters.densities[body], out, begin, end)

    @ti.func
    def sum_body_momentum(self, P: ti.template(), density, out: ti.template(), first, last):
        """Add the momentum of packs of one density [kg/m^3]."""
        quarter, origin = 0.25 * self.fields.cell * self.fields.cell, self.fields.world_origin()
        total, turning = ti.Vector.zero(ti.f64, 3), ti.Vector.zero(ti.f64, 3)
        for place in range(first, last):
            q = pack_at(self.fields, place)
            spin = [once(quarter * (P.C[7][q] - P.C[5][q])), once(quarter * (P.C[2][q] - P.C[6][q])),
                    once(quarter * (P.C[3][q] - P.C[1][q]))]
            for l in ti.static(range(LANES)):
                m = ti.cast(density * P.volume[q][l], ti.f64)
                x = ti.Vector([ti.cast(P.x[d][q][l], ti.f64) for d in range(3)]) + origin
                p = m * ti.Vector([ti.cast(P.v[d][q][l], ti.f64) for d in range(3)])
                total += p
                turning += x.cross(p) + m * ti.Vector([ti.cast(spin[d][l], ti.f64) for d in range(3)])
        for d in ti.static(range(3)):
            add(out, self.fields.rows.momentum, d, total[d])
            add(out, self.fields.rows.momentum, 3 + d, turning[d])


@ti.func
def add_status(fields: ti.template(), P: ti.template(), out: ti.template(), first, last):
    """Add the squared velocities of packs, not finite if anything is not; find the largest speed [m/s].
    Particles that walls hold are counted."""
    total = ti.cast(0.0, ti.f64)
    fastest = ti.cast(0.0, ti.f64)
    held = 0
    for place in range(first, last):
        q = pack_at(fields, place)
        v2 = P.v[0][q] ** 2 + P.v[1][q] ** 2 + P.v[2][q] ** 2
        total += ti.cast(v2.sum(), ti.f64)
        fastest = ti.max(fastest, ti.cast(v2.max(), ti.f64))
        held += count_held_lanes(fields, P, q)
    add(out, fields.rows.status, 0, total)
    maximise(out, fields.rows.status, 1, ti.sqrt(fastest))
    add(out, fields.rows.status, 3, ti.cast(held, ti.f64))


@ti.func
def count_held_lanes(fields: ti.template(), P: ti.template(), q):
    """Return how many particles of pack q lie on the plane of a wall: `keep_inside` puts there what would have left.
    Walls towards which gravity pulls are floors: what lies or is pressed on them leaves nothing."""
    outward = 0.0 * P.x[0][q] - fields.cell
    gravity = fields.parameters.gravity[None]
    for d in ti.static(range(3)):
        if ti.static(not fields.features.periodic[d]):
            if gravity[d] >= 0.0:
                outward = ti.max(outward, fields.corner - P.x[d][q])
            if gravity[d] <= 0.0:
                outward = ti.max(outward, P.x[d][q] - (fields.corner + fields.span[d]))
    return (ti.select(outward >= -AT_WALL * fields.cell, 1, 0) * ti.select(P.volume[q] > 0.0, 1, 0)).sum()


@ti.func
def run_phases(fields: ti.template(), phases: ti.template(), group: ti.template(), step: ti.template()):
    """Run phases one after the other, each over its whole domain, or over what this thread has of it."""
    for phase in ti.static(phases):
        run_phase(fields, phase, group, step)


@ti.func
def run_phase(fields: ti.template(), phase: ti.template(), group: ti.template(), step: ti.template()):
    """Run one phase; where there are several threads, all are done with it afterwards."""
    count = count_of(fields, phase.over)
    if ti.static(phase.over == "walls"):
        for w in range(6):
            for part in range(group.thread, last_part(group)):
                begin, end = part_of(count, part, group)
                phase.run(fields, step, w, begin, end)
            synchronize(group)
    elif ti.static(group.threads > 1 and phase.over in ("packs", "blocks", "listed")):
        for part in range(group.thread, last_part(group)):
            begin, end = part_of(count, part, group)
            phase.run(fields, ti.static(step._replace(part=part)), begin, end)
        synchronize(group)
    else:
        if group.thread == 0:
            phase.run(fields, step, 0, count)
        synchronize(group)
