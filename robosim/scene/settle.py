"""Bringing grains to rest."""

from collections.abc import Callable

import mpm


def settle(solver: mpm.Solver, advance: Callable[[float], object], duration: float, window: float,
           keep: float = 0.8) -> None:
    """Advance to rest by kinetic damping: of all velocities `keep` is left after every window [s].

    C stays: the next substep takes its strain from it, which the positions have already followed.
    """
    for _ in range(round(duration / window)):
        advance(window)
        state = solver.state()
        state["v"] *= keep
        solver.load(state)
