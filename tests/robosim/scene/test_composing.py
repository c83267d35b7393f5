"""Containers and pictures for scenes of one's own."""

import mujoco
import numpy as np
import pytest

import mpm
import robosim

SALT = mpm.DruckerPrager(E=1e5, nu=0.2, density=1200.0, friction_angle_deg=33.0)


@pytest.fixture(scope="module")
def jar() -> robosim.Container:
    return robosim.Container("jar", radius=0.04, height=0.06, wall=0.003, position=(0.1, 0.1, 0.02), yaw_deg=30.0)


@pytest.mark.long
def test_a_filled_container_holds_its_grains_at_rest(jar: robosim.Container) -> None:
    """The volume of a cylinder, all grains counted in it, and nearly no motion: their weight is on the floor."""
    assert jar.volume == pytest.approx(np.pi * 0.04**2 * 0.06, rel=0.01)
    body = jar.fill(SALT, 0.03, 4e-3)
    assert len(body.positions) * body.volume == pytest.approx(np.pi * 0.04**2 * 0.03, rel=0.03)
    grid = mpm.Grid((0.0, 0.0, 0.0), (0.2, 0.2, 0.12), 0.008)
    with mpm.Solver(grid=grid, bodies=[body], colliders=[jar.collider(0.008)]) as solver:
        before = solver.positions()
        solver.advance(0.1)
        after = solver.positions()
        assert jar.holds(after).all() and not jar.holds(after + [0.1, 0.0, 0.0]).any()
        assert np.abs(after.mean(0) - before.mean(0)).max() < 1.5e-3
        push = solver.collider_impulse(0).force[2]
        assert push == pytest.approx(-solver.masses().sum() * 9.81 * 0.1, rel=0.1)


@pytest.mark.slow
def test_grains_are_drawn_where_they_are(jar: robosim.Container) -> None:
    """The picture changes where grains are, and only there."""
    spec = mujoco.MjSpec()
    spec.worldbody.add_light(pos=(0.1, 0.1, 1.0))
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=(0.5, 0.5, 0.1), rgba=(0.2, 0.2, 0.25, 1.0))
    jar.add_to(spec)
    data = mujoco.MjData(spec.compile())
    mujoco.mj_forward(data.model, data)
    grid = mpm.Grid((0.0, 0.0, 0.0), (0.2, 0.2, 0.12), 0.008)
    camera = mujoco.MjvCamera()
    camera.lookat[:], camera.distance, camera.elevation = (0.1, 0.1, 0.03), 0.4, -60.0
    pictures = []
    for height in (0.01, 0.05):
        with mpm.Solver(grid=grid, bodies=[jar.fill(SALT, height, 4e-3)]) as solver, \
                robosim.GrainRenderer(spec, solver, width=320, height=240) as renderer:
            pictures.append(renderer.draw(data, camera).astype(int))
    changed = np.abs(pictures[1] - pictures[0]).sum(2) > 60
    rows, columns = np.nonzero(changed)
    assert 500 < len(rows) < 0.4 * changed.size
    assert abs(columns.mean() - 160) < 15 and pictures[1][changed].mean() > pictures[0][changed].mean()
