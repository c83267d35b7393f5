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
    """A number or shape that the field cannot work with."""


class UnknownName(MpmError, ValueError):
    """A name outside a closed list."""

    def __init__(self, what: str, given: object, valid: Iterable[str]) -> None:
        self.given, self.valid = given, sorted(valid)
        super().__init__(f"unknown {what} {given!r}; valid: {', '.join(self.valid)}")


class TimeStepTooLarge(InvalidValue):
    """The time step asked for exceeds the stability bound."""

    def __init__(self, dt: float, bound: float, reason: str) -> None:
        self.dt, self.bound = dt, bound
        super().__init__(
            f"time step {dt:.4g} s is above the bound {bound:.4g} s ({reason}); give dt <= {bound:.4g} or None"
        )


class ColliderTooFast(InvalidValue):
    """A collider that no affordable substep can follow."""

    def __init__(self, collider: int, speed: float, accepted: float) -> None:
        self.collider, self.speed, self.accepted = collider, speed, accepted
        super().__init__(f"collider {collider} moves at {speed:.4g} m/s; accepted: up to {accepted:.4g} m/s with this "
                         f"grid and dt (metres and seconds?)")


class MpmWarning(UserWarning):
    """Base of the warnings that `mpm` gives: the run goes on, its result is suspect."""


class OverlappingBodies(MpmWarning):
    """Two bodies fill the same space."""


class StrongCompression(MpmWarning):
    """A body too soft for its own weight."""


class NarrowPassage(MpmWarning):
    """A gap between walls that is too narrow for the cells."""


class SimulationDiverged(MpmError):
    """A non-finite or absurd state, with where and when it was found.

    Attributes: time [s], step (substeps since the start), particle (index of the fastest, or of one that is not
    finite), its position [m] (3,), speed [m/s] and cfl (speed * dt / cell), collider (index of a mobile one that moves
    by no finite number, or None), diagnostics (of the whole field, see `mpm.observers.diagnostics`).
    """

    diagnostics: object = None

    def __init__(
        self, *, time: float, step: int, particle: int, position: tuple[float, ...], speed: float, cfl: float,
        collider: int | None = None,
    ) -> None:
        self.time, self.step, self.particle = time, step, particle
        self.position, self.speed, self.cfl, self.collider = position, speed, cfl, collider
        whose = "" if collider is None else f"the motion of collider {collider} is not finite; fastest grain: "
        super().__init__(
            f"diverged at t = {time:.6g} s, substep {step}: {whose}particle {particle} at {position} m, "
            f"speed {speed:.4g} m/s, CFL number {cfl:.3g}"
        )


class GradientDiverged(MpmError):
    """A derivative that is not finite, with where it was found.

    Attributes: step (of the rollout), substep (within it), quantity (of the state, by which the loss is
    differentiated), particle (index, or -1 where it is none's), norms (n_steps, 2) of `Gradients` as far as they were
    finite, zero before.
    """

    norms: Any = None

    def __init__(self, *, step: int, substep: int, quantity: str, particle: int) -> None:
        self.step, self.substep, self.quantity, self.particle = step, substep, quantity, particle
        whose = f" of particle {particle}" if particle >= 0 else ""
        super().__init__(
            f"the derivative by {quantity}{whose} in substep {substep} of step {step} is not finite; accepted: a "
            f"finite loss; where it grew on the way, a shorter rollout, or Rollout(limit=...) or Rollout(window=...)"
        )
