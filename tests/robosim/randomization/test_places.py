"""Places, fills and errors of the robot that episodes draw: what they must and must not change."""

import numpy as np
import pytest
import taichi as ti
from grain_envs import make, make_vector, play

from mpm.observers.height_map import Raster
from robosim.base.errors import ConfigError, RobosimError
from robosim.randomization.variants import displacement, placed
from robosim.senses.grains import GOAL_FRAME
from robosim.senses.height_map import PlacedFloor, floor_heights
from robosim.tasks.draw import HOME
from robosim.tasks.task import load_task

PLACE = {"place_x": (-0.03, 0.03), "place_y": (-0.03, 0.03), "place_yaw_deg": (-30.0, 30.0)}


@pytest.mark.long
def test_container_and_grains_are_put_elsewhere_as_one():
    """In the container's frame all grains lie as before, and the counts and the scale find what they found."""
    env = make("ScoopScoop", obs=["scale", "height_map", "goal"], randomize=PLACE)
    home = env.task.containers[env.task.container].pose
    local, seen = [], []
    for seed in (0, 1):
        observation, info = env.reset(seed=seed)
        local.append(env.solver.collider_pose(1).inverse().apply(env.solver.positions()))
        seen.append((observation["scale"], env.episode.counts.distance / env.task.grains.counted))
        moved = env.solver.collider_pose(1).position - home.position
        assert moved[:2] == pytest.approx([info["draw"]["numbers"][name] for name in ("place_x", "place_y")], abs=1e-9)
        heights = observation["height_map"]
        assert heights.max() > 0.02
    np.testing.assert_allclose(local[0], local[1], atol=2e-6)
    np.testing.assert_allclose(seen[0][0], seen[1][0], atol=2e-5)
    np.testing.assert_allclose(seen[0][1], seen[1][1], rtol=0.1)  # Manhattan distance, along the world's axes
    before = env.solver.positions()
    for _ in range(5):
        env.step(np.zeros(6, np.float32))
    assert np.abs(env.solver.positions() - before).max() < 1e-3  # walls and grains still fit each other
    env.close()


@pytest.mark.slow
def test_a_place_that_is_not_moved_is_the_task_s_own():
    """Ranges of zero width: rewards are those of the task, to the bit."""
    own, moved = make("ShovelMove"), make("ShovelMove", randomize=dict.fromkeys(PLACE, (0.0, 0.0)))
    rewards = []
    for env in (own, moved):
        env.reset(seed=3, options={"nominal": True})
        rewards.append([env.step(np.full(env.action_space.shape, 0.3, np.float32))[1] for _ in range(4)])
        assert env.carrier.setting.place is HOME
        env.close()
    assert rewards[0] == rewards[1]


@pytest.mark.long
def test_the_target_moves_with_its_place():
    """A tool that carries its grains to the goal that is observed delivers them, wherever it is."""
    env = make("SpoonTranslate", obs=["goal", "tool"], randomize={**PLACE, "mount_x": (0.002, 0.002)}, action_repeat=5)
    delivered = [play(env, lambda seen: np.clip(6.0 * (seen["goal"] + [0.0, 0.0, 0.02]), -1.0, 1.0).astype(np.float32),
                      seed)[1]["readings"]["delivered"] for seed in range(3)]
    assert np.mean(delivered) > 0.8, delivered
    env.close()


@pytest.mark.slow
def test_fill_and_slope_change_mass_and_surface():
    env = make("ScoopScoop", randomize={"fill": (0.8, 1.2), "surface_slope_deg": (-12.0, 12.0)})
    found = {}
    for seed in range(40):
        rng = np.random.default_rng(seed)
        levels = env.world.randomization.draw(rng, nominal=True, shift=(0, 0, 0), turn_deg=0.0).grains[1:]
        if levels in ((0.8, -12.0), (1.2, 12.0)) and levels not in found:
            env.np_random = np.random.default_rng(seed)
            env.reset(options={"nominal": True})
            x = env.solver.collider_pose(1).inverse().apply(env.solver.positions())
            high = x[x[:, 2] > np.quantile(x[:, 2], 0.9)]
            found[levels] = env.solver.masses().sum(), high[:, 0].mean(), x[:, 2].mean()
    (lean, full) = found[(0.8, -12.0)], found[(1.2, 12.0)]
    assert full[0] / lean[0] == pytest.approx(1.5, rel=0.01)
    assert lean[1] < -0.01 and full[1] > 0.01
    assert full[2] > 1.2 * lean[2]
    env.close()


def test_grains_above_the_rim_are_refused():
    with pytest.raises(ConfigError, match="rim"):
        make("ScoopScoop", randomize={"fill": (1.0, 3.0), "surface_slope_deg": (0.0, 30.0)})


@pytest.mark.long
def test_numbers_of_sensors_are_drawn():
    env = make("SpoonPour", obs=["scale"], randomize={"scale.repeatability": (0.0, 0.01)})
    spread = []
    for seed in range(2):
        _, info = env.reset(seed=seed)
        values = [env.step(np.zeros(6, np.float32))[0]["scale"][0] for _ in range(12)]
        spread.append((info["draw"]["numbers"]["scale.repeatability"], np.std(values)))
    for deviation, seen in spread:
        assert 0.4 * deviation < seen < 2.0 * deviation
    env.close()


@pytest.mark.slow
def test_nothing_is_compiled_after_the_first_reset():
    """Other materials, fills, places and frictions are numbers that kernels read, alone and in a batch."""
    env = make("SpoonTranslate", obs=["tool", "wrist", "grains"], randomize="wide")
    vector = make_vector("SpoonTranslate", 2, obs=["tool", "wrist", "grains"], randomize="wide")
    action = np.full((2, *env.action_space.shape), 0.2, np.float32)
    drawn = set()
    for seed in range(6):
        drawn.add(env.world.randomization.draw(np.random.default_rng(seed), nominal=False, shift=(0.0, 0.0, 0.0),
                                               turn_deg=0.0).grains)
        env.reset(seed=seed)  # settles, where no earlier process has
        vector.reset(seed=seed)
    env.step(action[0])
    vector.step(action)
    kernels = ti.lang.impl.get_runtime().get_num_compiled_functions()
    for seed in range(6, 12):
        draw = env.reset(seed=seed - 6)[1]["draw"]
        env.reset(options={"draw": draw})
        env.step(action[0])
        vector.reset(seed=seed - 6)
        vector.step(action)
    assert ti.lang.impl.get_runtime().get_num_compiled_functions() == kernels > 0 and len(drawn) > 2
    vector.close()
    env.close()


def test_height_map_of_a_container_elsewhere_is_that_of_a_task_with_it_there():
    """The raster of walls and floor, up to half a pixel of lateral error at their edges."""
    task = load_task("ScoopScoop")
    place = displacement(task, 0.021, -0.013, 23.0)
    raster = Raster((0.3, -0.3), (0.9, 0.3), (96, 96))
    exact, seen = floor_heights(placed(task, place), raster), PlacedFloor(task, raster).heights(place)
    assert exact.max() > 0.03 and np.mean(np.abs(exact - seen) < 1e-4) > 0.96
    home = floor_heights(task, raster)
    assert np.mean(np.abs(PlacedFloor(task, raster).heights(HOME) - home) < 1e-4) > 0.96 > np.mean(
        np.abs(exact - home) < 1e-4)


@pytest.mark.slow
def test_hard_has_half_the_target_a_delay_noise_and_room_and_starts_that_do_not_depend_on_the_observation():
    wide, layout, terms = (make("SpoonTranslate", randomize=name, **obs) for name, obs in (
        ("wide", {}), ("hard", {}), ("hard", {"obs": ["goal_frame", "tool"]})))
    assert layout.task.target.half[:2] == pytest.approx(0.5 * np.array(wide.task.target.half[:2]))
    assert layout.member.delay.steps == 10 and wide.member.delay.steps == 0
    place, room = layout.world.randomization.ranges["place_x"][1], np.array(layout.task.action.upper)
    assert place == 0.1 and room[0] >= layout.task.goal[0] + place
    draws = [env.reset(seed=7)[1]["draw"] for env in (layout, terms)]
    sensors = {"goal_frame.noise", "tool.noise"}
    assert set(draws[1]["numbers"]) - set(draws[0]["numbers"]) == sensors
    assert draws[0] == {**draws[1], "numbers": {
        name: value for name, value in draws[1]["numbers"].items() if name not in sensors}}
    unseen = make("SpoonTranslate", randomize="hard_unseen").world.randomization
    assert not set(unseen.materials) & set(layout.world.randomization.materials)


@pytest.mark.long
def test_ranges_may_be_a_file(tmp_path):
    file = tmp_path / "own.yaml"
    file.write_text("place_x: [-0.05, 0.05]\nmaterial: [salt, sugar]\n")
    assert make("SpoonPour", randomize=str(file)).world.randomization.describe() == {
        "place_x": [-0.05, 0.05], "material": ["salt", "sugar"]}
    for text, message in (("3", "holds 3; accepted"), ("place_x: 0.1", "accepted: .lowest"), ("no: [0, 1]", "no")):
        file.write_text(text)
        with pytest.raises(RobosimError, match=message):
            make("SpoonPour", randomize=str(file))


def test_what_is_seen_in_the_goals_frame_does_not_say_where_the_target_stands():
    """With the tool at the same place and heading in it; only the heading of the frame itself differs."""
    task = load_task("SpoonTranslate")
    free = task.action.model_copy(update={"lower": (-9.0, -9.0, -9.0), "upper": (9.0, 9.0, 9.0)})
    task, seen = task.model_copy(update={"action": free}), []
    for x, y, yaw in ((0.0, 0.0, 0.0), (0.024, -0.016, 12.0)):
        env = make("Task", task=task, obs=["goal_frame"], randomize={
            name: (value, value) for name, value in zip(PLACE, (x, y, yaw))})
        place, start = displacement(task, x, y, yaw), np.array(task.start.position)
        shift = place.apply(start[None])[0] - start
        values = env.reset(seed=0, options={"nominal": True, "shift": shift, "turn_deg": yaw})[0]["goal_frame"]
        ends = np.cumsum(list(GOAL_FRAME.values()))[:-1]
        seen.append(dict(zip(GOAL_FRAME, np.split(values, ends))))
        env.close()
    for name, length in GOAL_FRAME.items():
        assert len(seen[0][name]) == length
        assert name == "axes" or seen[0][name] == pytest.approx(seen[1][name], abs=2e-3), name
    assert seen[1]["axes"] == pytest.approx([np.cos(np.radians(12.0)), np.sin(np.radians(12.0))], abs=1e-6)
