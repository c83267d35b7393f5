"""Action = reaction between grains and bodies of a MuJoCo scene."""

import mujoco
import numpy as np
import pytest

import mpm
from robosim import GranularPlugin

BOX = """
<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body name="box" pos="0.06 0.06 0.075" quat="0.98 0.12 0.05 0">
      <freejoint/>
      <geom type="box" size="0.02 0.02 0.02" mass="0.2" contype="0" conaffinity="0"/>
    </body>
  </worldbody>
</mujoco>
"""
CELL = 0.008


def tray(coupling: str = "lagged") -> GranularPlugin:
    """A free box just above a tray of sand."""
    model = mujoco.MjModel.from_xml_string(BOX)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    sand = mpm.DruckerPrager(E=1.5e5, nu=0.2, density=1500.0, friction_angle_deg=30.0)
    positions = mpm.sample_box((0, 0, 0), (0.12, 0.12, 0.032), CELL / 2, np.random.default_rng(0))
    pose = mpm.Pose(data.xpos[1].copy(), data.xquat[1].copy())
    solver = mpm.Solver(
        grid=mpm.Grid((0, 0, 0), (0.12, 0.12, 0.12), CELL),
        bodies=[mpm.Body(sand, positions, volume=0.12 * 0.12 * 0.032 / len(positions))],
        colliders=[mpm.Collider(mpm.Sdf.box((0.02, 0.02, 0.02)), friction=0.3, pose=pose)],
        walls=mpm.Walls(friction=0.5),
    )
    return GranularPlugin(model, data, solver, bodies={"box": 0}, coupling=coupling)


def test_box_comes_to_rest_on_its_weight_and_the_ledger_closes() -> None:
    plugin = tray()
    residual, exchanged, reaction = np.zeros(6), np.zeros(2), []
    for step in range(350):
        before = plugin.data.qvel[:3].copy()
        plugin.step()
        on_grains = plugin.ledger.bodies["box"]
        # the box loses the momentum that the grains gain, besides its own weight, in every step
        change = 0.2 * (plugin.data.qvel[:3] - before) - 0.2 * plugin.model.opt.gravity * 0.002
        assert change == pytest.approx(-on_grains.linear, abs=1e-9)
        residual += np.concatenate(plugin.ledger.residual)
        exchanged += plugin.ledger.exchanged
        if step >= 250:
            reaction.append(plugin.wrench("box").force)
    assert np.linalg.norm(residual[:3]) <= 1e-5 * exchanged[0]
    assert np.linalg.norm(residual[3:]) <= 1e-5 * exchanged[1]
    assert np.mean(reaction, axis=0) == pytest.approx([0, 0, 0.2 * 9.81], abs=0.02 * 0.2 * 9.81)
    assert np.linalg.norm(plugin.data.qvel[:3]) < 0.01


def test_the_users_forces_are_kept() -> None:
    plugin = tray()
    own = np.array([0.0, 0.0, 0.2 * 9.81, 0.0, 0.0, 0.0])
    plugin.data.xfrc_applied[1] = own
    for _ in range(5):
        plugin.step()
    assert np.abs(plugin.data.qvel).max() < 1e-9  # the user's force carries the weight; the box is still above the sand
    plugin.data.qpos[2] = 0.052  # into the sand
    plugin.step()
    assert np.linalg.norm(plugin.wrench("box").force) > 0.01
    assert (plugin.data.xfrc_applied[1] == own).all()


def test_one_way_coupling_applies_nothing_to_the_body() -> None:
    plugin = tray("one_way")
    for _ in range(50):
        plugin.step()
    # free fall of the symplectic Euler rule, right through the sand
    n, h = 50, 0.002
    assert plugin.data.qpos[2] == pytest.approx(0.075 - 9.81 * h * h * n * (n + 1) / 2, abs=1e-9)
