"""Rollouts with a tool that is a shell, against central differences in double precision."""

import numpy as np
import pytest
import trimesh
from end_loss import LAWS, STRIDE, along_directions, cosine_of, weighted_ends
from field_parts import at

import mpm
from mpm.materials.material import Material

CELL, SUBSTEPS = 0.01, 5


def bowl_scene(law: Material, interval: float) -> mpm.Solver:
    """A shell in the shape of a bowl that holds grains and dips into others, so that both of its sides are met."""
    spacing, rng = CELL / 2, np.random.default_rng(0)
    ball = trimesh.creation.icosphere(3, 0.03)
    sheet = trimesh.Trimesh(ball.vertices, ball.faces[ball.triangles_center[:, 2] < 0])
    sheet.invert()
    pose = at(0.0713, 0.0609, 0.0557)
    held = mpm.sample_box((-0.03, -0.03, -0.03), (0.03, 0.03, 0.004), spacing, rng)
    held = pose.apply(held[np.linalg.norm(held, axis=1) < 0.027])
    below = mpm.sample_box((0.02, 0.02, 0.0), (0.1, 0.1, 0.02), spacing, rng)
    bowl = mpm.Collider(mpm.Shell.from_mesh(sheet, 2e-3, spacing=2.3e-3), friction=0.3, pose=pose)
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.14, 0.12, 0.12), CELL), precision="f64", colliders=[bowl],
                        bodies=[mpm.Body(law, np.concatenate([held, below]), volume=spacing**3)],
                        walls=mpm.Walls(friction=0.4), transfer_interval=interval)
    solver.advance(0.02)
    return solver


@pytest.mark.slow
@pytest.mark.parametrize(("name", "interval"), [("sand", STRIDE), ("elastic", 0.0), ("fluid", STRIDE)])
def test_gradient_by_the_motion_of_a_shell(name: str, interval: float) -> None:
    """Six steps with contact on both of its sides, in single substeps and in strides."""
    solver, steps = bowl_scene(LAWS[name], interval), 6
    sides = solver.state()["side"]
    assert (sides > 0).sum() > 100 and (sides < 0).sum() > 100
    roll = mpm.Rollout(solver, steps, step_dt=SUBSTEPS * solver.dt)
    linear, angular = np.tile([0.25, 0.02, -0.1], (steps, 1)), np.tile([0.3, 2.0, 0.5], (steps, 1))
    loss = weighted_ends(len(solver.masses()), steps)
    value, found = roll.value_and_grad(linear, angular, loss)
    assert value == roll.value(linear, angular, loss)
    gradient, difference = along_directions(roll, linear, angular, loss, found, 8)
    assert cosine_of(gradient, difference) > 1.0 - 1e-9
    assert np.linalg.norm(gradient) == pytest.approx(np.linalg.norm(difference), rel=1e-5)
