"""Random numbers of episodes: within their ranges, listed in the info, and repeated from it."""

import gymnasium
import numpy as np
import pytest

import robosim  # noqa: F401  (registers the environments)
from robosim.base.errors import ConfigError, UnknownName

RANGES = {"friction_angle_deg": (25.0, 40.0), "tool_friction": (0.05, 0.4)}
ACTION = np.full(6, 0.2, np.float32)


def make(**options):
    return gymnasium.make("robosim/SpoonPour-v0", obs=["tool", "wrist", "grains"], noise=0.01, **options).unwrapped


def follow(env, steps: int = 4) -> list:
    return [env.step(ACTION)[0] for _ in range(steps)]


def test_draws_lie_in_their_ranges_and_are_what_the_field_has():
    env, seen = make(randomize=RANGES), []
    for seed in range(20):
        _, info = env.reset(seed=seed)
        numbers = info["draw"]["numbers"]
        seen.append([numbers[name] for name in RANGES])
        assert all(low <= numbers[name] <= high for name, (low, high) in RANGES.items())
        assert env.solver.colliders[0].friction == numbers["tool_friction"]
        assert env.solver.bodies[0].material.friction_angle_deg == pytest.approx(numbers["friction_angle_deg"])
    assert (np.std(seen, axis=0) > 0.2 * np.array([high - low for low, high in RANGES.values()])).all()
    env.close()


def test_draw_of_one_episode_repeats_it_bit_by_bit():
    env = make(randomize=RANGES)
    env.reset(seed=1)
    _, info = env.reset()
    first = follow(env)
    env.reset(seed=99)
    _, again = env.reset(options={"draw": info["draw"]})
    assert again["draw"] == info["draw"]
    for one, other in zip(first, follow(env)):
        for key in one:
            np.testing.assert_array_equal(one[key], other[key])
    env.close()


def test_vector_environment_draws_and_moves_as_single_ones_do():
    env, vector = make(randomize=RANGES), gymnasium.make_vec(
        "robosim/SpoonPour-v0", num_envs=3, workers=1, obs=["tool", "wrist", "grains"], noise=0.01, randomize=RANGES)
    vector.reset(seed=5)
    together = [vector.step(np.tile(ACTION, (3, 1)))[0] for _ in range(4)]
    for k in (2, 0):
        env.reset(seed=5 + k)
        for one, all_of_them in zip(follow(env), together):
            for key, value in one.items():
                np.testing.assert_allclose(all_of_them[key][k], value, rtol=1e-3, atol=1e-3)
    vector.close()
    env.close()


def test_friction_of_the_tool_changes_what_happens():
    env, spread = make(randomize={"tool_friction": (0.0, 1.0)}), []
    _, info = env.reset(seed=0)
    for friction in (0.0, 1.0):
        draw = info["draw"] | {"numbers": {"tool_friction": friction}}
        env.reset(options={"draw": draw})
        for _ in range(40):
            env.step(np.array([0, 0, 0, 0, 0.4, 0], np.float32))
        spread.append(env.solver.positions())
    assert np.abs(spread[0] - spread[1]).max() > 0.005
    env.close()


@pytest.mark.parametrize("ranges, message", [
    ({"tool_friction": (0.4, 0.1)}, "lowest, highest"), ({"tool_friction": (0.0, 20.0)}, "0 to 10"),
    ({"container_friction": (0.1, 0.2)}, "valid: .*tool_friction"), ({"frictoin": (0, 1)}, "valid: .*E"),
    ({"E": (1e5, 1e12)}, "time step|accepted")])
def test_ranges_that_cannot_be_used_are_refused(ranges: dict, message: str):
    with pytest.raises((ConfigError, UnknownName), match=message):
        make(randomize=ranges)


@pytest.mark.parametrize("given", [7, {}, {"numbers": {"tool_friction": 0.1}},
                                   {"numbers": {"tool_friction": 9.0, "friction_angle_deg": 30.0}, "tool": (0, 0, 0),
                                    "pile": (0, 0, 0), "turn_deg": 0.0, "sensors": 1}])
def test_draw_that_no_episode_has_made_is_refused(given):
    env = make(randomize=RANGES)
    with pytest.raises(ConfigError, match="draw"):
        env.reset(options={"draw": given})
    with pytest.raises(ConfigError, match="draw alone"):
        env.reset(options={"draw": {"numbers": {}}, "nominal": True})
    env.close()
