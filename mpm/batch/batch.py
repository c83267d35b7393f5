"""Several environments of one scene in one launch: their states lie in a bank and are swapped through shared fields.
Grid, colliders and kernel are shared, so that one more environment costs its particles' state and no more; what is
added to the work is a copy of that state there and back."""

from typing import Any, NamedTuple

import numpy as np

from mpm.backend import check_owner, default_precision, ti
from mpm.backend.launching import Launcher
from mpm.batch.environment_numbers import EnvironmentNumbers, NumbersKernel
from mpm.errors import InvalidValue, SimulationDiverged
from mpm.geometry.rigid_motion import Pose, Wrench
from mpm.materials.material import Material
from mpm.motion.collider_paths import ColliderPaths
from mpm.observers.counter_kernel import COUNTER_ROWS, CounterKernel
from mpm.observers.diagnostics import describe_divergence, warn_of_held
from mpm.observers.reading_kernels import SampleKernel
from mpm.observers.readings import received
from mpm.observers.region_counter import MAX_READINGS, Counts
from mpm.scene.grid import ROUNDING
from mpm.state.fields import Fields
from mpm.state.packs import count_packs
from mpm.state.particles import SPEED_LIMIT
from mpm.stepping.core import Core
from mpm.stepping.cpu import CpuStepper, add_status
from mpm.stepping.phases import Launch
from mpm.stepping.snapshots import StateBank
from mpm.stepping.stride import choose_interval, longest_stride, split_launches
from mpm.stepping.thread_group import ThreadGroup

SKIPPED, READ_ONLY = -1, 0  # numbers of substeps that mean something else


class Plan(NamedTuple):
    """What an environment does in a launch."""

    substeps: int = SKIPPED
    first_row: int = 0  # of its part of the motion table
    interval: int = 1  # substeps between two readings
    done: int = 0  # substeps of the advance in earlier launches
    stamp: int = 0
    max_stride: int = 1  # the most substeps between two transfers


@ti.data_oriented
class BatchStepper(CpuStepper):
    """The kernel of a batch: the substeps of one environment after another."""

    def __init__(self, fields: Fields, counter: CounterKernel | None, sample: SampleKernel | None, n: int,
                 n_colliders: int) -> None:
        super().__init__(fields, counter, sample)
        self.n, self.numbers = n, NumbersKernel(fields, counter, n_colliders)
        flags = [counter.flags] if counter is not None else []
        self.states = StateBank(self.fields.particles.state_fields, self.fields.particles.pack_count, n, flags)
        self.boundaries = [StateBank([boundary.state], boundary.packs, n) for boundary in fields.boundary_states]
        """Banks of the boundaries with a state of their own."""
        self.sample_rows = sample.count if sample is not None else 0
        self.launch_all = Launcher(self, BatchStepper.run_all)

    @ti.kernel
    def run_all(self, plans: ti.types.ndarray(), dts: ti.types.ndarray(), motion: ti.types.ndarray(),
                mobile: ti.types.ndarray(), numbers: ti.types.ndarray(), out: ti.types.ndarray(),
                results: ti.types.ndarray(), per_particle: ti.types.ndarray(), sampled: ti.types.ndarray(),
                readings: ti.i32):
        """Run every environment by its plan (n, 6).
        dts: [s] (n,). numbers: those of `EnvironmentNumbers`. out: zero before and after; results (n, rows, 6) hold
        what it held. per_particle (n readings, particles, 2), sampled (n particles, 6): as in `CpuStepper.run`, one
        environment after another."""
        ti.loop_config(serialize=True)
        for e in range(self.n):
            substeps, row, interval, done, stamp, max_stride = [plans[e, i] for i in ti.static(range(6))]
            if substeps != ti.static(SKIPPED):
                self.states.restore(e)
                for bank in ti.static(self.boundaries):
                    bank.restore(e)
                self.numbers.write(numbers, e)
                dt, earlier = dts[e], e * readings
                launch = ti.static(Launch(substeps, stamp, dt, motion, mobile, out, done, interval, per_particle,
                                          sampled, 0, max_stride, row, earlier))
                if substeps == ti.static(READ_ONLY):  # noqa: SIM102  (decided when compiling)
                    if ti.static(self.has_counter):
                        self.take_reading(ti.static(launch._replace(interval=1)), row, 1)
                if ti.static(self.fields.features.sleep) or substeps > 0:
                    self.list_blocks(stamp)
                self.advance(ti.static(ThreadGroup()), launch)
                add_status(self.fields, self.fields.particles, out, 0, count_packs(self.fields))
                if ti.static(self.has_sample):
                    self.sample.take(sampled, e * ti.static(self.sample_rows))
                self.states.store(e)
                for bank in ti.static(self.boundaries):
                    bank.store(e)
                for i in range(results.shape[1]):
                    for j in range(6):
                        results[e, i, j] = out[i, j]
                        out[i, j] = 0.0


class Batch:
    """n environments of one scene in one process, advanced in one kernel launch.

    Each has its own particles, material parameters, time and poses of colliders. The counter and sample of the solver
    are evaluated in every environment. readings: largest number of readings in one advance. Afterwards the solver has
    the state of one of the environments; `select` chooses which. Raises InvalidValue for a solver with mobile colliders
    or several threads."""

    def __init__(self, solver: Any, n: int, readings: int = 1) -> None:
        core: Core = solver.core
        if n < 1 or not 1 <= readings <= MAX_READINGS:
            raise InvalidValue(f"Batch: n = {n}, readings = {readings}; accepted: 1 or more, 1 to {MAX_READINGS}")
        if not core.features.serial:
            raise InvalidValue("Batch: the solver has several threads; accepted: one of mpm.init(threads=1)")
        if core.features.mobile:
            raise InvalidValue(f"Batch: colliders {core.features.mobile} are mobile; accepted: moved ones")
        self.solver, self._core, self.n, self.readings = solver, core, n, readings
        counter, sample, fields = core.counter, core.sample, core.fields
        kernels = counter and counter.kernel, sample and sample.kernel
        self._stepper: BatchStepper = core.tenure.assembly.take(
            ("batch", *kernels, n), lambda: BatchStepper(fields, *kernels, n, len(core.scene.colliders)))
        rows = fields.rows.count + (COUNTER_ROWS * readings if counter else 0)
        self._out, self._results = np.zeros((rows, 6)), np.zeros((n, rows, 6))
        shape = counter.per_particle_shape if counter else (1, 2)
        self._per_particle = np.zeros((n * readings, *shape), np.float32)
        self._sampled = np.zeros((n * (len(sample.values) if sample else 1), 6), np.float32)
        self._dts, self._counter = np.zeros(n), counter
        self._ledgers = np.zeros((n, fields.rows.momentum, 6))
        self._numbers = EnvironmentNumbers(core, n)
        self._paths = [ColliderPaths(core.scene, core.features, core.mobility) for _ in range(n)]
        self._has_warned_of_held = False
        self.time, self.steps = np.zeros(n), np.zeros(n, int)  # time [s] and substeps of every environment
        state = core.state()
        for e in range(n):
            self.load(e, state)

    @property
    def bytes_each(self) -> int:
        """Memory [bytes] that one more environment takes."""
        bank, particles = self._stepper.states, self._core.fields.particles
        each = StateBank.bytes_per_state(particles.state_fields, self._core.precision)
        each += len(bank.flags) * bank.lanes
        return each + (self._results.nbytes + self._per_particle.nbytes + self._sampled.nbytes) // self.n

    def sampled(self, e: int) -> np.ndarray:
        """Return the solver's sample (n, 6) at the end of an environment's last launch."""
        return self._sampled.reshape(self.n, -1, 6)[e]

    def set_material(self, e: int, body: int, material: Material) -> None:
        """Set a body's material in one environment, as `Solver.set_material` does."""
        self._core.settings.check_material(body, material)
        if self._core.features.sleep and material != self._numbers.materials[e][body]:
            self._wake(e)
        self._numbers.set_material(e, body, material)

    def set_friction(self, e: int, index: int, friction: float) -> None:
        """Set the friction coefficient of a collider in one environment, as `Solver.set_friction` does."""
        if self._numbers.set_friction(e, index, friction) and self._core.features.sleep:
            self._wake(e)

    def set_volume(self, e: int, body: int, volume: float) -> None:
        """Set the volume [m^3] of a body's particles in one environment, as `solver.settings.set_volume` does."""
        self._core.settings.check_volume(body, volume)
        if self._core.features.sleep:
            self._wake(e)
        self._numbers.set_volume(e, body, volume)

    def place(self, e: int, frame: Pose) -> None:
        """Move the regions of the counter in one environment, as `RegionCounter.place` does."""
        self._numbers.set_frame(e, self._counter, frame)

    def _wake(self, e: int) -> None:
        """Wake all particles of an environment."""
        states = self._stepper.states
        with default_precision(self._core.precision):
            states.restore_now(e)
            self._core.settings.wake()
            states.store_now(e)

    def set_collider_motion(self, e: int, index: int, begin: Pose, *ends: Pose, jump: bool = False) -> None:
        """Set a collider's motion in one environment, as `Solver.set_collider_motion` does."""
        self._paths[e].set(index, begin, ends, jump)

    def collider_pose(self, e: int, index: int) -> Pose:
        """Return the pose of a collider at the end of an environment's last advance."""
        return self._paths[e].pose(index)

    def collider_impulse(self, e: int, index: int, about: np.ndarray) -> Wrench:
        """Return what a collider received in an environment's last advance, as `Solver.collider_impulse` does."""
        return received(self._ledgers[e, self._core.fields.rows.first_collider + index], about)

    def load(self, e: int, state: dict[str, np.ndarray]) -> Counts | None:
        """Load a state (`Solver.state`) into an environment; return the counts of the counter there.
        Particles out of bounds in the state do not count as newly exited."""
        particles = self._core.fields.particles
        arrays = [particles.read_snapshot(state, name) for name in particles.named_fields()]
        self._core.scene.grid.check_inside(arrays[0] + self._core.scene.grid.origin, "load: ", ROUNDING)
        boundaries = [boundary.read_snapshot(state) for boundary in self._core.fields.boundary_states]
        packed = [particles.pack(values) for values in arrays]
        self._paths[e].poses = self._paths[e].read_snapshot(state)
        self._paths[e].pending.clear()
        self.time[e], self.steps[e] = float(state["time"]), int(state["steps"])
        with default_precision(self._core.precision):
            self._stepper.states.write(e, np.concatenate(packed))
            for bank, values in zip(self._stepper.boundaries, boundaries):
                bank.write(e, values)
        self._read(e)
        return self._read(e)  # the first reading has flagged the particles out of bounds

    def _read(self, e: int) -> Counts | None:
        """Take a reading of the counter in an environment as it is."""
        _, table = self._paths[e].plan(1.0, 1, np.inf, self._core.dtype)
        plans = [Plan()] * self.n
        plans[e] = Plan(READ_ONLY)
        self._launch(plans, table)
        return self._counts(e, range(1))[0] if self._counter else None

    def advance(self, durations: np.ndarray, readings: np.ndarray) -> list[list[Counts] | SimulationDiverged]:
        """Advance every environment by its duration [s] (n,); zero: not at all.
        Returns for each environment the counts after each of its `readings` (n,) equal intervals, or the error with
        which it ended. `load` makes such an environment usable again."""
        check_owner()
        self._check(durations, readings)
        core, tables, plans, rows = self._core, [], [Plan()] * self.n, 0
        for e in np.flatnonzero(durations):
            total, table = self._paths[e].plan(float(durations[e]), int(readings[e]), core.dt, core.dtype)
            self._dts[e] = durations[e] / total
            plans[e] = Plan(total, rows, total // int(readings[e]),
                            max_stride=longest_stride(self._interval(e), self._dts[e]))
            tables.append(table)
            rows += total
        outcomes: list[list[Counts] | SimulationDiverged] = [[] for _ in plans]
        pieces = [split_launches(max(plan.substeps, 0), plan.interval) for plan in plans]
        self._ledgers[durations > 0] = 0.0
        for k in range(max(map(len, pieces))):
            launch = [Plan() if k >= len(pieces[e]) or not isinstance(outcomes[e], list) else
                      plan._replace(substeps=pieces[e][k][1], first_row=plan.first_row + pieces[e][k][0],
                                    done=pieces[e][k][0]) for e, plan in enumerate(plans)]
            self._launch(launch, np.concatenate(tables, axis=1))
            for e, plan in enumerate(launch):
                if plan.substeps > 0:
                    self._ledgers[e] += self._results[e, : self._ledgers.shape[1]]
                    outcomes[e] = self._outcome(e, plan, outcomes[e])
        return outcomes

    def _interval(self, e: int) -> float:
        """Return the longest stride [s] of an environment's materials."""
        return choose_interval(self._core.numerics.transfer_interval, self._core.scene, self._numbers.materials[e])

    def _check(self, durations: np.ndarray, readings: np.ndarray) -> None:
        """Raise InvalidValue for what no environment can do, before any starts."""
        for name, values in (("durations", durations), ("readings", readings)):
            if np.shape(values) != (self.n,):
                raise InvalidValue(f"advance: {name} have shape {np.shape(values)}; accepted: ({self.n},)")
        wrong = np.flatnonzero((readings < 1) | (readings > self.readings) | ~(durations >= 0)) \
            if np.any(durations) else []
        for e in wrong:
            if durations[e] != 0:
                raise InvalidValue(f"advance: durations[{e}] = {durations[e]} s, readings[{e}] = {readings[e]}; "
                                   f"accepted: 0 or more, 1 to {self.readings}, the batch's own")

    def _launch(self, plans: list[Plan], motion: np.ndarray) -> None:
        core = self._core
        if core.counter is not self._counter:
            raise InvalidValue("Batch: another counter was attached after the batch was made; make the batch again")
        stamped = [plan._replace(stamp=core.fields.substep_counter.take(max(plan.substeps, 0) + 1)) for plan in plans]
        with default_precision(core.precision):
            self._stepper.launch_all(np.array(stamped, np.int32), self._dts.astype(core.dtype),
                                  np.ascontiguousarray(motion), core.mobility.table, self._numbers.table,
                                  self._out, self._results, self._per_particle, self._sampled, self.readings)

    def _outcome(self, e: int, plan: Plan, before: list[Counts]) -> list[Counts] | SimulationDiverged:
        """Return what an environment's launch came to, with the readings of earlier ones of the advance."""
        dt = float(self._dts[e])
        squares, fastest, halted, held = self._results[e, self._core.fields.rows.status, :4]
        done = int(halted) or plan.substeps
        self.time[e] += done * dt
        self.steps[e] += done
        if halted or not np.isfinite(squares) or fastest * dt > SPEED_LIMIT * self._core.scene.grid.cell:
            self.select(e)
            return describe_divergence(self._core.readings, dt)
        if held and not self._has_warned_of_held:
            self._has_warned_of_held = True
            self.select(e)
            warn_of_held(self._core.readings, stacklevel=4)
        readings = range(plan.done // plan.interval, (plan.done + plan.substeps) // plan.interval)
        return [*before, *self._counts(e, readings)] if self._counter else []

    def _counts(self, e: int, readings: range) -> list[Counts]:
        own = self._per_particle[e * self.readings : (e + 1) * self.readings]
        return self._counter.all_counts(self._results[e, self._core.fields.rows.count :], own, readings)

    def adopt(self, e: int) -> None:
        """Set an environment to the state, materials and counter's flags of the solver: the reverse of `select`."""
        core, paths = self._core, self._paths[e]
        core.tenure.check_open()
        self._numbers.adopt(e, core)
        paths.poses = list(core.paths.poses)
        paths.pending.clear()
        self.time[e], self.steps[e] = core.progress.time, core.progress.steps
        with default_precision(core.precision):
            for bank in (self._stepper.states, *self._stepper.boundaries):
                bank.store_now(e)

    def select(self, e: int) -> None:
        """Set the solver to the state of an environment, to read or render it."""
        core = self._core
        core.tenure.check_open()
        with default_precision(core.precision):
            self._numbers.hand_over(e, core)
            for bank in (self._stepper.states, *self._stepper.boundaries):
                bank.restore_now(e)
        core.rollback.adopt_state(list(self._paths[e].poses), float(self.time[e]), int(self.steps[e]))
