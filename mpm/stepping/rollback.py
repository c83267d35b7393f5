"""A state that a solver can return to, on the device: far cheaper than a snapshot on the host."""

from typing import Any

from mpm.backend import check_owner
from mpm.errors import InvalidValue
from mpm.state.snapshots import StateBank


class Rollback:
    """Stores a solver's state and restores it, any number of times.

    Where contact moves colliders, and so steps are often rolled back, the copy is made by the next launch itself.
    """

    def __init__(self, solver: Any) -> None:  # a Solver, which stands above
        self._solver = solver
        self._banks: list[StateBank] = []
        self._rest: tuple | None = None
        self.is_pending = False
        """Whether the next launch copies the particles' state first."""

    def allocate(self) -> list[StateBank]:
        """Return the banks that the state is copied to: of the particles, then of an attached counter's flags.

        They take memory from the first call on.
        """
        particles, counter = self._solver.particles, self._solver.counter
        if not self._banks:
            self._banks = [StateBank(particles.state_fields, particles.pack_count, 1)]
        if counter is not None and self._banks[-1].flags != [counter.flags]:
            self._banks = [self._banks[0], StateBank([], particles.pack_count, 1, [counter.flags])]
        return self._banks

    def store(self) -> None:
        """Store the present state, in place of the one stored before."""
        check_owner()
        s = self._solver
        self._rest = (s.time, s.steps, s.paths.save(), s.mobility.save(), s.momentum_after_advance())
        self.is_pending = True
        if not s.features.mobile:
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
        s = self._solver
        if not self.is_pending:
            for bank in self.allocate():
                bank.restore_now(0)
        time, steps, paths, mobility, momentum = self._rest
        s.mobility.restore(mobility)
        s.adopt_state(list(paths[0]), time, steps, momentum)
        s.paths.pending = dict(paths[1])
