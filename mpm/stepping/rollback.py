"""A state that a solver can be returned to, far cheaper than a snapshot."""

from typing import Any

from mpm.errors import InvalidValue


class WayBack:
    """Copies a solver's state aside, on the device, and puts it back.

    Where contact moves colliders, and so steps may be taken back, the copy is made by the coming launch itself: `due`.
    """

    def __init__(self, solver: Any) -> None:  # a Solver; importing it here would be a cycle
        self._solver = solver
        self._rest: tuple | None = None
        self.due = False
        """Whether the next launch copies the grains' state first."""

    def keep(self) -> None:
        """Remember the present state until the next time."""
        s = self._solver
        self._rest = (s.time, s.steps, s._motions.kept(), s.mobility.kept(), s.momentum_after_advance())
        self.due = True
        if not s.features.mobile:
            self.copy_now()

    def copy_now(self) -> None:
        """Copy the grains' state if that is still to be done."""
        if self.due:
            for part in (self._solver.particles, self._solver.tally):
                if part is not None:
                    part.keep()
        self.due = False

    def rewind(self) -> None:
        """Return to what was kept last, any number of times."""
        if self._rest is None:
            raise InvalidValue("rewind: nothing was kept; call keep() before what may have to be repeated")
        s = self._solver
        if not self.due:
            for part in (s.particles, s.tally):
                if part is not None:
                    part.rewind()
        time, steps, motions, mobility, momentum = self._rest
        s.mobility.restore(mobility)
        s.taken_over(list(motions[0]), time, steps, momentum)
        s._motions.pending = dict(motions[1])
