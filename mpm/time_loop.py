"""The time loop of a solver: launches of an advance, checks after each, and undoing of an advance that fails."""

import math
from numbers import Integral, Real

import numpy as np

from mpm.backend import check_owner, default_precision
from mpm.errors import InvalidValue, SimulationDiverged
from mpm.files import quote
from mpm.geometry.rigid_motion import COLUMNS
from mpm.gpu.stepper import make_stepper as new_stepper
from mpm.observers import diagnostics
from mpm.observers.counter_kernel import COUNTER_ROWS
from mpm.observers.readings import Momentum
from mpm.observers.region_counter import MAX_READINGS, Counts
from mpm.state.particles import SPEED_LIMIT
from mpm.stepping.core import Core
from mpm.stepping.cpu import NOWHERE, UNDO
from mpm.stepping.phases import Launch
from mpm.stepping.stride import longest_stride, split_launches


class TimeLoop:
    """Launches the kernels that advance the core of a solver."""

    def __init__(self, core: Core) -> None:
        self._core, self._unsampled, self._has_warned_of_held = core, np.zeros((1, 6), np.float32), False
        self.launches = 0  # of this solver: without one, particles stay as they are unless a state is loaded
        self._is_at_rest = False  # whether in the last launch all slept and no collider moved
        self.make_stepper()

    def make_stepper(self) -> None:
        """Compile kernels for the scene and what is attached to it, at their first launch."""
        core, fields, assembly = self._core, self._core.fields, self._core.tenure.assembly
        counter, sample = core.counter and core.counter.kernel, core.sample and core.sample.kernel
        core.rollback.counter = counter
        # where contact moves colliders, the launch itself copies the state
        checkpoint, undo = core.rollback.allocate() if core.features.mobile else [], core.rollback.allocate(UNDO)
        # sums of sleepers and the blocks that use them are of one kernel
        fields.substep_counter.is_listed &= not core.features.sleep
        self.stepper = assembly.share(("stepper", counter, sample),
                                      lambda: new_stepper(fields, counter, sample, checkpoint, undo))
        rows = COUNTER_ROWS * MAX_READINGS if counter else 0
        self._out = np.zeros((fields.rows.count + rows, 6))
        attached = core.counter
        shape = (1, 1, 2) if attached is None else (MAX_READINGS, *attached.per_particle_shape)
        self._per_particle = np.zeros(shape, np.float32)

    def compile(self) -> None:
        """Compile the kernels; nothing moves."""
        core = self._core
        with default_precision(core.precision):
            self._launch(0, core.dt, np.zeros((1, 1, COLUMNS), core.dtype), 0, 1)
            self.stepper.mark(core.fields.substep_counter.take(1))

    def advance(self, duration: float, readings: int) -> list[Counts]:
        """Advance as `mpm.Solver.advance` does."""
        core = self._core
        check_owner()
        core.tenure.check_open()
        if not isinstance(duration, Real) or not 0 < duration < math.inf:
            raise InvalidValue(f"advance: duration = {quote(duration)} s; accepted: a positive time")
        if not isinstance(readings, Integral) or not 1 <= readings <= MAX_READINGS:
            raise InvalidValue(f"advance: readings = {quote(readings)}; accepted: 1 to {MAX_READINGS}")
        is_unread = core.counter is None and core.sample is None and core.fields.substep_counter.is_listed
        if self._is_at_rest and is_unread and self._are_colliders_at_rest:
            core.progress.pass_time(duration, readings * math.ceil(duration / readings / core.dt - 1e-9))
            return []
        core.rollback.begin()
        try:
            return self._advance(duration, readings)
        except BaseException as error:
            if isinstance(error, SimulationDiverged):
                error.state = core.state()
            core.rollback.undo()
            raise

    @property
    def _are_colliders_at_rest(self) -> bool:
        return not self._core.paths.pending and self._core.mobility.is_at_rest

    def _advance(self, duration: float, readings: int) -> list[Counts]:
        """Advance, see `advance`; an error leaves the solver where it came about."""
        core, progress, rests = self._core, self._core.progress, self._are_colliders_at_rest
        total, table = core.paths.plan(duration, readings, core.dt, core.dtype)
        dt, interval = duration / total, total // readings
        counts: list[Counts] = []
        progress.substep, progress.sums[:] = dt, 0.0
        core.mobility.begin(core.paths.poses, duration)
        rows, numbers = core.fields.rows, core.fields.substep_counter
        for first, n in split_launches(total, interval):
            self._out[:] = 0.0
            with default_precision(core.precision):
                if not numbers.is_listed:
                    numbers.last += 1  # blocks that the last advance listed for its next substep carry that number
                    self.stepper.mark(numbers.next)
                numbers.is_listed = False  # an interrupted launch leaves no list
                self._launch(n, dt, np.ascontiguousarray(table[:, first : first + n]), first, interval)
                numbers.is_listed = True
            numbers.pass_substeps(n)
            self.launches += 1
            squares, fastest, halted, held = self._out[rows.status, :4].tolist()
            done = int(halted) or n
            progress.sums += self._out[: rows.count]
            progress.steps += done
            progress.time += done * dt
            progress.fastest, progress.momentum = fastest, Momentum(*self._out[rows.momentum].reshape(2, 3).copy())
            if halted or not math.isfinite(squares + core.mobility.table.sum()) \
                    or fastest * dt > SPEED_LIMIT * core.scene.grid.cell:
                raise diagnostics.describe_divergence(core.readings, dt, core.mobility.not_finite())
            if held and not self._has_warned_of_held:
                self._has_warned_of_held = True
                diagnostics.warn_of_held(core.readings, stacklevel=5)
            if core.counter is not None:
                taken = range(first // interval, (first + n) // interval)
                counts += core.counter.all_counts(self._out[rows.count :], self._per_particle, taken)
            core.mobility.end(core.paths.poses)
            # where gravity acts, particles awake leave sums that are not zero
            self._is_at_rest = rests and core.features.sleep and core.scene.gravity.any() and not self._out.any()
        return counts

    def _launch(self, substeps: int, dt: float, motion: np.ndarray, first: int, interval: int) -> None:
        core, sample = self._core, self._core.sample
        self.stepper.launch(Launch(
            substeps, core.fields.substep_counter.next, dt, motion, core.mobility.table, self._out, first, interval,
            self._per_particle, self._unsampled if sample is None else sample.values,
            core.rollback.place_of_copy() if substeps else NOWHERE, longest_stride(core.transfer_interval, dt)))
