"""User scenes: plain MJCF, coupled in a few lines; action = reaction between grains and bodies."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from trays import tray
from written_arms import write_arm

import mpm
from robosim import ConfigError, GranularPlugin, UnknownName
from robosim.base.errors import BodyLeftGrid, RobotDiverged
from robosim.coupling.mobility_probe import MobilityProbe
from robosim.coupling.trial_step import TrialStep
from robosim.robot.mjspec import body_pose

BOXES = """
<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <body name="light" pos="0.05 0.05 0.085"><freejoint/>
      <geom type="box" size="0.015 0.015 0.015" density="500" friction="0.4"/></body>
    <body name="middle" pos="0.13 0.05 0.085" quat="0.99 0.05 0.1 0"><freejoint/>
      <geom type="box" size="0.015 0.015 0.015" density="8000" friction="0.4"/></body>
    <body name="heavy" pos="0.21 0.05 0.085"><freejoint/>
      <geom type="box" size="0.015 0.015 0.015" density="19000" friction="0.4"/></body>
  </worldbody>
</mujoco>
"""
NAMES = ("light", "middle", "heavy")


BOX = """
<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body name="box" pos="0.06 0.06 0.075" quat="0.98 0.12 0.05 0"><freejoint/>
      <geom type="box" size="0.02 0.02 0.02" mass="0.2" friction="0.3"/></body>
  </worldbody>
</mujoco>
"""


def box(coupling: str = "lagged") -> GranularPlugin:
    """A free box just above a tray of sand."""
    return tray(BOX, (0.12, 0.12, 0.03), bodies={"box": None}, coupling=coupling)


def test_box_comes_to_rest_on_its_weight_and_the_ledger_closes() -> None:
    plugin = box()
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
    plugin = box()
    own = np.array([0.0, 0.0, 0.2 * 9.81, 0.0, 0.0, 0.0])
    plugin.data.xfrc_applied[1] = own
    for _ in range(5):
        plugin.step()
    assert np.abs(plugin.data.qvel).max() < 1e-9  # the user's force carries the weight; the box is still above the sand
    plugin.data.qpos[2] = 0.05  # into the sand
    plugin.step()
    assert np.linalg.norm(plugin.wrench("box").force) > 0.01
    assert (plugin.data.xfrc_applied[1] == own).all()


def test_one_way_coupling_applies_nothing_to_the_body() -> None:
    plugin = box("one_way")
    for _ in range(50):
        plugin.step()
    # free fall of the symplectic Euler rule, right through the sand
    n, h = 50, 0.002
    assert plugin.data.qpos[2] == pytest.approx(0.075 - 9.81 * h * h * n * (n + 1) / 2, abs=1e-9)


@pytest.mark.slow
def test_boxes_sink_in_the_order_of_their_density_and_rest_on_their_weight() -> None:
    plugin = tray(BOXES, (0.26, 0.1, 0.06), bodies=dict.fromkeys(NAMES))
    model, data = plugin.model, plugin.data
    forces, residual, exchanged = [], np.zeros(6), np.zeros(2)
    for step in range(500):
        plugin.step()
        residual += np.concatenate(plugin.ledger.residual)
        exchanged += plugin.ledger.exchanged
        if step >= 350:
            forces.append([plugin.wrench(name).force for name in NAMES])
    heights = [data.body(name).xpos[2] for name in NAMES]
    assert heights[0] > heights[1] > heights[2] + 0.005
    weights = model.body_mass[1:] * 9.81
    assert np.mean(forces, axis=0)[:, 2] == pytest.approx(weights, rel=0.02)
    assert np.abs(np.mean(forces, axis=0)[:, :2]).max() < 0.02 * weights.max()
    assert np.abs(data.qvel).reshape(3, 6)[:, :3].max() < 5e-3
    assert np.linalg.norm(residual[:3]) <= 1e-5 * exchanged[0]
    assert np.linalg.norm(residual[3:]) <= 1e-5 * exchanged[1]


EVERY_GEOM = """
<mujoco>
  <asset>
    <hfield name="ground" nrow="8" ncol="8" size="0.05 0.05 0.01 0.01"/>
    <mesh name="wedge" vertex="0 0 0  0.03 0 0  0 0.03 0  0 0 0.03"/>
  </asset>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 0.1"/>
    <body name="ground" pos="0.1 0.05 0.02"><geom type="hfield" hfield="ground"/></body>
    <body name="stack" pos="0.05 0.05 0.08"><freejoint/>
      <geom type="sphere" size="0.01"/><geom type="capsule" size="0.005 0.01" pos="0.01 0 0"/>
      <geom type="ellipsoid" size="0.01 0.02 0.005" pos="0 0 0.01"/>
      <geom type="cylinder" size="0.01 0.005" pos="0 0.01 0"/>
      <geom type="box" size="0.02 0.005 0.005" contype="0" conaffinity="0" pos="0 0 0.5"/>
      <body name="tip" pos="0 0 -0.02"><geom type="mesh" mesh="wedge"/></body></body>
  </worldbody>
</mujoco>
"""


@pytest.mark.long
@pytest.mark.filterwarnings("ignore::mpm.errors.GrainsInSolid")  # it is the colliders that count
def test_every_kind_of_geom_becomes_a_collider() -> None:
    """Distances of the union equal those of its parts: visual geoms are left out, bodies fixed to it are included."""
    plugin = tray(EVERY_GEOM, bodies={"stack": None, "ground": None, "world": None})
    model, data = plugin.model, plugin.data
    stack, ground, world = (plugin.solver.colliders[i] for i in range(3))
    assert (stack.mobile, ground.static, world.static) == (True, True, True)
    assert stack.sdf.distance(np.zeros((1, 3)))[0] == pytest.approx(-0.01)  # the sphere's middle
    assert stack.sdf.distance(np.array([[0.0, 0.0, 0.5]]))[0] > 0.4
    tip = data.geom_xpos[model.ngeom - 1] - data.body("stack").xpos
    assert stack.sdf.distance(tip[None])[0] < 0  # the mesh's centre of mass
    assert ground.sdf.distance(np.array([[0.0, 0.0, -0.001]]))[0] < 0
    assert world.sdf.distance(np.array([[0.3, 0.2, -0.001]]))[0] == pytest.approx(-0.001)
    for _ in range(5):
        plugin.step()


@pytest.mark.long
def test_without_contact_the_step_is_mujocos_own() -> None:
    """Bit for bit, with any integrator: a coupled body without contact moves as without coupling."""
    for integrator in ("Euler", "RK4", "discrete"):
        plugin = tray(BOXES.replace("<option", f'<option integrator="{integrator}"'), bodies={"light": None})
        plain, data = mujoco.MjData(plugin.model), plugin.data
        for d in (plain, data):
            d.qvel[:] = np.linspace(-0.5, 0.5, plugin.model.nv)
        for _ in range(10):
            mujoco.mj_step(plugin.model, plain)
            plugin.step()
        assert (data.qpos == plain.qpos).all()
        assert (data.qvel == plain.qvel).all()
        plugin.solver.close()  # the next one compiles nothing


@pytest.mark.long
@pytest.mark.parametrize(("integrator", "coupling"), [
    ("Euler", "mobility"), ("implicitfast", "mobility"), ("RK4", "mobility"), ("RK4", "lagged"),
    ("discrete", "mobility")])
def test_the_control_callback_is_called_as_often_as_in_mj_step(integrator: str, coupling: str) -> None:
    """Trial steps do not call it."""
    plugin = tray(BOXES.replace("<option", f'<option integrator="{integrator}"'), bodies={"light": None},
                  coupling=coupling)
    calls: list[float] = []
    plain, counts = mujoco.MjData(plugin.model), []
    mujoco.set_mjcb_control(lambda m, d: calls.append(d.time))
    try:
        for step in (plugin.step, lambda: mujoco.mj_step(plugin.model, plain)):
            for _ in range(3):
                step()
            counts.append(calls.copy())
            calls.clear()
    finally:
        mujoco.set_mjcb_control(None)
    assert counts[0] == counts[1] and len(counts[0]) >= 3


@pytest.mark.parametrize("integrator", ["implicitfast", "RK4", "discrete"])
@pytest.mark.parametrize("spring", ["", pytest.param('springyield="0.02"', marks=pytest.mark.skipif(
    mujoco.mj_version() < 4_000_000, reason="springs yield from MuJoCo 4 on"))])
def test_a_probe_is_the_response_of_a_step(integrator: str, spring: str) -> None:
    """Also with a spring that yields: every probe begins with the plastic state of the step."""
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><option timestep="0.002" integrator="{integrator}"/>
        <worldbody><body><joint axis="0 1 0" stiffness="50" damping="0.1" {spring}/>
        <geom size="0.02" pos="0.1 0 0" mass="0.5"/></body></worldbody></mujoco>""")
    data, ends = mujoco.MjData(model), []
    data.qvel[0] = 9.0
    mujoco.mj_step(model, data, nstep=10)
    trial = TrialStep(model, data, [1])
    trial.begin()
    *_, mobility = MobilityProbe(trial).predict(np.zeros((2, 6)))
    for torque in (0.0, 0.005):
        data.xfrc_applied[1, 4] = torque
        trial.finish()
        ends.append(trial.twists()[0, 4])
        trial.roll_back()
    assert mobility[4, 4] == pytest.approx((ends[1] - ends[0]) / (0.005 * 0.002), rel=1e-3)


def test_a_pose_is_corrected_at_the_limit_of_dry_friction(tmp_path: Path) -> None:
    """Where a joint sticks in one probe and slides in the next, so that the responses are those of no mobility."""
    model = mujoco.MjModel.from_xml_path(str(write_arm(tmp_path / "arm.xml", 6)))
    model.opt.timestep, model.opt.integrator = 1e-3, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    data, rng, wrist = mujoco.MjData(model), np.random.default_rng(0), model.body("l5").id
    trial = TrialStep(model, data, [wrist])
    probe = MobilityProbe(trial)
    for _ in range(20):
        data.qpos[:], data.qvel[:] = rng.uniform(0.5, 1.2, model.nq), 0.0
        mujoco.mj_forward(model, data)
        model.dof_frictionloss[:] = np.abs(data.qfrc_bias) * rng.uniform(1.0, 1.001, model.nv)
        trial.begin()
        probe.predict(np.zeros((model.nbody, 6)))
        trial.finish()
        here = body_pose(data, wrist)
        aim = here.position + rng.normal(0.0, 1e-6, 3)
        probe.correct_poses({0: mpm.Pose(aim, here.quaternion)})
        assert body_pose(data, wrist).position == pytest.approx(aim, abs=1e-8)


@pytest.mark.long
def test_a_body_that_leaves_the_grid_causes_a_warning_and_falls_freely() -> None:
    plugin = tray(BOXES, bodies={"light": None})
    data = plugin.data
    data.qvel[:3] = [-3.0, 0.0, 1.0]
    with pytest.warns(BodyLeftGrid, match="'light' left"):
        while not plugin.outside_grid:
            plugin.step()
    before = data.qvel[2]
    plugin.step()
    assert data.qvel[2] - before == pytest.approx(-9.81 * 0.002)
    assert np.all(plugin.wrench("light").force == 0)


def test_a_body_too_fast_for_the_solver_has_diverged() -> None:
    """A body too fast for any substep is reported; MuJoCo itself warns at 1e10 only."""
    plugin = tray(BOXES, bodies={"light": None})
    plugin.data.qvel[0] = 1e8
    with pytest.raises(RobotDiverged, match="collider 0 moves at 1e.08 m/s"):
        plugin.step()


PLOUGH = """
<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <body name="cart" mocap="true" pos="0.03 0.05 0.06">
      <body name="blade"><geom type="box" size="0.004 0.03 0.02" friction="0.4"/></body></body>
    <body name="box" pos="0.1 0.05 0.07"><freejoint/>
      <geom type="box" size="0.01 0.01 0.01" mass="0.01" friction="0.4"/></body>
  </worldbody>
  <keyframe><key name="begin" mpos="0.15 0.05 0.09"/><key name="later" time="5" mpos="0.15 0.05 0.09"/></keyframe>
</mujoco>
"""


@pytest.mark.long
@pytest.mark.filterwarnings("ignore::mpm.errors.GrainsInSolid")  # the blade begins in the bed
@pytest.mark.parametrize("key", ["begin", "later"])
def test_a_keyframe_in_mid_run_moves_a_mocap_body_at_once(key: str) -> None:
    """Not through what lies between: grains stay as they are, whether MuJoCo's time goes back or ahead."""
    plugin = tray(PLOUGH, (0.2, 0.1, 0.06), bodies={"blade": None})
    for _ in range(3):
        plugin.step()
    mujoco.mj_resetDataKeyframe(plugin.model, plugin.data, plugin.model.key(key).id)
    before = plugin.solver.fastest
    plugin.step()
    assert plugin.solver.collider_pose(0).position == pytest.approx([0.15, 0.05, 0.09])
    assert plugin.solver.fastest < before + 2 * 9.81 * 0.002 and not plugin.wrench("blade").force.any()


@pytest.mark.filterwarnings("ignore::mpm.errors.GrainsInSolid")  # the blade begins in the bed
@pytest.mark.slow
@pytest.mark.parametrize("repeated", [False, True])
def test_a_body_fixed_to_a_mocap_body_ploughs(repeated: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its force is that of a moving blade, also in steps that are repeated because of another body."""
    predict = MobilityProbe.predict
    if repeated:  # half of MuJoCo's mobility makes predictions wrong
        monkeypatch.setattr("robosim.coupling.schemes.NEGLIGIBLE_SPEED", 1e-9)
        monkeypatch.setattr(MobilityProbe, "predict", lambda probe, wrenches: (
            *(p := predict(probe, wrenches))[:2], 0.5 * p[2]))
    plugin = tray(PLOUGH, (0.2, 0.1, 0.06), bodies={"blade": None, "box": None}, tolerance=1e-3 if repeated else None)
    forces, grains, repeats = [], np.zeros(3), 0
    for _ in range(150):
        plugin.data.mocap_pos[0, 0] += 0.2 * 0.002
        plugin.step()
        repeats += plugin.repeats
        forces.append(plugin.wrench("blade").force[0])
        grains += plugin.ledger.bodies["blade"].linear
    assert (repeats > 100) == repeated
    # passive wedge of Rankine in front of the blade, 2 cm deep: 1.5 N at least, a side of heaped sand more
    assert -8.0 < np.mean(forces[75:]) < -1.0
    assert np.mean(forces) * 0.3 == pytest.approx(-grains[0])
    assert plugin.solver.collider_pose(0).position[0] == pytest.approx(0.03 + 150 * 0.0004)


def test_invalid_input_is_refused() -> None:
    plugin = tray(BOXES, bodies={"light": None})
    far = mujoco.MjData(plugin.model)
    far.qpos[2] = 1.0
    open_mesh = EVERY_GEOM.replace("0 0 0.03\"/>", '0 0 0.03" face="0 2 1 0 1 3 1 2 3" inertia="shell"/>')
    table = "accepted: a dictionary, name of a body -> index of its collider"
    for xml, choices, message in (
            *((BOXES, {"bodies": bodies}, table) for bodies in (["light"], "light", {"light"})),
            *((BOXES, {"bodies": {name: None}, "data": plugin.data}, "another plugin steps this MjData")
              for name in ("light", "middle")),
            (BOXES, {"bodies": {"middle": None}, "dt": 0.0003}, "is 6.66667 substeps of"),
            (BOXES, {"bodies": {"light": None}, "data": far}, "outside the solver's grid"),
            (open_mesh, {"bodies": {"stack": None}}, "mesh 'wedge' .* has open edges"),
            (BOXES, {"bodies": {"bux": 0}}, "'bux'; valid: heavy, light, middle, world"),
            (BOXES, {"bodies": {"light": None}, "coupling": "strong"}, "'strong'; valid: lagged, mobility, one_way"),
            (BOXES, {"bodies": {"light": 3}}, "collider 3 .* cannot move")):
        with pytest.raises((ConfigError, UnknownName), match=message):
            tray(xml, (0.26, 0.1, 0.06), **choices)
    W = np.diag([1.0, 1, 1, 1, 1, -1])
    with pytest.raises(mpm.InvalidValue, match="eigenvalue -1"):
        plugin.solver.set_collider_mobility(0, W, np.zeros(6))
    with pytest.raises(mpm.InvalidValue, match="not symmetric"):
        plugin.solver.set_collider_mobility(0, np.triu(np.ones((6, 6))), np.zeros(6))
