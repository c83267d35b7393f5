"""Materials found again by gradient, from where the grains of a simulated collapse come to lie."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

import mpm
from mpm.rollout.losses import LossGradient, RolloutStates

STEPS = 150


def collapse(law) -> mpm.Solver:
    """A block of 6 x 6 x 8 cm let go on a rough floor."""
    spacing = 0.005
    places = mpm.sample_box((0.05, 0.05, 0.0), (0.11, 0.11, 0.08), spacing, np.random.default_rng(0))
    body = mpm.Body(law, places, volume=spacing**3)
    return mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.16, 0.16, 0.12), 0.01), bodies=[body],
                      walls=mpm.Walls(friction=0.5), dt=2e-4)


def features(x: np.ndarray) -> np.ndarray:
    """Mean height [m] and spread [m] (3,) along each axis of positions (n, 3)."""
    return np.array([x[:, 2].mean(), *x.std(0)])


@pytest.mark.slow
@pytest.mark.parametrize("law, name, guess, bound", [
    (mpm.DruckerPrager(E=1.5e5, nu=0.2, density=1500.0, friction_angle_deg=35.0), "friction_angle_deg", 25.0,
     0.01),
    (mpm.NewtonianFluid(bulk_modulus=1.5e5, density=1000.0, viscosity=2.0), "viscosity", 5.0, 0.002),
])
def test_a_number_is_found_again(law, name, guess, bound):
    """Friction angle within 0.01 degrees, viscosity within 0.1 %: what the page of gradients claims."""
    truth = collapse(law)
    for _ in range(STEPS):
        truth.advance(0.002)
    wanted = features(truth.positions())

    def loss(states: RolloutStates) -> LossGradient:
        value, bar = 0.0, np.zeros(states.x.shape)
        for k in np.flatnonzero(states.steps == STEPS):
            x = states.x[k]
            off = 1e3 * (features(x) - wanted)
            value += float(off @ off)
            bar[k, :, 2] += 2e3 * off[0] / len(x)
            bar[k] += 2e3 * off[1:] * (x - x.mean(0)) / (len(x) * x.std(0))
        return LossGradient(value, x=bar)

    solver = collapse(replace(law, **{name: guess}))
    roll = mpm.Rollout(solver, STEPS, materials=True)

    def value_and_slope(logarithm: np.ndarray) -> tuple[float, np.ndarray]:
        number = float(np.exp(logarithm[0]))
        solver.set_material(0, replace(law, **{name: number}))
        value, _ = roll.value_and_grad(None, None, loss)
        return value, np.array([roll.last.materials[0][name] * number])

    found = minimize(value_and_slope, [np.log(guess)], jac=True, method="L-BFGS-B",
                     bounds=[(np.log(0.3 * guess), np.log(3.0 * guess))], options={"maxiter": 20})
    assert np.exp(found.x[0]) == pytest.approx(getattr(law, name), abs=bound)
