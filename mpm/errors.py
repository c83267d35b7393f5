"""Errors of the field: each says what was given, where, and what would be accepted."""

import copyreg
from collections.abc import Iterable
from typing import Any


class Picklable(Exception):
    """An error that another process can send, message and attributes kept, whatever its constructor takes."""

    def __reduce__(self) -> tuple[Any, ...]:
        # Exception's own calls the constructor with the message alone, which one with several arguments refuses.
        return copyreg.__newobj__, (type(self), *self.args), self.__dict__


class MpmError(Picklable):
    """Base of every error that `mpm` raises on purpose."""


class BackendError(MpmError):
    """The backend cannot be started as asked."""


class InvalidValue(MpmError, ValueError):
    """A value or array shape that is not accepted."""


def say_meant(given: object, valid: Iterable[str]) -> str:
    """Return the end of a message about a name that is not valid: the one that was probably meant, if there is one."""
    from difflib import get_close_matches  # rarely needed, and what imports this module is to be light

    close = get_close_matches(given[:100], [one for one in valid if one != given], 1) if isinstance(given, str) else []
    return f"; did you mean {close[0]!r}?" if close else ""


def say_unknown(what: str, given: object, valid: list[str], also: str = "") -> str:
    """Return the message about a name that is not valid, with the one that was probably meant.
    also: what else is accepted."""
    names = [name if name.isprintable() else repr(name) for name in valid]
    accepted = ", ".join([*names, also] if also else names)
    return f"unknown {what} {given!r:.200}; valid: {accepted}{say_meant(given, valid)}"


class UnknownName(MpmError, ValueError):
    """A name that is not in the list of accepted names."""

    def __init__(self, what: str, given: object, valid: Iterable[str]) -> None:
        self.given, self.valid = given, sorted(valid)
        super().__init__(say_unknown(what, given, self.valid))


class TimeStepTooLarge(InvalidValue):
    """The requested time step is above the stability bound."""

    def __init__(self, dt: float, bound: float, reason: str) -> None:
        self.dt, self.bound = dt, bound
        super().__init__(
            f"time step {dt:.4g} s is above the bound {bound:.4g} s ({reason}); give dt <= {bound:.4g} or None"
        )


class ColliderTooFast(InvalidValue):
    """A collider moves so fast that it would need too many substeps."""

    def __init__(self, collider: int, speed: float, accepted: float) -> None:
        self.collider, self.speed, self.accepted = collider, speed, accepted
        super().__init__(f"collider {collider} moves at {speed:.4g} m/s; accepted: up to {accepted:.4g} m/s with this "
                         f"grid and dt (metres and seconds?)")


class MpmWarning(UserWarning):
    """Base of the warnings of `mpm`: the run continues, but its result may be wrong."""


class OverlappingBodies(MpmWarning):
    """Particles of two bodies overlap."""


class StrongCompression(MpmWarning):
    """A body's own weight compresses it by more than 10 %."""


class NarrowPassage(MpmWarning):
    """An opening of a collider is narrower than four cells; material will jam in it."""


class GrainsInSolid(MpmWarning):
    """Particles lie inside a solid collider at the start; they are pushed out, or held there for good."""


class GrainsLeaveGrid(MpmWarning):
    """Particles would have left the grid through a wall that cannot be left and is no floor, or were pushed through
    one; they are held on its plane."""


class ThinSolid(MpmWarning):
    """A static solid is thinner than two cells; particles on its two sides feel each other, and can pass."""


class CoarseGrains(MpmWarning):
    """A particle's cube is larger than a cell; the body falls apart into particles that do not touch."""


class VolumeMismatch(MpmWarning):
    """The volumes of particles do not fit the distances between them; mass or pressure is wrong."""


class MoreThreadsThanCores(MpmWarning):
    """A process has more threads than cores."""


class ColliderJumped(MpmWarning):
    """A motion begins where the collider is not; particles in between are not pushed."""


class ContactNotConverged(MpmWarning):
    """The solve for the twist of a mobile collider ended before it converged."""


class SimulationDiverged(MpmError):
    """A value of the state is not finite, or a particle moves more than a cell in a substep.

    Attributes: time [s], step (substeps since the start), particle (index of the fastest, or of one that is not
    finite), its position [m] (3,), speed [m/s] and cfl (speed * dt / cell), collider (index of a mobile collider whose
    motion is not finite, or None), diagnostics (`mpm.Diagnostics`), state (at that time, as of `Solver.state`; a
    solver itself returns to where it was before the advance)."""

    diagnostics: object = None
    state: Any = None

    def __init__(self, *, time: float, step: int, particle: int, position: tuple[float, ...], speed: float, cfl: float,
                 collider: int | None = None) -> None:
        self.time, self.step, self.particle = time, step, particle
        self.position, self.speed, self.cfl, self.collider = position, speed, cfl, collider
        whose = "" if collider is None else f"the motion of collider {collider} is not finite; fastest grain: "
        super().__init__(
            f"simulation diverged at t = {time:.6g} s, substep {step}: {whose}particle {particle} at {position} m, "
            f"speed {speed:.4g} m/s, CFL number {cfl:.3g}"
        )


class GradientDiverged(MpmError):
    """A derivative is not finite.
    Attributes: step (of the rollout), substep (of the step), quantity (part of the state with this derivative),
    particle (index; -1: not of a particle), norms (n_steps, 2) as in `Gradients`, zero for steps not reached."""

    norms: Any = None

    def __init__(self, *, step: int, substep: int, quantity: str, particle: int) -> None:
        self.step, self.substep, self.quantity, self.particle = step, substep, quantity, particle
        whose = f" of particle {particle}" if particle >= 0 else ""
        super().__init__(
            f"the derivative with respect to {quantity}{whose} in substep {substep} of step {step} is not finite; "
            f"check that the loss is finite; otherwise use a shorter rollout, Rollout(limit=...) or Rollout(window=...)"
        )
