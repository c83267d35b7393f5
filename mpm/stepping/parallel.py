"""The parallel stepper: a kernel a substep, in which every phase is a loop over parts, for CPU threads and GPUs.

A part is a stretch of packs, or of the list of active blocks. On a CPU there are a few parts a thread, and each
scatters to an array of its own; these are added in their order, so that particles are the same to the bit whatever
thread comes first, with no atomic addition to a node. On a GPU every pack is a part, and all add to the same nodes. The
ledger's sums are atomic on both: right to rounding. For one thread the single launch of `serial` is faster.
"""

from collections.abc import Callable, Sequence

import numpy as np

from mpm.backend import is_shared, real_type, thread_count, ti
from mpm.launching import Launcher
from mpm.observers.counter_kernel import CounterKernel
from mpm.observers.sample import SampleKernel
from mpm.state.active_blocks import list_row
from mpm.state.fields import Fields
from mpm.state.snapshots import StateBank
from mpm.stepping.phases import Step
from mpm.stepping.serial import SerialStepper, add_status
from mpm.stepping.stride import fastest_square, limit_stride
from mpm.transfers.to_particles import drift_packs

WALLS = 6
GPU_PARTS = 4096
"""Parts of the list of blocks on a GPU; not measured yet."""
GPU_GROUP = 64
"""Parts that a group of GPU threads takes; not measured yet."""
PARTS = 2
"""Parts for each thread of a CPU: one that wakes late leaves some to the others."""
TURNS = 512
"""Turns of a loop that Taichi 1.7.4 gives a CPU thread at least, whatever its settings: each part is as many turns, of
which one works."""


def count_parts(serial: bool) -> int:
    """Return the arrays that threads scatter to, for `allocate_fields`; 0 for one thread, and on a GPU."""
    return 0 if serial or is_shared() else PARTS * thread_count()


def make_stepper(fields: Fields, counter: CounterKernel | None = None, sample: SampleKernel | None = None,
                 checkpoint: Sequence[StateBank] = (), undo: Sequence[StateBank] = ()) -> SerialStepper:
    """Return the kernels that advance a scene, see `SerialStepper`."""
    stepper = SerialStepper if fields.features.serial else ParallelStepper
    return stepper(fields, counter, sample, checkpoint, undo)


@ti.data_oriented
class ParallelStepper(SerialStepper):
    """The kernels that advance one scene with several threads, called as those of `SerialStepper`."""

    def __init__(self, fields: Fields, counter: CounterKernel | None = None, sample: SampleKernel | None = None,
                 checkpoint: Sequence[StateBank] = (), undo: Sequence[StateBank] = ()) -> None:
        super().__init__(fields, counter, sample, checkpoint, undo)
        self.on_gpu, n_packs = is_shared(), fields.particles.n_packs
        self.parts = n_packs if self.on_gpu else fields.parts
        self.block_parts = GPU_PARTS if self.on_gpu else self.parts
        self.packs_each = -(-n_packs // self.parts)
        self.turns = 1 if self.on_gpu else TURNS
        self.rows = fields.grid.stamp.shape[0] * fields.grid.stamp.shape[1]
        """Rows of the grid of blocks."""
        self.fastest = ti.field(real_type(fields.features.precision), ())
        """Largest squared speed of a particle [m^2/s^2]."""
        self.launch = self.run
        self._substep: Callable[..., None] = self.substep  # on a GPU, its arrays are on the device
        if not self.on_gpu:
            self._substep = Launcher(self, ParallelStepper.substep)

    # as SerialStepper is called --------------------------------------------------------------------------------------
    def mark(self, stamp: int) -> None:
        """List the active blocks of the first substep."""
        if not self.on_gpu:
            self.fields.scatter_target.fill(0.0)  # an interrupted substep leaves what was scattered
        self.drift(0.0, stamp)

    def run(self, substeps: int, first_stamp: int, dt: float, motion: np.ndarray, mobile: np.ndarray, out: np.ndarray,
            first: int, interval: int, per_particle: np.ndarray, sampled: np.ndarray, set_aside: int,
            max_stride: int) -> None:
        """Advance by `substeps` of dt [s], see `SerialStepper.run`."""
        arrays = (motion, mobile, out, per_particle, sampled)
        copies = [DeviceArray(array) for array in arrays] if self.on_gpu else []
        motion_, mobile_, out_, per_particle_, sampled_ = [copy.device for copy in copies] or arrays
        for bank in (self.checkpoint, self.undo)[set_aside - 1] if set_aside else ():
            bank.store_now(0)
        self.fields.particles.halted[None] = 0
        if substeps == 0:  # only to compile
            self._substep(0, 0, dt, motion_, mobile_, out_, 1, 0, 0, 0, 0)
        left, stamp, span = 0, first_stamp, 1
        for s in range(substeps):
            starts = left == 0
            if starts:
                stamp, span = first_stamp + s, 1
                if self.fields.features.strides:
                    most = min(max_stride, substeps - s, interval - (first + s) % interval)
                    span = self.plan_stride(s, dt, motion_, mobile_, most)
                    if span > 1:
                        self.drift(0.5 * dt * (span - 1), stamp)
                left = span
            left -= 1
            self._substep(s, stamp, dt, motion_, mobile_, out_, int(starts), span * (left == 0), self.parts,
                          self.block_parts, self.rows)
            if self.fields.particles.halted[None]:
                out[self.fields.rows.status, 2] = s + 1
                break
            if self.has_counter and (first + s + 1) % interval == 0:
                self.read(motion_, s, first + s + 1, interval, out_, per_particle_)
        self.sum_up(out_, sampled_)
        for copy in copies:
            copy.fetch()

    # kernels ---------------------------------------------------------------------------------------------------------
    @ti.kernel
    def substep(self, row: ti.i32, stamp: ti.i32, dt: float, motion: ti.types.ndarray(), mobile: ti.types.ndarray(),
                out: ti.types.ndarray(), transfer_mass: ti.i32, span: ti.i32, parts: ti.i32, block_parts: ti.i32,
                rows: ti.i32):
        """Run the phases of one substep, see `Step`. parts, block_parts, rows: how many there are, 0 to do nothing."""
        for phase in ti.static(self.phases):
            if ti.static(phase.over == "packs"):
                ti.loop_config(block_dim=GPU_GROUP)
                for turn in range(parts * self.turns):
                    if turn % self.turns == 0:
                        shift = turn // self.turns * ti.static(self.fields.grid.width if self.fields.parts else 0)
                        first, last = self.packs_of(turn // self.turns)
                        step = ti.static(Step(row, stamp, dt, transfer_mass, span, motion, mobile, out, shift=shift))
                        phase.run(self.fields, step, first, last)
            elif ti.static(phase.over == "blocks"):
                ti.loop_config(block_dim=GPU_GROUP)
                for turn in range(block_parts * self.turns):
                    if turn % self.turns == 0:
                        first, last = self.blocks_of(turn // self.turns)
                        step = ti.static(Step(row, stamp, dt, transfer_mass, span, motion, mobile, out))
                        phase.run(self.fields, step, first, last)
            elif ti.static(phase.over == "walls" and self.on_gpu):
                for w in ti.static(range(WALLS)):
                    ti.loop_config(block_dim=GPU_GROUP)
                    for part in range(block_parts):
                        first, last = self.blocks_of(part)
                        step = ti.static(Step(row, stamp, dt, transfer_mass, span, motion, mobile, out))
                        phase.run(self.fields, step, w, first, last)
            elif ti.static(phase.over == "walls"):
                ti.loop_config(serialize=True)  # waking a thread takes longer than a wall
                for w in range(WALLS * ti.min(parts, 1)):
                    step = ti.static(Step(row, stamp, dt, transfer_mass, span, motion, mobile, out))
                    phase.run(self.fields, step, w, 0, self.fields.grid.count[None])
            elif ti.static(phase.over == "rows"):
                ti.loop_config(serialize=not self.on_gpu)
                for r in range(rows):
                    step = ti.static(Step(row, stamp, dt, transfer_mass, span, motion, mobile, out))
                    phase.run(self.fields, step, r, r + 1)
            else:
                ti.loop_config(serialize=True)
                for _ in range(ti.min(parts, 1)):
                    step = ti.static(Step(row, stamp, dt, transfer_mass, span, motion, mobile, out))
                    phase.run(self.fields, step, 0, 1)

    @ti.kernel
    def drift(self, dt: float, stamp: ti.i32):
        """Move all particles for dt [s]; list the blocks that their stencils reach now, and those with the stamp."""
        ti.loop_config(block_dim=GPU_GROUP)
        for turn in range(self.parts * self.turns):
            if turn % self.turns == 0:
                first, last = self.packs_of(turn // self.turns)
                drift_packs(self.fields, self.fields.particles, dt, stamp, first, last)
        self.fields.grid.count[None] = 0
        ti.loop_config(serialize=not self.on_gpu)
        for r in range(self.rows):
            list_row(self.fields.grid, r, stamp)

    @ti.kernel
    def plan_stride(self, s: ti.i32, dt: float, motion: ti.types.ndarray(), mobile: ti.types.ndarray(),
                    most: ti.i32) -> ti.i32:
        """Return the substeps of the stride that begins with row s, see `stride.plan_stride`."""
        self.fastest[None] = 0.0
        ti.loop_config(block_dim=GPU_GROUP)
        for turn in range(self.parts * self.turns):
            if turn % self.turns == 0:
                first, last = self.packs_of(turn // self.turns)
                ti.atomic_max(self.fastest[None], fastest_square(self.fields, self.fields.particles, first, last))
        return limit_stride(self.fields, motion, s, mobile, dt, most, self.fastest[None])

    @ti.kernel
    def read(self, motion: ti.types.ndarray(), row: ti.i32, done: ti.i32, interval: ti.i32, out: ti.types.ndarray(),
             per_particle: ti.types.ndarray()):
        """Take a reading of the counter, with one thread."""
        ti.loop_config(serialize=True)
        for _ in range(1):
            if ti.static(self.has_counter):
                self.take_reading(motion, row, done, interval, out, per_particle, 0)

    @ti.kernel
    def sum_up(self, out: ti.types.ndarray(), sampled: ti.types.ndarray()):
        """Sum momentum and status, and take the sample, at the end of a launch."""
        ti.loop_config(block_dim=GPU_GROUP)
        for turn in range(self.parts * self.turns):
            if turn % self.turns == 0:
                first, last = self.packs_of(turn // self.turns)
                self.sum_momentum(out, first, last)
                add_status(self.fields, self.fields.particles, out, first, last)
        ti.loop_config(serialize=True)
        for _ in range(1):
            if ti.static(self.has_sample):
                self.sample.take(sampled, 0)

    @ti.func
    def packs_of(self, part):
        """Return the first and last + 1 pack of a part."""
        first = part * self.packs_each
        return first, ti.min(first + self.packs_each, self.fields.particles.pack_count[None])

    @ti.func
    def blocks_of(self, part):
        """Return the first and last + 1 active block of a part."""
        count = self.fields.grid.count[None]
        each = (count + self.block_parts - 1) // self.block_parts
        return ti.min(part * each, count), ti.min((part + 1) * each, count)


class DeviceArray:
    """A host array, and its copy on the GPU during a launch."""

    def __init__(self, array: np.ndarray) -> None:
        self.array = array
        self.device = ti.ndarray(ti.f64 if array.dtype == np.float64 else ti.f32, array.shape)
        self.device.from_numpy(array)

    def fetch(self) -> None:
        """Copy what was written to the host array."""
        self.array[:] = self.device.to_numpy()
