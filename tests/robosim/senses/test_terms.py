"""Observation terms: each against what it measures, and the combinations that environments take."""

import json

import gymnasium
import numpy as np
import pytest
from exact_sums import compare_exactly
from grain_envs import make, make_vector, play, same
from gymnasium.utils.env_checker import check_env

from robosim.base.errors import ConfigError, UnknownName
from robosim.envs import BUNDLED
from robosim.rendering.grain_skin import GRAIN_RADIUS, add_grain_skin
from robosim.rendering.renderer import SMOOTHING, SceneRenderer
from robosim.rendering.views import View
from robosim.robot.mjspec import compile_spec
from robosim.scene.grains import grain_volume
from robosim.senses.task_scene import SeenBodies, build_task_spec
from robosim.shapes import tool_shape
from robosim.tasks.counting import TOOL
from robosim.tasks.task import load_task

COMBINATIONS = (["tool", "grains"], ["wrist", "height_map", "tool"], ["depth", "time"], ["goal", "point_cloud"],
                ["time", {"name": "grains", "layout": "moments"}, "tool"],
                [{"name": "wrist", "tare": True}, {"name": "height_map", "pixels": (8, 16)}, "goal"])
WITH_ARM = (["joints", "torques"], ["tool", "wrist", "height_map"], ["depth", "joints"], ["goal", "time", "torques"],
            ["grains", "wrist"], [{"name": "depth", "camera": "hand_wrist", "width": 20}, "tool"])


def run(env, steps: int = 3, scale: float = 0.3, seed: int = 0):
    """Observations of some random actions, the first one of the reset."""
    rng = np.random.default_rng(seed)
    seen = [env.reset(seed=seed)[0]]
    for _ in range(steps):
        seen.append(env.step((scale * rng.uniform(-1, 1, env.action_space.shape)).astype(np.float32))[0])
    return seen


@pytest.mark.long
def test_flat_observations_pass_gymnasiums_check():
    for obs in COMBINATIONS:
        env = make("SpoonPour", obs=obs, flatten=True)
        check_env(env, skip_render_check=True)
        assert sum(s.stop - s.start for s in env.observation_slices.values()) == len(run(env, 0)[0])
        env.close()


@pytest.mark.long
@pytest.mark.parametrize(("task", "arm"), [
    ("SpoonPour", False), *(pytest.param(task, arm, marks=pytest.mark.slow) for task in BUNDLED for arm in (False, True)
                            if arm or task != "SpoonPour")])
def test_every_task_passes_with_every_combination(task: str, arm: bool):
    """Gymnasium's check, the same bits after the same seed, finite numbers, and no constant observation."""
    for obs in (*COMBINATIONS, *(WITH_ARM if arm else ())):
        env = make(task, obs=obs, arm=arm)
        check_env(env, skip_render_check=True)
        seen, again, other = run(env, 12), run(env, 12), run(env, 3, seed=1)
        assert same(seen, again) and not same(seen[3], other[3])
        parts = {key: np.array([gymnasium.spaces.flatten(space, one[key]) for one in seen])
                 for key, space in env.observation_space.spaces.items()}
        assert all(np.isfinite(values).all() for values in parts.values())
        constant = [key for key, values in parts.items() if np.ptp(values, axis=0).max() == 0.0]
        # a bed that the tool has not reached yet is at rest, and all that shows it is the same
        assert not constant or (not env.task.carried and set(constant) <= {"wrist", "height_map", "grains"}), constant
        env.close()


@pytest.mark.long
@pytest.mark.parametrize(("task", "options"), [
    ("SpoonPour", {
        "obs": ["tool", "wrist", "scale", "height_map", "grains", {"name": "depth", "noise_model": "stereo"}],
        "latency": 0.02, "noise": 1e-3, "dropout": 0.1, "action_delay": 0.03}),
    pytest.param("SpoonTranslate", {"obs": ["tool", "grains", "goal"], "randomize": "wide"}, marks=pytest.mark.slow),
    *(pytest.param(task, {"obs": ["tool", "wrist", "grains", *(["joints"] if arm else [])], "arm": arm},
                   marks=pytest.mark.slow) for task in BUNDLED for arm in (False, True))])
def test_terms_are_the_same_in_a_vector_environment(task: str, options: dict):
    """Where sums may be reordered, a grain that just touches the tool may do so in one kernel alone."""
    compare_exactly("test_terms", task, json.dumps(options))


def compared(task: str, written: str):
    """Compare six steps of an environment alone with those of one in a vector."""
    options = json.loads(written)
    env, vector, rng = make(task, **options), make_vector(task, 2, **options), np.random.default_rng(0)
    together, alone = vector.reset(seed=3)[0], env.reset(seed=4)[0]
    for step in range(6):
        assert together.keys() == alone.keys()
        for key, value in alone.items():
            np.testing.assert_allclose(together[key][1], value, rtol=1e-3, atol=1e-4, err_msg=f"{key}, step {step}")
        actions = (0.3 * rng.uniform(-1, 1, vector.action_space.shape)).astype(np.float32)
        alone, reward, *ends, _ = env.step(actions[1])
        together, rewards, *all_ends, _ = vector.step(actions)
        assert rewards[1] == pytest.approx(reward, rel=1e-3, abs=1e-4)
        assert [each[1] for each in all_ends] == ends
    vector.close()
    env.close()


@pytest.mark.long
def test_wrist_without_an_arm_holds_the_weight_of_the_grains():
    env = make("SpoonPour", obs=["wrist", "tool"])
    env.reset(seed=0, options={"nominal": True})
    still = np.zeros(6, np.float32)
    force = np.mean([env.step(still)[0]["wrist"] for _ in range(20)], axis=0)
    pose = env.solver.collider_pose(TOOL)
    weight = env.solver.masses().sum() * 9.81
    np.testing.assert_allclose(pose.matrix @ force[:3], [0.0, 0.0, weight], atol=0.02 * weight)
    lever = env.solver.positions().mean(0) - pose.position
    np.testing.assert_allclose(pose.matrix @ force[3:], np.cross(lever, [0, 0, weight]), atol=0.05 * weight * 0.05)
    env.close()


def test_wrist_with_an_arm_is_mujocos_sensor():
    env = make("SpoonPour", obs=["wrist", "torques", "joints"], arm=True, action_repeat=1)
    env.reset(seed=0)
    for _ in range(3):
        seen, *_ = env.step(np.full(6, 0.1, np.float32))
        data, model = env.carrier.cell.data, env.carrier.cell.model
        sensors = np.concatenate([data.sensor(f"wrist_{kind}").data for kind in ("force", "torque")])
        np.testing.assert_allclose(seen["wrist"], sensors, rtol=1e-6)
        axis = model.joint(env.carrier.cell.arm.joints[2]).axis
        third = data.sensor(f"{env.carrier.cell.arm.joints[2]}_torque").data @ axis
        assert seen["torques"][2] == pytest.approx(third, rel=1e-6)
        np.testing.assert_allclose(seen["joints"][:7], data.qpos[env.carrier.cell.scene.arm_qpos], rtol=1e-6)
    env.close()


@pytest.mark.long
def test_scale_shows_what_was_poured_after_its_lag():
    longer = load_task("SpoonPour").model_copy(update={"steps": 1500})  # until all has landed
    env = make("SpoonPour", task=longer, obs=[{"name": "scale", "lag": 0.1, "repeatability": 0.0}], horizon="truncate")
    _, info, seen = play(env, options={"nominal": True})
    shown, load = np.array([float(one["scale"][0]) for one in seen]), env.solver.masses().sum()
    away = np.linalg.norm(env.solver.positions()[:, :2] - longer.target.centre[:2], axis=1)
    landed = env.solver.masses()[away < longer.target.half[0]].sum()  # a disc, beyond which some grains land
    assert info["readings"]["delivered"] == 1.0
    assert landed > 0.5 * load and shown[-1] == pytest.approx(landed, rel=0.03)
    assert shown[1] == 0.0 and np.allclose(shown * 1e5, np.round(shown * 1e5), atol=1e-2)
    env.close()


@pytest.mark.parametrize("task, arm, camera", [
    ("SpoonPour", False, "task"), pytest.param("ScoopScoop", False, "side", marks=pytest.mark.slow),
    pytest.param("SpoonPour", True, "close", marks=pytest.mark.slow),
    pytest.param("SpoonPour", True, "hand_wrist", marks=pytest.mark.slow)])
def test_depth_is_that_of_the_renderer(task: str, arm: bool, camera: str):
    env = make(task, obs=[{"name": "depth", "camera": camera}], arm=arm)
    seen = run(env, 8)[-1]["depth"]
    spec = build_task_spec(env.task, env.carrier.build_spec(), marks=False)
    count = env.task.grains.count
    add_grain_skin(spec, count, GRAIN_RADIUS * grain_volume(env.task) ** (1 / 3), env.material.colour)
    model = compile_spec(spec)
    bodies, renderer = SeenBodies(model, env.task), SceneRenderer(model, count, 84, 84)
    bodies.place(env.carrier.setting.place, env.solver.collider_pose(TOOL),
                 None if not arm else env.carrier.robot_data.qpos)
    read, seen_by = renderer._read, []
    renderer._read = lambda *size: seen_by.append((View.of(renderer._scene), read(*size))) or seen_by[-1][1]
    renderer.draw(bodies.data, env.solver.positions(), camera)
    view, (_, buffer) = seen_by[0]  # then come the light's
    drawn = view.distance(buffer.reshape(84, SMOOTHING, 84, SMOOTHING)).mean((1, 3))
    drawn = np.where(drawn <= 4.0, drawn, 0.0)
    assert np.mean(np.abs(drawn - seen) < 1e-3) > 0.95
    renderer.close()
    env.close()


def test_points_lie_on_what_the_camera_sees():
    camera = {"position": [0.86, -0.05, 0.40], "look_at": [0.78, -0.05, 0.20], "fovy_deg": 25}
    env = make("SpoonPour", obs=[{"name": "point_cloud", "points": 400, "camera": camera}, "depth"])
    seen = run(env)[-1]
    points = seen["point_cloud"].astype(float)
    near = np.linalg.norm(points[:, None] - env.solver.positions()[None], axis=2).min(1)
    pose = env.solver.collider_pose(TOOL)
    on_tool = np.abs(tool_shape(env.task.tool).real_distance(0.002).distance(pose.inverse().apply(points))) < 0.004
    assert np.mean((near < 0.008) | on_tool | (points[:, 2] < 0.003)) > 0.97
    assert (near < 0.006).sum() > 20
    env.close()


def test_rgb_is_a_picture_of_the_scene():
    env = make("SpoonPour", obs=[{"name": "rgb", "width": 64, "height": 48}, "time"])
    seen = run(env, 2)
    assert seen[0]["rgb"].shape == (48, 64, 3) and seen[0]["rgb"].dtype == np.uint8
    assert len(np.unique(seen[0]["rgb"].reshape(-1, 3), axis=0)) > 100
    assert (seen[0]["rgb"] != seen[-1]["rgb"]).any()
    env.close()


@pytest.mark.long
def test_privileged_terms_are_in_the_info_and_change_nothing_else():
    plain, taught = (make("SpoonPour", obs=["tool", "wrist"], privileged=more) for more in ((), ["grains"]))
    plain.reset(seed=5)
    _, info = taught.reset(seed=5)
    assert info["privileged"]["grains"].shape == (203, 6)
    for _ in range(3):
        a, b = plain.step(np.full(6, 0.2, np.float32)), taught.step(np.full(6, 0.2, np.float32))
        np.testing.assert_allclose(a[0]["wrist"], b[0]["wrist"], atol=1e-4)
        np.testing.assert_allclose(b[4]["privileged"]["grains"][:, :3], taught.solver.positions(), atol=1e-6)
    plain.close()
    taught.close()


def test_starts_do_not_depend_on_what_is_observed():
    envs = [make("SpoonPour", obs=obs) for obs in ("flat", ["tool", {"name": "wrist", "noise": 1.0}])]
    for seed in (3, None, None):
        for env in envs:
            env.reset(seed=seed)
        a, b = (env.solver.collider_pose(TOOL).position for env in envs)
        np.testing.assert_array_equal(a, b)
    for env in envs:
        env.close()


@pytest.mark.long
@pytest.mark.parametrize("obs, message", [
    (["foo"], "valid: depth, goal, goal_frame, grains"), ({"latency": 0.1}, "with a list of terms"),
    (["tool", "tool"], 'another "key"'),
    (["joints"], "needs arm = True; .*grains"), ("foo", "or a list of grains"),
    (["scale"], "a target on the table"), ([{"name": "depth", "camera": "zz"}], "valid: close, overview, side, task"),
    ([{"name": "depth", "wdth": 3}], "valid: camera, dropout"), ([{"name": "depth", "width": 0}], "1 to 2048"),
    ([{"name": "tool", "latency": -1}], "0 to 10"), ([7], "unknown term"), ([], "a list of 1 to 32 terms"),
    ([{"name": "height_map", "lower": (1, 1), "upper": (0, 0)}], "two corners"),
    ([{"name": "depth", "camera": {"position": [0, 0, 0], "look_at": [0, 0, 0]}}], "a distance between"),
    ([{"name": "grains", "layout": "x"}], "particles, positions"), ([{"name": "depth", "noise_model": "x"}], "stereo")])
def test_bad_terms_are_refused_by_name(obs, message: str):
    with pytest.raises((ConfigError, UnknownName), match=message):
        make("SpoonTranslate", **(obs if isinstance(obs, dict) else {"obs": obs}))
