"""Grains at thin shells: what flows over a rim falls, and lanes without a grain have no side."""

import numpy as np
import pytest
import trimesh
from field_parts import at

import mpm
from mpm.state.packs import LANES

CELL, RADIUS = 0.006, 0.03
SALT = mpm.DruckerPrager(E=1.5e5, nu=0.2, density=1217.0, friction_angle_deg=33.0)


def bowl() -> mpm.Shell:
    ball = trimesh.creation.icosphere(3, RADIUS)
    return mpm.Shell.from_mesh(trimesh.Trimesh(ball.vertices, ball.faces[ball.triangles_center[:, 2] < 0]), 1.5e-3)


def filled(pose: mpm.Pose, leave_out: int = 0) -> mpm.Solver:
    spacing = CELL / 2 ** (1 / 3)
    grains = mpm.sample_box((-RADIUS,) * 3, (RADIUS, RADIUS, 0.0), spacing, np.random.default_rng(0))
    grains = grains[np.linalg.norm(grains, axis=1) < RADIUS - 0.6 * spacing]
    grains = grains[: len(grains) // LANES * LANES - leave_out]
    return mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.24, 0.16, 0.18), CELL), walls=mpm.Walls(friction=0.5),
                      bodies=[mpm.Body(SALT, pose.apply(grains), volume=spacing**3)],
                      colliders=[mpm.Collider(bowl(), friction=0.3, pose=pose)])


@pytest.mark.long
def test_what_flows_over_a_rim_falls() -> None:
    """A bowl is tilted by 110 deg in 1 s: no grain is ever faster than by its fall from the highest place of the rim,
    and by the motion of that rim."""
    start = at(0.1, 0.08, 0.11)
    with filled(start) as solver:
        pose, rate, step, most = start, np.radians(110.0), 4e-3, 0.0
        for k in range(350):
            half = 0.5 * min(rate * step * (k + 1), np.radians(110.0))
            end = mpm.Pose(start.position, np.array([np.cos(half), 0.0, np.sin(half), 0.0]))
            solver.set_collider_motion(0, pose, end)
            solver.advance(step)
            pose = end
            speed = np.linalg.norm(solver.state()["v"], axis=1)
            fall = np.maximum(start.position[2] + RADIUS - solver.positions()[:, 2], 0.0)
            most = max(most, float((speed - np.sqrt(2.0 * 9.81 * fall)).max()))
        assert (solver.positions()[:, 2] < 0.05).mean() > 0.9  # it has poured
        assert most < 1.1 * rate * RADIUS


@pytest.mark.long
def test_lanes_without_a_grain_have_no_side() -> None:
    """They would be listed, and gather from nodes without mass; also after a state was loaded, in which they repeat the
    last grain."""
    with filled(at(0.1, 0.08, 0.11), leave_out=LANES - 1) as solver:
        for _ in range(2):
            solver.advance(0.02)
            state = solver.state()
            assert state["side"][-1] != 0 and solver.fields.shells is not None
            assert solver.fields.shells.count[None] == np.count_nonzero(state["side"])
            solver.load(state)
