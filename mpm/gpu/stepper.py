"""The stepper of a GPU: two launches a substep, in which every phase is a parallel loop.
Each pack of particles, each node of an active block is a thread's. All add to the same nodes, and to one of several
copies of the ledger, in any order: right to rounding."""

from collections.abc import Sequence

import numpy as np

from mpm.backend import is_shared, ti
from mpm.boundaries.coulomb import collider_axes, collider_origin
from mpm.gpu.phase_loops import GROUP, PhaseLoops, ledger_of
from mpm.observers.counter_kernel import COUNTER_ROWS, CounterKernel
from mpm.observers.reading_kernels import SampleKernel
from mpm.state.fields import Fields
from mpm.state.ledger import STRIPES, add_stripes
from mpm.state.packs import LANES
from mpm.state.particle_motion import drift_packs
from mpm.stepping.cpu import CpuStepper, add_status
from mpm.stepping.phases import Launch, split_phases
from mpm.stepping.snapshots import StateBank
from mpm.stepping.stride import limit_stride, survey

SUM_PARTS = 4096  # parts of the packs where something is summed over them


class DeviceArray:
    """A host array, and during a launch its copy on the device; or several, into which a ledger is summed: `Stripe`."""

    def __init__(self, array: np.ndarray, copies: int = 1) -> None:
        self.array, self.copies = array, copies
        self.device = ti.ndarray(ti.f64 if array.dtype == np.float64 else ti.f32,
                                 (copies * array.shape[0], *array.shape[1:]))
        self.device.from_numpy(array if copies == 1 else np.zeros(self.device.shape, array.dtype))

    def fetch(self, status: int) -> None:
        """Copy what was written to the host array, or add what was added; status: row with the largest speed."""
        values = self.device.to_numpy()
        if self.copies == 1:
            self.array[:] = values
        else:
            add_stripes(self.array, values, status)


def make_stepper(fields: Fields, counter: CounterKernel | None = None, sample: SampleKernel | None = None,
                 checkpoint: Sequence[StateBank] = (), undo: Sequence[StateBank] = ()) -> CpuStepper:
    """Return the kernels that advance a scene, see `CpuStepper`."""
    stepper = GpuStepper if is_shared() else CpuStepper
    return stepper(fields, counter, sample, checkpoint, undo)


@ti.data_oriented
class GpuStepper(CpuStepper):
    """The kernels that advance one scene on a GPU, called as those of `CpuStepper`."""

    def __init__(self, fields: Fields, counter: CounterKernel | None = None, sample: SampleKernel | None = None,
                 checkpoint: Sequence[StateBank] = (), undo: Sequence[StateBank] = ()) -> None:
        super().__init__(fields, counter, sample, checkpoint, undo)
        # in two kernels: Taichi's code for Vulkan cannot have both transfers in one
        self.loops = [PhaseLoops(fields, phases) for phases in split_phases(fields)]
        self.n_packs = fields.particles.n_packs
        self.sum_parts = min(self.n_packs, SUM_PARTS)  # parts of the packs where something is summed
        self.surveys = ti.Vector.field(2, fields.real, STRIPES)  # of some particles each, see `survey`

    # as CpuStepper is called -----------------------------------------------------------------------------------------
    def mark(self, stamp: int) -> None:
        """Stamp the active blocks of the first substep."""
        self.drift(0.0, stamp)

    def launch(self, launch: Launch) -> None:
        """Advance by the substeps of a launch; it runs to the end where particles get too fast."""
        dt, interval, substeps = launch.dt, launch.interval, launch.substeps
        arrays = (launch.motion, launch.mobile, launch.out, launch.per_particle, launch.sampled)
        copies = [DeviceArray(array, STRIPES if array is launch.out else 1) for array in arrays]
        motion, mobile, out, per_particle, sampled = [copy.device for copy in copies]
        for bank in (self.checkpoint, self.undo)[launch.copy_to - 1] if launch.copy_to else ():
            bank.store_now(0)
        self.fields.particles.halted[None] = 0
        for loops in self.loops if substeps == 0 else ():  # only to compile
            loops.run(0, 0, dt, dt, dt, dt, motion, mobile, out, 1, 0, 0)
        left, stamp, span, strides = 0, launch.stamp, 1, self.fields.features.strides
        for s in range(substeps):
            starts = left == 0
            if starts:
                stamp, span = launch.stamp + s, 1
                most = min(launch.max_stride, substeps - s, interval - (launch.done + s) % interval)
                if strides:
                    span = self.stride(s, dt, motion, mobile, most)
                    self.drift(0.5 * dt * span, stamp)
                    span = max(span, 1)
                    for loops in self.loops:  # a stride begins with half a kick
                        loops.run(s, stamp, dt, 0.5 * dt, 0.0, span * dt, motion, mobile, out, 1, 0, 1)
                left = span
            left -= 1
            kick = 0.5 * dt if strides and left == 0 else dt
            for loops in self.loops:
                loops.run(s, stamp, dt, kick, dt, span * dt, motion, mobile, out, int(not strides), span * (left == 0),
                          1)
            if self.has_counter and (launch.done + s + 1) % interval == 0:
                self.read(motion, s, launch.done + s + 1, interval, out, per_particle)
        self.sum_up(out, sampled)
        for copy in copies:
            copy.fetch(self.fields.rows.status)

    # kernels ---------------------------------------------------------------------------------------------------------
    @ti.kernel
    def drift(self, dt: float, stamp: ti.i32):
        """Move all particles for dt [s]; stamp the blocks that their stencils reach now."""
        self.fields.grid.count[None] = 0
        ti.loop_config(block_dim=GROUP)
        for q in range(ti.static(self.n_packs)):
            drift_packs(self.fields, self.fields.particles, dt, stamp, q, q + 1)

    @ti.kernel
    def stride(self, s: ti.i32, dt: float, motion: ti.types.ndarray(), mobile: ti.types.ndarray(),
               most: ti.i32) -> ti.i32:
        """Return the substeps of the stride that begins with row s of the motion table, see `limit_stride`."""
        for stripe in range(STRIPES):
            self.surveys[stripe] = ti.Vector.zero(self.fields.real, 2)
        ti.loop_config(block_dim=GROUP)
        for part in range(ti.static(self.sum_parts)):
            first, last = self.stretch(part)
            found = survey(self.fields, self.fields.particles, first, last)
            ti.atomic_max(self.surveys[part % STRIPES][0], found[0])
            ti.atomic_add(self.surveys[part % STRIPES][1], found[1])
        ti.loop_config(serialize=True)
        for stripe in range(1, STRIPES):
            found, other = self.surveys[0], self.surveys[stripe]
            self.surveys[0] = ti.Vector([ti.max(found[0], other[0]), found[1] + other[1]])
        return limit_stride(self.fields, motion, s, mobile, dt, most, self.surveys[0])

    @ti.kernel
    def read(self, motion: ti.types.ndarray(), row: ti.i32, done: ti.i32, interval: ti.i32, out: ti.types.ndarray(),
             per_particle: ti.types.ndarray()):
        """Take a reading of the counter after `done` substeps, see `CpuStepper.take_reading`."""
        if ti.static(self.has_counter):
            for slot in range(self.fields.particles.pack_count[None] * LANES):
                reading = done // interval - 1
                ledger = ti.static(ledger_of(out, slot))
                self.counter.count_slot(slot, ti.cast(collider_origin(motion, self.counter_row, row), ti.f64),
                                        ti.cast(collider_axes(motion, self.counter_row, row), ti.f64), ledger,
                                        self.fields.rows.count + COUNTER_ROWS * reading, per_particle, reading)

    @ti.kernel
    def sum_up(self, out: ti.types.ndarray(), sampled: ti.types.ndarray()):
        """Sum momentum and status, and take the sample, at the end of a launch."""
        ti.loop_config(block_dim=GROUP)
        for part in range(ti.static(self.sum_parts)):
            first, last = self.stretch(part)
            ledger = ti.static(ledger_of(out, part))
            self.sum_momentum(ledger, first, last)
            add_status(self.fields, self.fields.particles, ledger, first, last)
        if ti.static(self.has_sample):
            for i in range(self.sample.slots.shape[0]):
                self.sample.take_one(sampled, 0, i)

    @ti.func
    def stretch(self, part):
        """Return the first and last + 1 pack of a part."""
        each = ti.static(-(-self.n_packs // self.sum_parts))
        return ti.min(part * each, self.n_packs), ti.min((part + 1) * each, self.n_packs)
