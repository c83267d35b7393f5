"""Gradient descent with momentum, and a step size that all entries of a column share.

Adam (Kingma & Ba 2015) divides each entry by its own size, so that the last actions of a motion change as fast as the
first; a tool then overshoots, and grains that it has pushed too far cannot be pulled back. Here all actions along one
axis share one size. After a run of failures the search returns to the best motion with a smaller step. Where that fails
too, the gradient at the best motion does not describe its neighbourhood (contact has kinks), and the search continues
from a random motion near it, which differs along one axis, and by more each time: a level tool that waits above its
target is at a minimum of its loss, and pours once it is tilted far enough."""

from typing import ClassVar

import numpy as np

import mpm
from policies.demonstrations.spline_search import sample_spline
from robosim.base.input_files import MAX_NUMBER

DECAY, DECAY_SQUARES, SMALL = 0.9, 0.95, 1e-12
FAILURES, SHRINK, GROW, LEAST = 4, 0.7, 1.1, 0.1
"""Iterations without a lower loss before a return to the best; factor on the step then, and after a success; smallest
step as a share of the rate."""
KNOTS = 3
"""Knots of the random smooth motion along an axis: few, so that it turns a tool one way and not to and fro."""
BOUNDS = {"now": (-1.0, 1.0), "best": (-1.0, 1.0), "lowest": (-np.inf, np.inf), "share": (0.0, 1.0),
          **dict.fromkeys(("failures", "returns", "count"), (0, 10**9)), "square": (0.0, MAX_NUMBER)}
"""Attributes -> their least and largest numbers; of the others, those whose squares a float holds."""
STATE = ("now", "best", "best_gradient", "lowest", "share", "failures", "returns", "count", "mean", "square")
"""Attributes that the next steps depend on."""


class Descent:
    """A search over parameters (n, k) within -1 and 1, with steps of at most about `rate`.
    The first `fixed` rows are not changed."""

    uses_gradient: ClassVar[bool] = True
    check_every: ClassVar[int] = 5

    def __init__(self, parameters: np.ndarray, rate: float, fixed: int = 0) -> None:
        self.now, self.rate, self._fixed = parameters.copy(), rate, fixed
        self.best, self.best_gradient, self.lowest = parameters.copy(), np.zeros_like(parameters), np.inf
        self.share, self.failures, self.returns = 1.0, 0, 0
        """Step as a share of the rate; iterations since the last success; returns to the present best."""
        self._reset_momentum()

    def _reset_momentum(self) -> None:
        self.count = 0
        self.mean, self.square = np.zeros_like(self.now), np.zeros_like(self.now)

    def step(self, loss: float, gradient: np.ndarray | None = None) -> None:
        """Take the loss and its derivatives (n, k) at `now`, and set the next `now`."""
        assert gradient is not None
        if loss < self.lowest:
            self.lowest, self.best, self.best_gradient = loss, self.now.copy(), gradient.copy()
            self.failures, self.returns, self.share = 0, 0, min(1.0, GROW * self.share)
        else:
            self.failures += 1
        if self.failures < FAILURES:
            self._move(gradient)
        else:
            self.return_to_best()

    def return_to_best(self) -> None:
        """Continue from the best parameters with a smaller step; from the second return on from a random neighbour,
        which differs along the next axis by as many of the largest steps as there were returns."""
        self.now = self.best.copy()
        self.failures, self.share, self.returns = 0, max(LEAST, SHRINK * self.share), self.returns + 1
        self._reset_momentum()
        if self.returns == 1:
            self._move(self.best_gradient)
        else:
            knots, axis = np.zeros((KNOTS, self.now.shape[1])), self.returns % self.now.shape[1]
            knots[:, axis] = np.random.default_rng(self.returns).normal(0.0, self.returns * self.rate, KNOTS)
            offset = sample_spline(knots, len(self.now) - self._fixed)
            self.now[self._fixed :] = np.clip(self.now[self._fixed :] + offset, -1.0, 1.0)

    def _move(self, gradient: np.ndarray) -> None:
        gradient = np.where(np.arange(len(gradient))[:, None] < self._fixed, 0.0, gradient)
        squares = np.broadcast_to((gradient[self._fixed :] ** 2).mean(0), gradient.shape)
        self.count += 1
        self.mean += (1.0 - DECAY) * (gradient - self.mean)
        self.square += (1.0 - DECAY_SQUARES) * (squares - self.square)
        mean = self.mean / (1.0 - DECAY**self.count)
        square = self.square / (1.0 - DECAY_SQUARES**self.count)
        self.now = np.clip(self.now - self.rate * self.share * mean / (np.sqrt(square) + SMALL), -1.0, 1.0)

    def fail(self) -> None:
        """Return to the best parameters: `now` has no loss."""
        self.return_to_best()

    def convergence_losses(self, losses: list[float]) -> list[float]:
        """Return all losses."""
        return losses

    def state(self) -> dict[str, np.ndarray]:
        """Return what the next steps depend on."""
        return {name: np.asarray(getattr(self, name)) for name in STATE}

    def load(self, state: dict[str, np.ndarray]) -> None:
        """Restore a state; raises mpm.InvalidValue for one of another search, or with numbers that no search has."""
        for name in STATE:
            value = state.get(name, np.zeros((), int))  # the first files have no `returns`
            least, most = BOUNDS.get(name, (-MAX_NUMBER, MAX_NUMBER))
            if value.shape != np.shape(getattr(self, name)) or value.dtype.kind not in "iuf" \
                    or not ((least <= value) & (value <= most)).all():
                raise mpm.InvalidValue(f"{name} has shape {value.shape} of type {value.dtype}; accepted: shape "
                                       f"{np.shape(getattr(self, name))}, numbers from {least:g} to {most:g}")
            setattr(self, name, value.astype(float) if value.ndim else value.item())
