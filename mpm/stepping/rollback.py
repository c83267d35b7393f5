"""States that a solver can return to, on the device: far cheaper than a snapshot on the host."""

from typing import Any

from mpm.backend import check_owner
from mpm.errors import InvalidValue
from mpm.stepping.cpu import CHECKPOINT, NOWHERE, UNDO
from mpm.stepping.snapshots import StateBank


class Rollback:
    """Stores a solver's state and restores it: a checkpoint, any number of times, and the one before an advance.

    Where contact moves colliders, and so steps are often rolled back, the copy of a checkpoint is made by the next
    launch itself; so is always the copy from which an advance that fails is undone.
    """

    def __init__(self, solver: Any) -> None:  # a Solver, which stands above
        self._solver = solver
        self._rest: tuple | None = None
        self._before: tuple | None = None
        """What an advance is undone to, besides the particles; None once nothing is to be undone."""
        self._copy = NOWHERE
        """Where the particles' state before the advance is."""
        self.is_pending = False
        """Whether the next launch copies the particles' state to the checkpoint first."""

    def allocate(self, place: int = CHECKPOINT) -> list[StateBank]:
        """Return the banks of a place that the state is copied to: particles, then orifices, then a counter's flags.

        They take memory from the first call on.
        """
        assembly, particles, counter = self._solver.assembly, self._solver.particles, self._solver.counter
        count, sleepers = particles.pack_count, self._solver.fields.sleepers
        banks = [assembly.share(("bank", place), lambda: StateBank(particles.state_fields, count, 1,
                                                                            sleepers=sleepers))]
        orifices = self._solver.fields.orifices
        if orifices is not None:
            banks.append(assembly.share(("bank", place, "orifices"),
                                        lambda: StateBank([orifices.state], orifices.packs, 1)))
        if counter is not None:
            kernel = counter.kernel
            banks.append(assembly.share(("bank", place, kernel), lambda: StateBank([], count, 1, [kernel.flags])))
        return banks

    def _host_state(self) -> tuple:
        s = self._solver
        return s.time, s.steps, s.paths.save(), s.mobility.save(), s.momentum_after_advance()

    def _adopt(self, place: int, host_state: tuple) -> None:
        for bank in self.allocate(place) if place != NOWHERE else []:
            bank.restore_now(0)
        s, (time, steps, paths, mobility, momentum) = self._solver, host_state
        s.mobility.restore(mobility)
        s.adopt_state(list(paths[0]), time, steps, momentum)
        s.paths.pending = dict(paths[1])

    def store(self) -> None:
        """Store the present state, in place of the one stored before."""
        check_owner()
        self._rest = self._host_state()
        self.is_pending = True
        if not self._solver.features.mobile:
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
        """Note what an advance is undone to if it fails."""
        s = self._solver
        self._before, self._copy = (self._host_state(), s.sums.copy(), s.substep), NOWHERE

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
            self._solver.sums[:], self._solver.substep = sums, substep
            self._before = None
