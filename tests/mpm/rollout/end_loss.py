"""A loss of rollouts in several tests."""

import numpy as np

from mpm.rollout.losses import Loss, LossGradient, RolloutStates


def weighted_ends(n: int, at: int) -> Loss:
    """Random weights on positions and velocities after step `at`."""
    rng = np.random.default_rng(n)
    W, U = rng.standard_normal((n, 3)), 1e-3 * rng.standard_normal((n, 3))

    def loss(states: RolloutStates) -> LossGradient:
        here = (states.steps == at)[:, None, None]
        return LossGradient(float(np.sum(here * (W * states.x + U * states.v))), x=here * W, v=here * U)

    return loss
