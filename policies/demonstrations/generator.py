"""The generator of demonstrations: a search for each, stored after every iteration."""

import sys
from functools import partial
from typing import Any, ClassVar, Protocol

import numpy as np

import mpm
from mpm.files import write
from policies.demonstrations.descent import Descent
from policies.demonstrations.motion_loss import MotionLoss
from policies.demonstrations.request import DemonstrationRequest, load_stored
from policies.demonstrations.spline_search import SplineSearch
from policies.learning.environments import score_motion
from robosim.base.progress import Progress

CHANGE, PATIENCE = 0.05, 5
"""A loss has settled when it has changed by less than this fraction in more than so many iterations."""


class Search(Protocol):
    """A search for the actions of least loss, one motion at a time."""

    uses_gradient: ClassVar[bool]
    check_every: ClassVar[int]
    """Iterations between two checks of convergence."""
    now: np.ndarray
    """Actions to be evaluated next (decisions, dimensions)."""
    best: np.ndarray
    """Actions of the lowest loss so far."""
    lowest: float
    """Lowest loss so far."""

    def step(self, loss: float, gradient: np.ndarray | None = None) -> None:
        """Take the loss of `now`, with its derivatives if the search uses them, and set the next `now`."""

    def fail(self) -> None:
        """Take that `now` has no loss, and set the next `now`."""

    def convergence_losses(self, losses: list[float]) -> list[float]:
        """Return those of the losses of all iterations that have to settle."""
        ...

    def state(self) -> dict[str, np.ndarray]:
        """Return what the next steps depend on, besides the losses."""
        ...

    def load(self, state: dict[str, np.ndarray]) -> None:
        """Restore a state; it holds all losses as `losses`."""


class DemonstrationGenerator:
    """Makes the demonstrations of a request, in one environment."""

    def __init__(self, request: DemonstrationRequest) -> None:
        self.request, self.env = request, request.make_environment(material=request.material)
        self.loss = MotionLoss(self.env, request.action_repeat, limit=request.limit, arm_weight=request.arm_weight)

    def make(self, k: int) -> dict[str, np.ndarray]:
        """Return the arrays of demonstration k: read if it is stored, else made, from a stored search if there is one.

        Raises:
            mpm.InvalidValue: the folder holds another demonstration k, or every motion diverged.
        """
        r = self.request
        mark = r.fingerprint(k, self.env)
        arrays = load_stored(r.path(k), mark, "losses")
        if arrays is None:
            arrays = self._run(k, mark)
        elif len(arrays["losses"]) < r.iterations and not arrays.get("settled", has_settled(list(arrays["losses"]))):
            print(f"{r.path(k)}: has {len(arrays['losses'])} iterations and is not continued; remove it for "
                  f"{r.iterations}", file=sys.stderr)
        r.unfinished_path(k).unlink(missing_ok=True)
        return arrays

    def _make_search(self, seed: int) -> Search:
        r = self.request
        return Descent(r.first_actions, r.rate, r.fixed) if r.method == "descent" else \
            SplineSearch(r.first_actions, seed, r.fixed)

    def _run(self, k: int, mark: str) -> dict[str, np.ndarray]:
        """Search until the loss has converged; store the demonstration."""
        r, start = self.request, self.request.reset_arguments(k)
        self.env.reset(**start)
        self.loss.set_start()
        search, losses, norms = self._make_search(start["seed"]), [], np.zeros((0, 2))
        stored = load_stored(r.unfinished_path(k), mark, "losses")
        if stored is not None:
            try:
                search.load(stored)
            except ValueError as error:
                raise mpm.InvalidValue(f"{r.unfinished_path(k)}: {error}; remove it to begin anew") from None
            losses, norms = list(stored["losses"]), stored["norms"]
        progress = Progress(initial=len(losses), total=r.iterations, desc=r.path(k).stem, unit="iterations")
        while len(losses) < r.iterations and not self._has_converged(losses, search, start):
            loss, norms = self._iterate(search, norms)
            losses.append(loss)
            progress.set_postfix(loss=f"{loss:.3f}", best=f"{search.lowest:.3f}")
            progress.update()
            write(r.unfinished_path(k), partial(np.savez, **{
                **search.state(), "losses": np.array(losses), "norms": norms, "fingerprint": np.array(mark)}))
        progress.close()
        if not np.isfinite(search.lowest):
            raise mpm.InvalidValue(f"{r.path(k).name}: every one of {len(losses)} motions diverged; begin with another "
                                   f"(--from), or take another --material")
        arrays = {"actions": search.best.astype(np.float32), "losses": np.array(losses), "norms": norms,
                  "check": self.loss.check_gradient(search.best) if search.uses_gradient else np.zeros((0, 2)),
                  "fingerprint": np.array(mark), "task": np.array(r.name), "seed": np.array(start["seed"]),
                  "nominal": np.array(start["options"]["nominal"]), "material": np.array(r.material),
                  "action_repeat": np.array(r.action_repeat), "method": np.array(r.method),
                  "settled": np.array(has_settled(search.convergence_losses(losses)))}
        write(r.path(k), partial(np.savez, **arrays))
        return arrays

    def _iterate(self, search: Search, norms: np.ndarray) -> tuple[float, np.ndarray]:
        """Evaluate the search's motion and step; return its loss and the norms of the best motion's derivatives."""
        try:
            if search.uses_gradient:
                loss, gradient = self.loss.value_and_grad(search.now)
                if loss < search.lowest:
                    norms = self.loss.rollout.last.norms
                search.step(loss, gradient)
            else:
                loss = self.loss.value(search.now)
                search.step(loss)
        except (mpm.SimulationDiverged, mpm.GradientDiverged):
            if search.uses_gradient and not np.isfinite(search.lowest):  # there is no motion to return to
                raise
            loss = np.inf
            search.fail()
        return loss, norms

    def _has_converged(self, losses: list[float], search: Search, start: dict[str, Any]) -> bool:
        """Return whether the loss has settled at a motion that succeeds (arXiv 2406.09178, Algorithm 2)."""
        if len(losses) % search.check_every > 0 or not has_settled(search.convergence_losses(losses)):
            return False
        return bool(score_motion(self.env, search.best, **start)["is_success"])


def has_settled(losses: list[float]) -> bool:
    """Return whether the loss has changed by less than CHANGE in each of more than PATIENCE iterations."""
    recent = np.array(losses[-PATIENCE - 2 :])
    if len(recent) < PATIENCE + 2 or not np.isfinite(recent).all():
        return False
    return bool(np.all(np.abs(np.diff(recent)) < CHANGE * np.abs(recent[:-1])))


def make_demonstrations(request: DemonstrationRequest, indices: range) -> None:
    """Make some of the demonstrations of a request, in a worker process."""
    generator = DemonstrationGenerator(request)
    for k in indices:
        generator.make(k)
