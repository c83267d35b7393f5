"""Laws and a loss of rollouts in several tests, and the comparison of its gradient with differences."""

import numpy as np

import mpm
from mpm.rollout.losses import Loss, LossGradient, RolloutStates

STRIDE = 1.0  # [s]: as long as a rollout's step and the grains' travel allow, in fluids too
LAWS = {"fluid": mpm.NewtonianFluid(bulk_modulus=2e5, density=1000.0, viscosity=0.5),
        "clay": mpm.VonMises(E=2e5, nu=0.3, density=1500.0, yield_stress=2e3),
        "elastic": mpm.Elastic(E=2e5, nu=0.3, density=1000.0),
        "sand": mpm.DruckerPrager(E=1.5e5, nu=0.2, density=1500.0, friction_angle_deg=30.0)}


def weighted_ends(n: int, at: int) -> Loss:
    """Random weights on positions and velocities after step `at`."""
    rng = np.random.default_rng(n)
    W, U = rng.standard_normal((n, 3)), 1e-3 * rng.standard_normal((n, 3))

    def loss(states: RolloutStates) -> LossGradient:
        here = (states.steps == at)[:, None, None]
        return LossGradient(float(np.sum(here * (W * states.x + U * states.v))), x=here * W, v=here * U)

    return loss


def along_directions(roll: mpm.Rollout, linear: np.ndarray, angular: np.ndarray, loss: Loss, gradient: tuple,
                     directions: int, h: float = 1e-7) -> tuple[np.ndarray, np.ndarray]:
    """Slopes of the loss (directions,) along random changes of the twists, by the gradient and by differences."""
    rng, pairs = np.random.default_rng(0), []
    for _ in range(directions):
        way = rng.standard_normal(linear.shape), 20.0 * rng.standard_normal(linear.shape)
        ends = [roll.value(linear + s * way[0], angular + s * way[1], loss) for s in (h, -h)]
        pairs.append((np.sum(gradient[0] * way[0]) + np.sum(gradient[1] * way[1]), (ends[0] - ends[1]) / (2 * h)))
    return np.array(pairs).T


def cosine_of(one: np.ndarray, other: np.ndarray) -> float:
    return one @ other / np.linalg.norm(one) / np.linalg.norm(other)
