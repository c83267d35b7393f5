"""The gradient through a stiffness that follows the density, against central differences of the state at the begin."""

import numpy as np
import pytest
from end_loss import LAWS, STRIDE, weighted_ends

import mpm

CELL, STEPS = 0.01, 4


@pytest.mark.long
def test_gradient_by_the_state_at_the_begin() -> None:
    """A loose block that is squeezed fast, so that every stride finds another density; half of it begins softer than
    it is dense, half stiffer. A direction changes all that a particle has."""
    x = mpm.sample_box((0.03, 0.03, 0.03), (0.06, 0.06, 0.06), 0.72 * CELL, np.random.default_rng(0))
    sand = LAWS["sand"]
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.09, 0.09, 0.09), CELL), precision="f64", transfer_interval=STRIDE,
                        bodies=[mpm.Body(sand, x, volume=(0.72 * CELL) ** 3)])
    roll = mpm.Rollout(solver, STEPS, step_dt=2 * solver.dt)
    start, rng = solver.state(), np.random.default_rng(1)
    start["v"] = -60.0 * (x - 0.045)
    start["e"] = np.tile([-4e-3, -4e-3, -6e-3, 1e-3, 0.0, 0.0], (len(x), 1)) * rng.uniform(0.8, 1.2, (len(x), 1))
    start["around"] = start["noted"] * np.where(np.arange(len(x)) % 2, 0.7, 1.3)[:, None]
    loss = weighted_ends(len(x), STEPS)

    def value(state: dict[str, np.ndarray]) -> float:
        solver.load(state)
        roll.restart()
        return roll.value(None, None, loss)

    value(start)
    roll.value_and_grad(None, None, loss)
    bars = roll._kernel.bars
    found = {name: solver.particles.unpack(bars.packs.read(fields)) for name, fields in bars.named_fields().items()}
    end = solver.state()
    assert (np.abs(end["noted"] / start["noted"] - 1) > 0.1).mean() > 0.3
    assert np.abs(found["around"]).max() > 0 and np.abs(found["noted"]).max() > 0
    for names in (("x",), ("v", "e"), ("noted",), ("around",)):
        way = {name: rng.standard_normal(start[name].shape) * np.abs(start[name]).max() for name in names}
        ends = [value(start | {name: start[name] + 1e-6 * s * way[name] for name in names}) for s in (1, -1)]
        slope = sum(np.sum(found[name] * way[name]) for name in names)
        assert slope == pytest.approx((ends[0] - ends[1]) / 2e-6, rel=1e-4), names
