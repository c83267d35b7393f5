"""The spoon's wall retains its grains, and the force on it is their weight."""

import numpy as np
import pytest

import mpm
from robosim.scene.field import build_tool_sdf

CELL = 0.005
BOWL = np.array([0.035, 0.025, 0.030])
"""Half axes [m] of the spoon's cavity."""


def filled_spoon(offset: np.ndarray) -> tuple[mpm.Solver, mpm.Pose]:
    pose = mpm.Pose(np.array([0.1, 0.1, 0.1]) + offset, np.array([1.0, 0, 0, 0]))
    lattice = mpm.sample_box(-BOWL, [BOWL[0], BOWL[1], 0.0], CELL / 2, np.random.default_rng(0))
    inside = lattice[(((lattice / (BOWL - 1e-3)) ** 2).sum(1) < 1.0) & (lattice[:, 2] < -0.008)]
    salt = mpm.DruckerPrager(E=1.5e5, nu=0.2, density=1217.0, friction_angle_deg=33.0)
    return mpm.Solver(
        grid=mpm.Grid((0, 0, 0), (0.22, 0.2, 0.2), CELL),
        bodies=[mpm.Body(salt, pose.apply(inside), volume=(CELL / 2) ** 3)],
        colliders=[mpm.Collider(build_tool_sdf("spoon", 0.0025), friction=0.1, pose=pose)]), pose


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (1, 2))])
def test_no_grain_leaks_at_rest_or_shaken(seed: int) -> None:
    """At rest for 0.2 s, then shaken by 3 mm at 8 Hz: every grain stays in the bowl; at rest the load is the weight."""
    offset = np.random.default_rng(seed).uniform(-CELL, CELL, 3)
    solver, start = filled_spoon(offset)
    weight = solver.masses().sum() * 9.81
    pose, forces = start, []
    for step in range(250):
        t = 2e-3 * (step + 1)
        shift = 0.003 * np.sin(2 * np.pi * 8 * max(t - 0.2, 0.0))
        end = mpm.Pose(start.position + [shift, 0, 0], start.quaternion)
        solver.set_collider_motion(0, pose, end)
        solver.advance(2e-3)
        pose = end
        if 50 <= step < 100:
            forces.append(-solver.collider_impulse(0).force / 2e-3)
    local = pose.inverse().apply(solver.positions())
    assert local[:, 2].max() < 0.01  # none passed over the rim, so one outside leaked through the wall
    assert ((local / (BOWL + 0.002)) ** 2).sum(1)[local[:, 2] < 0].max() < 1.0
    assert np.mean(forces, axis=0) == pytest.approx([0, 0, weight], abs=0.01 * weight)
