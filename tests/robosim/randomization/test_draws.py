"""Random numbers of episodes: within their ranges, listed in the info, and repeated from it."""

from collections.abc import Iterator

import numpy as np
import pytest
from grain_envs import make, same

from robosim.base.errors import ConfigError, UnknownName
from robosim.envs.grain_env import GrainEnv

RANGES = {"friction_angle_deg": (25.0, 40.0), "tool_friction": (0.0, 1.0)}


@pytest.fixture(scope="module")
def env() -> Iterator[GrainEnv]:
    made = make("SpoonPour", obs=["tool", "wrist", "grains"], noise=0.01, randomize=RANGES)
    yield made
    made.close()


def test_draws_lie_in_their_ranges_and_are_what_the_field_has(env: GrainEnv):
    seen = []
    for seed in range(20):
        _, info = env.reset(seed=seed)
        numbers = info["draw"]["numbers"]
        seen.append([numbers[name] for name in RANGES])
        assert all(low <= numbers[name] <= high for name, (low, high) in RANGES.items())
        assert env.solver.colliders[0].friction == numbers["tool_friction"]
        assert env.solver.bodies[0].material.friction_angle_deg == pytest.approx(numbers["friction_angle_deg"])
    assert (np.std(seen, axis=0) > 0.2 * np.array([high - low for low, high in RANGES.values()])).all()


@pytest.mark.long
def test_draw_of_one_episode_repeats_it_bit_by_bit(env: GrainEnv):
    action = np.full(6, 0.2, np.float32)
    env.reset(seed=1)
    _, info = env.reset()
    first = [env.step(action)[0] for _ in range(4)]
    env.reset(seed=99)
    _, again = env.reset(options={"draw": info["draw"]})
    assert again["draw"] == info["draw"]
    assert same([env.step(action)[0] for _ in range(4)], first)


@pytest.mark.long
def test_friction_of_the_tool_changes_what_happens(env: GrainEnv):
    spread = []
    _, info = env.reset(seed=0)
    for friction in (0.0, 1.0):
        env.reset(options={"draw": info["draw"] | {"numbers": info["draw"]["numbers"] | {"tool_friction": friction}}})
        for _ in range(80):
            env.step(np.array([0, 0, 0, 0, 0.4, 0], np.float32))
        spread.append(env.solver.positions())
    assert np.abs(spread[0] - spread[1]).max() > 0.005


@pytest.mark.parametrize("ranges, message", [
    ({"tool_friction": (0.4, 0.1)}, "lowest, highest"), ({"tool_friction": (0.0, 20.0)}, "0 to 10"),
    ({"container_friction": (0.1, 0.2)}, "valid: .*tool_friction"), ({"frictoin": (0, 1)}, "valid: .*E"),
    ({"E": (1e5, 1e12), "density": (300.0, 900.0)}, "substeps"), ("narrow", "nominal, wide"),
    ({"material": ("salt", "snow")}, "snow"),
    ({"material": ("water",)}, "law"), ({"place_x": (-2.0, 2.0)}, "-0.5 to 0.5"), ({"payload": (0.8, 1.2)}, "valid"),
    ({"fill": (0.5, 9.0)}, "0.2 to 3"), ({"scale.lag": (0.1, 0.2)}, "valid: .*tool.noise")])
def test_ranges_that_cannot_be_used_are_refused(ranges, message: str):
    with pytest.raises((ConfigError, UnknownName), match=message):
        make("SpoonPour", obs=["tool"], randomize=ranges)


def test_draw_that_no_episode_has_made_is_refused(env: GrainEnv):
    beyond = {"numbers": {"tool_friction": 9.0, "friction_angle_deg": 30.0}, "tool": (0, 0, 0), "pile": (0, 0, 0),
              "turn_deg": 0.0, "sensors": 1}
    for given in (7, {}, {"numbers": {"tool_friction": 0.1}}, beyond):
        with pytest.raises(ConfigError, match="draw"):
            env.reset(options={"draw": given})
    with pytest.raises(ConfigError, match="draw alone"):
        env.reset(options={"draw": {"numbers": {}}, "nominal": True})
