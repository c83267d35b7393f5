"""Bringing grains to rest."""

from collections.abc import Callable

import mpm


def settle(solver: mpm.Solver, advance: Callable[[float], object], duration: float, window: float,
           velocity_factor: float = 0.8) -> None:
    """Bring grains to rest by kinetic damping.
    advance: advances the solver by a time [s]. duration: time [s] in all; after each `window` [s] all velocities are
    multiplied by velocity_factor. The affine velocity C is unchanged: the next substep takes its strain increment from
    it, which the positions have already followed."""
    for _ in range(round(duration / window)):
        advance(window)
        state = solver.state()
        state["v"] *= velocity_factor
        solver.load(state)
