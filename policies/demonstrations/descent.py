"""Descent with momentum and a step that a whole column of the parameters shares.

Adam (Kingma & Ba 2015) divides each entry by its own size, so that the last of a motion's actions move as fast as the
first, and a tool that has learnt to go overshoots for good: grains that it has pushed too far cannot be pulled back.
Here all actions along one axis share one size, and a run of failures goes back to the best and takes smaller steps.
Where that leads nowhere either, the slope at the best is not that of what lies around it (contact has kinks): the next
one is taken a little aside.
"""

import numpy as np

from policies.demonstrations.spline_search import motion

DECAY, DECAY_SQUARES, SMALL = 0.9, 0.95, 1e-12
FAILURES, SHRINK, GROW, LEAST = 4, 0.7, 1.1, 0.1
"""Iterations without a better loss before a return to the best, what becomes of the step then and after success, and
how small it may get."""
KNOTS = 8
"""Of the smooth motion that leads aside; its actions are as large as a step at its largest."""


class Descent:
    """Parameters (n, k) and steps of at most about `rate`; `step` is told what the loss was and how it slopes. The
    first `kept` rows stay as they are."""

    def __init__(self, parameters: np.ndarray, rate: float, kept: int = 0) -> None:
        self.now, self.rate, self._kept = parameters.copy(), rate, kept
        self.best, self.best_gradient, self.lowest = parameters.copy(), np.zeros_like(parameters), np.inf
        self.share, self.failures, self.returns = 1.0, 0, 0
        """returns: to the same best."""
        self._forget()

    def _forget(self) -> None:
        self.count = 0
        self.mean, self.square = np.zeros_like(self.now), np.zeros_like(self.now)

    def step(self, loss: float, gradient: np.ndarray) -> None:
        """Take the loss and its derivatives at `now`, and move on; entries stay within -1 and 1."""
        if loss < self.lowest:
            self.lowest, self.best, self.best_gradient = loss, self.now.copy(), gradient.copy()
            self.failures, self.returns, self.share = 0, 0, min(1.0, GROW * self.share)
        else:
            self.failures += 1
        if self.failures < FAILURES:
            self._move(gradient)
        else:
            self.go_back()

    def go_back(self) -> None:
        """Return to the best parameters, and leave them with a smaller step, or from the second time on for somewhere
        near."""
        self.now = self.best.copy()
        self.failures, self.share, self.returns = 0, max(LEAST, SHRINK * self.share), self.returns + 1
        self._forget()
        if self.returns == 1:
            self._move(self.best_gradient)
        else:
            aside = motion(np.random.default_rng(self.returns).normal(0.0, self.rate, (KNOTS, self.now.shape[1])),
                           len(self.now) - self._kept)
            self.now[self._kept :] = np.clip(self.now[self._kept :] + aside, -1.0, 1.0)

    def _move(self, gradient: np.ndarray) -> None:
        gradient = np.where(np.arange(len(gradient))[:, None] < self._kept, 0.0, gradient)
        squares = np.broadcast_to((gradient[self._kept :] ** 2).mean(0), gradient.shape)
        self.count += 1
        self.mean += (1.0 - DECAY) * (gradient - self.mean)
        self.square += (1.0 - DECAY_SQUARES) * (squares - self.square)
        mean = self.mean / (1.0 - DECAY**self.count)
        square = self.square / (1.0 - DECAY_SQUARES**self.count)
        self.now = np.clip(self.now - self.rate * self.share * mean / (np.sqrt(square) + SMALL), -1.0, 1.0)

    def fail(self) -> None:
        """`now` has no loss."""
        self.go_back()

    def course(self, losses: list[float]) -> list[float]:
        """What has to settle: the losses themselves."""
        return losses

    def state(self) -> dict[str, np.ndarray]:
        """What the next steps depend on."""
        return {name: np.asarray(getattr(self, name)) for name in STATE}

    def load(self, state: dict[str, np.ndarray]) -> None:
        """Return to a state."""
        for name in STATE:
            value = state.get(name, np.zeros((), int))  # `returns` is younger than some files
            setattr(self, name, value.copy() if value.ndim else value.item())


STATE = ("now", "best", "best_gradient", "lowest", "share", "failures", "returns", "count", "mean", "square")
