"""The stepper of a CPU: all substeps of a launch in one kernel, touching only blocks with material.

With several threads each has a part of the packs and scatters to an array of its own; these are added in their order,
so that particles are the same to the bit in every run, with no atomic addition to a node. Each also has its own copy of
the ledger.
"""

import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from mpm.backend import once, ti
from mpm.backend.launching import Launcher
from mpm.boundaries.coulomb import collider_axes, collider_origin
from mpm.observers.counter_kernel import COUNTER_ROWS, CounterKernel
from mpm.observers.sample import SampleKernel
from mpm.state.active_blocks import mark_all
from mpm.state.fields import Fields
from mpm.state.ledger import Stripe, add, add_stripes, maximise
from mpm.state.packs import LANES, count_packs, pack_at, packs_of_body
from mpm.state.particle_motion import drift_before, drift_packs, mark_active_lanes
from mpm.state.particles import AT_WALL
from mpm.state.sleepers import CHECK_INTERVAL, adopt_rest
from mpm.stepping.phases import Step, phases_of
from mpm.stepping.sleep_check import check_sleep
from mpm.stepping.snapshots import StateBank
from mpm.stepping.stride import fastest_square, limit_stride
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

NOWHERE, CHECKPOINT, UNDO = range(3)
"""Where a launch first copies the state to."""
OUT = 5
"""Place of the output among the arguments of `CpuStepper.run`."""
RETRY_AFTER = 1.0
"""Seconds after which a thread that was left alone tries again whether the others have cores."""


@ti.data_oriented
class CpuStepper:
    """The kernels that advance one scene on a CPU.

    counter: the kernel of a `RegionCounter` that takes readings within launches, or None. sample: that of a `Sample`
    taken at the end of a launch, or None. checkpoint, undo: where a launch first copies the state to when
    `run` asks for it, or none.
    """

    def __init__(self, fields: Fields, counter: CounterKernel | None = None, sample: SampleKernel | None = None,
                 checkpoint: Sequence[StateBank] = (), undo: Sequence[StateBank] = ()) -> None:
        self.fields, self.counter, self.sample = fields, counter, sample
        self.checkpoint, self.undo = list(checkpoint), list(undo)
        self.phases = phases_of(fields)
        self.threads = max(fields.parts, 1)
        self.numbers, self._retry_at = np.zeros(3, np.int64), 0.0
        """Of the group, see there; and when a thread that was left alone tries again with the others [s]."""
        self._stripes = np.zeros((0, 6))
        """What each thread adds to the ledger."""
        self.fastest = ti.field(fields.real, self.threads)
        """Largest squared speed [m^2/s^2] that each thread has found."""
        self.has_counter, self.has_sample = counter is not None, sample is not None
        self.counter_row = fields.features.moving_colliders.index(counter.index) if self.has_counter else -1
        """Row of the counter's collider in the motion table."""
        self._run: Callable[..., None] = Launcher(self, CpuStepper.run)

    def launch(self, *arguments: Any) -> None:
        """Call `run`, with the group's numbers."""
        if self.threads == 1:
            self._run(*arguments, self.numbers)
            return
        out, tries = arguments[OUT], time.monotonic() >= self._retry_at
        if tries:
            self.numbers[ALONE] = 0
        if self._stripes.shape != (self.threads * len(out), 6):
            self._stripes = np.zeros((self.threads * len(out), 6))
        self._stripes[:] = 0.0
        self._run(*arguments[:OUT], self._stripes, *arguments[OUT + 1 :], self.numbers)
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
    def run(self, substeps: ti.i32, first_stamp: ti.i32, dt: float, motion: ti.types.ndarray(),
            mobile: ti.types.ndarray(), out: ti.types.ndarray(), first: ti.i32, interval: ti.i32,
            per_particle: ti.types.ndarray(), sampled: ti.types.ndarray(), set_aside: ti.i32, max_stride: ti.i32,
            numbers: ti.types.ndarray()):
        """Advance by `substeps` of dt [s].

        motion: (k, substeps, COLUMNS) of the moving colliders. mobile: table of the mobile colliders, read and written.
        Written: out, ledger, status and the counter's readings; per_particle, the counter's numbers of particles;
        sampled, the sample after the last substep. The counter reads after every `interval` substeps, `first` of which
        lie in earlier launches of the advance. set_aside: where the state is first copied to: NOWHERE, CHECKPOINT or
        UNDO. max_stride: the most substeps between two transfers. numbers: of the group.
        """
        if ti.static(self.threads == 1):
            ti.loop_config(serialize=True)
            for _ in range(1):
                self.run_with(ti.static(ThreadGroup()), substeps, first_stamp, dt, motion, mobile, out, first, interval,
                              per_particle, sampled, set_aside, max_stride)
        else:
            for turn in range(ti.static(self.threads * TURNS)):
                if turn % TURNS == 0:
                    alone = ti.cast(numbers[ALONE], ti.i32)
                    group = ti.static(ThreadGroup(turn // TURNS, self.threads, numbers, alone))
                    if turn == 0 or alone == 0:
                        stripe = ti.static(Stripe(out, turn // TURNS * (out.shape[0] // self.threads)))
                        self.run_with(group, substeps, first_stamp, dt, motion, mobile, stripe, first, interval,
                                      per_particle, sampled, set_aside, max_stride)

    @ti.func
    def run_with(self, group: ti.template(), substeps: ti.i32, first_stamp: ti.i32, dt, motion: ti.template(),
                 mobile: ti.template(), out: ti.template(), first: ti.i32, interval: ti.i32,
                 per_particle: ti.template(), sampled: ti.template(), set_aside: ti.i32, max_stride: ti.i32):
        """Advance, as one thread of a group, see `run`."""
        if group.thread == 0:
            for kind, banks in ti.static(enumerate((self.checkpoint, self.undo))):
                if set_aside == kind + 1:
                    for bank in ti.static(banks):
                        bank.store(0)
        alone = self.advance(group, substeps, first_stamp, dt, motion, 0, mobile, out, first, interval, per_particle, 0,
                             max_stride)
        if group.thread == 0 or alone == 0:
            for part in range(group.thread, last_part(ti.static(group._replace(alone=alone)))):
                begin, end = part_of(count_packs(self.fields), part, group)
                self.sum_momentum(out, begin, end)
                add_status(self.fields, self.fields.particles, out, begin, end)
        if ti.static(self.has_sample):  # noqa: SIM102  (decided when compiling)
            if group.thread == 0:
                self.sample.take(sampled, 0)

    @ti.func
    def advance(self, group: ti.template(), substeps: ti.i32, first_stamp: ti.i32, dt, motion: ti.template(),
                first_row: ti.i32, mobile: ti.template(), out: ti.template(), first: ti.i32, interval: ti.i32,
                per_particle: ti.template(), earlier: ti.i32, max_stride: ti.i32):
        """Advance by `substeps`, with rows of the motion from first_row on, in strides of at most `max_stride`.

        `earlier` readings of others stand before those of this advance in per_particle; else see `run`. Where particles
        get too fast the launch ends, and the number of substeps until then stands in the output's status row. All
        threads of a group take the same turns: what they decide by changes only where all synchronize afterwards.
        Returns whether the first one is left alone.
        """
        left, stamp, span, alone = 0, first_stamp, 1, group.alone
        present = ti.static(group._replace(alone=alone))
        if group.thread == 0:
            self.fields.particles.halted[None] = 0
        synchronize(present)
        last_check, next_check = 0, 0
        for s in range(substeps + ti.static(int(self.fields.features.sleep))):
            starts = left == 0
            if ti.static(self.fields.features.sleep):
                if starts and substeps > 0 and (s >= next_check or s == substeps):
                    next_check = s + ti.max(ti.cast(self.fields.sleepers.limits[CHECK_INTERVAL] / dt, ti.i32), 1)
                    if group.thread == 0:
                        check_sleep(self.fields, motion, first_row + s, ti.min(next_check + max_stride, substeps) - s,
                                     mobile, dt, dt * (s - last_check), first_stamp + s, out)
                    synchronize(present)
                    last_check = s
                if s == substeps:
                    break
            if starts:
                stamp, span = first_stamp + s, 1
                if ti.static(self.fields.features.strides):
                    most = ti.min(ti.min(max_stride, substeps - s), interval - (first + s) % interval)
                    span = self.plan_stride(present, motion, first_row + s, mobile, dt, most)
                    if span > 1:
                        for part in range(group.thread, last_part(present)):
                            begin, end = part_of(count_packs(self.fields), part, group)
                            drift_packs(self.fields, self.fields.particles, drift_before(dt, span), stamp, begin, end)
                        synchronize(present)
                left = span
            left -= 1
            row, transfer_mass, moved = first_row + s, ti.cast(starts, ti.i32), span * (left == 0)
            run_phases(self.fields, self.phases, present,
                       ti.static(Step(row, stamp, dt, transfer_mass, moved, motion, mobile, out)))
            if self.fields.particles.halted[None] > 0:
                if group.thread == 0:
                    add(out, self.fields.rows.status, 2, ti.cast(s + 1, ti.f64))
                break
            if ti.static(self.has_counter):  # noqa: SIM102  (decided when compiling)
                if group.thread == 0:
                    self.take_reading(motion, row, first + s + 1, interval, out, per_particle, earlier)
            alone = is_left_alone(present)
            if alone > 0 and group.thread != 0:
                break
        return alone

    @ti.func
    def plan_stride(self, group: ti.template(), motion: ti.template(), row, mobile: ti.template(), dt, most: ti.i32):
        """Return the substeps of the stride that begins with a row of the motion table, see `limit_stride`."""
        for part in range(group.thread, last_part(group)):
            begin, end = part_of(count_packs(self.fields), part, group)
            self.fastest[part] = fastest_square(self.fields, self.fields.particles, begin, end)
        synchronize(group)
        fastest = self.fastest[0]
        for part in ti.static(range(1, group.threads)):
            fastest = ti.max(fastest, self.fastest[part])
        return limit_stride(self.fields, motion, row, mobile, dt, most, fastest)

    @ti.func
    def take_reading(self, motion: ti.template(), row: ti.i32, done: ti.i32, interval: ti.i32, out: ti.template(),
                     per_particle: ti.template(), earlier: ti.i32):
        """Let the counter read after every `interval` substeps, `done` of which are over."""
        if done % interval == 0:
            k = ti.static(self.counter_row)
            reading = done // interval - 1
            self.counter.accumulate(ti.cast(collider_origin(motion, k, row), ti.f64),
                                    ti.cast(collider_axes(motion, k, row), ti.f64), out,
                                    self.fields.rows.count + ti.static(COUNTER_ROWS) * reading, per_particle,
                                    earlier + reading)

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

    Particles that walls hold are counted.
    """
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

    Walls towards which gravity pulls are floors: what lies or is pressed on them leaves nothing.
    """
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
