"""Places, fills and errors of the robot that episodes draw: what they must and must not change."""

import numpy as np
import pytest
import taichi as ti
from grain_envs import make, make_vector, play

from mpm.observers.height_map import Raster
from robosim.base.errors import ConfigError
from robosim.randomization.variants import displacement, placed
from robosim.senses.height_map import PlacedFloor, floor_heights
from robosim.tasks.draw import HOME
from robosim.tasks.task import load_task

PLACE = {"place_x": (-0.03, 0.03), "place_y": (-0.03, 0.03), "place_yaw_deg": (-30.0, 30.0)}


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


def test_the_target_moves_with_its_place():
    """A tool that carries its grains to the goal that is observed delivers them, wherever it is."""
    env = make("SpoonTranslate", obs=["goal", "tool"], randomize={**PLACE, "mount_x": (0.002, 0.002)}, action_repeat=5)
    delivered = [play(env, lambda seen: np.clip(6.0 * (seen["goal"] + [0.0, 0.0, 0.02]), -1.0, 1.0).astype(np.float32),
                      seed)[1]["readings"]["delivered"] for seed in range(3)]
    assert np.mean(delivered) > 0.8, delivered
    env.close()


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
