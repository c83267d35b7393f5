"""States that a solver can return to, on the device: far cheaper than a snapshot on the host."""

from mpm.backend import check_owner
from mpm.errors import InvalidValue
from mpm.geometry.rigid_motion import Pose
from mpm.motion.collider_paths import ColliderPaths
from mpm.observers.counter_kernel import CounterKernel
from mpm.observers.diagnostics import momentum_after_advance
from mpm.observers.readings import Momentum, Readings
from mpm.stepping.cpu import CHECKPOINT, NOWHERE, UNDO
from mpm.stepping.snapshots import StateBank


class Rollback:
    """Stores a solver's state and restores it: a checkpoint, any number of times, and the one before an advance.
    Where contact moves colliders, and so steps are often rolled back, the copy of a checkpoint is made by the next
    launch itself; so is always the copy from which an advance that fails is undone."""

    def __init__(self, readings: Readings, paths: ColliderPaths) -> None:
        self._readings, self._paths, self._mobility = readings, paths, paths.mobility
        self.counter: CounterKernel | None = None  # kernel of the attached counter, whose flags belong to the state
        self._rest: tuple | None = None
        self._before: tuple | None = None
        """State to which an advance is undone, besides the particles; None once nothing is to be undone."""
        self._copy = NOWHERE  # where the particles' state before the advance is
        self.is_pending = False  # whether the next launch copies the particles' state to the checkpoint first

    def allocate(self, place: int = CHECKPOINT) -> list[StateBank]:
        """Return the banks of a place that the state is copied to: particles, then boundaries, then a counter's flags.
        They take memory from the first call on."""
        assembly, fields = self._readings.tenure.assembly, self._readings.fields
        particles, count, sleepers = fields.particles, fields.particles.pack_count, fields.sleepers
        banks = [assembly.share(("bank", place), lambda: StateBank(particles.state_fields, count, 1,
                                                                            sleepers=sleepers))]
        for boundary in fields.boundary_states:
            banks.append(assembly.share(("bank", place, boundary.name),
                                        lambda own=boundary: StateBank([own.state], own.packs, 1)))
        if self.counter is not None:
            kernel = self.counter
            banks.append(assembly.share(("bank", place, kernel), lambda: StateBank([], count, 1, [kernel.flags])))
        return banks

    def _host_state(self) -> tuple:
        progress = self._readings.progress
        return (progress.time, progress.steps, self._paths.save(), self._mobility.save(),
                momentum_after_advance(self._readings))

    def _adopt(self, place: int, host_state: tuple) -> None:
        for bank in self.allocate(place) if place != NOWHERE else []:
            bank.restore_now(0)
        time, steps, paths, mobility, momentum = host_state
        self._mobility.restore(mobility)
        self.adopt_state(list(paths[0]), time, steps, momentum)
        self._paths.pending = dict(paths[1])

    def adopt_state(self, poses: list[Pose], time: float, steps: int, momentum: Momentum | None = None) -> None:
        """Take over a state that a kernel wrote to the fields: poses, time [s], substeps, momentum if known."""
        progress = self._readings.progress
        progress.time, progress.steps, progress.fastest, progress.momentum = time, steps, None, momentum
        self._paths.poses = poses
        self._paths.pending.clear()
        self._readings.fields.substep_counter.is_listed = False

    def store(self) -> None:
        """Store the present state, in place of the one stored before."""
        check_owner()
        self._rest = self._host_state()
        self.is_pending = True
        if not self._readings.fields.features.mobile:
            self.store_pending()

    def store_pending(self) -> None:
        """Copy the particles' state if that is still to be done."""
        if self.is_pending:
            for bank in self.allocate():
                bank.store_now(0)
        self.is_pending = False

    def restore(self) -> None:
        """Return to the state stored last; raises InvalidValue where there is none."""
        if self._rest is None:
            raise InvalidValue("restore_checkpoint: no state is stored; call store_checkpoint() before what may have "
                               "to be repeated")
        self._adopt(NOWHERE if self.is_pending else CHECKPOINT, self._rest)

    # of an advance -------------------------------------------------------------------------------------------------
    def begin(self) -> None:
        """Note the state to which an advance is undone if it fails."""
        progress = self._readings.progress
        self._before, self._copy = (self._host_state(), progress.sums.copy(), progress.substep), NOWHERE

    def place_of_copy(self) -> int:
        """Return where the next launch copies the state to first: for the first of an advance, somewhere."""
        if self._copy != NOWHERE:
            return NOWHERE
        self._copy = CHECKPOINT if self.is_pending else UNDO
        self.is_pending = False
        return self._copy

    def undo(self) -> None:
        """Return to the state before the advance."""
        if self._before is not None:
            host_state, sums, substep = self._before
            self._adopt(self._copy, host_state)
            self._readings.progress.sums[:], self._readings.progress.substep = sums, substep
            self._before = None
