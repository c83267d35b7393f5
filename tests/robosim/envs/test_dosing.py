"""Dosing environments: the drawn target, no mass lost, the end, states, heaps that stand, and the shaker."""

from collections.abc import Iterator

import numpy as np
import pytest
from grain_envs import make, make_vector, observe, play

from robosim.base.errors import ConfigError
from robosim.envs.grain_env import GrainEnv
from robosim.scene.field import build_tool_sdf
from robosim.shapes import tool_shape
from robosim.tasks.counting import TOOL
from robosim.tasks.task import load_task

STILL = np.array([0, 0, 0, 0, 0, 0, -1, 0], np.float32)
"""Action of a tool that neither moves nor vibrates."""
EXACT = {"name": "scale", "lag": 0.0, "readability": 0.0, "repeatability": 0.0}


@pytest.fixture(scope="module")
def spoon() -> Iterator[GrainEnv]:
    env = make("DoseSpoon", obs=["tool", "goal", "time", EXACT, "target"])
    yield env
    env.close()


def turn(env: GrainEnv, to_deg: float, rate: float = 1.0, amplitude: float = -1.0) -> list[tuple]:
    """Tilt the tool about its lateral axis, which is the world's x turned over; return what the steps gave."""
    steps, action = [], STILL.copy()
    action[6] = amplitude
    while abs(rest := np.radians(to_deg) - env.episode.tool_rotation()) > 1e-3:
        per_action = env.task.action.angular_speed * env.action_repeat * env.task.step_dt
        action[3] = -np.clip(rest / per_action, -rate, rate)
        steps.append(env.step(action))
    return steps


@pytest.mark.long
def test_a_target_is_drawn_and_observed(spoon: GrainEnv) -> None:
    targets = []
    for seed in range(30):
        seen, info = spoon.reset(seed=seed)
        targets.append(float(seen["target"][0]))
        assert targets[-1] == pytest.approx(info["draw"]["numbers"]["target_mass"])
        assert info["readings"]["target_mass"] == info["draw"]["numbers"]["target_mass"]
    assert 0.002 <= min(targets) < 0.004 and 0.013 < max(targets) <= 0.015
    seen, info = spoon.reset(seed=99, options={"draw": info["draw"]})
    assert seen["target"][0] == pytest.approx(targets[-1]) and len(set(targets)) == 30
    draw = info["draw"] | {"numbers": {"target_mass": 0.05}}
    with pytest.raises(ConfigError, match=r"target_mass = 0.05; accepted: 0.002 to 0.015"):
        spoon.reset(options={"draw": draw})


@pytest.mark.long
def test_layouts_of_the_other_tasks_have_the_target(spoon: GrainEnv) -> None:
    seen, _ = spoon.reset(seed=4)
    for layout in ("flat", "dict", "none"):
        perception, read = observe(spoon, layout)
        target = read["target"] if layout == "dict" else read[perception.slices["target"]]
        assert np.array_equal(target, seen["target"]) and target.dtype == np.float32


@pytest.mark.long
def test_no_mass_is_lost_and_the_balance_shows_what_is_poured(spoon: GrainEnv) -> None:
    """The tool pours while it shakes, and comes back: the episode ends half a second later."""
    seen, info = spoon.reset(seed=1, options={"nominal": True})
    load = 1e3 * spoon.solver.masses().sum()
    assert load == pytest.approx(42.06, abs=0.01) and info["readings"]["held"] == pytest.approx(1e-3 * load)
    assert seen["scale"][0] == 0.0
    poured = turn(spoon, 45.0, rate=0.5, amplitude=-0.4)
    back = turn(spoon, 0.0)
    assert not any(step[2] for step in poured + back)
    waiting = [spoon.step(STILL)]
    while not waiting[-1][2]:
        waiting.append(spoon.step(STILL))
    assert len(waiting) == pytest.approx(25, abs=4) and not waiting[-1][3]  # 0.5 s, from 2 deg on
    for _, _, _, _, info in poured + back + waiting:
        masses = [info["readings"][name] for name in ("poured", "spilled", "held", "elsewhere")]
        assert 1e3 * sum(masses) == pytest.approx(load) and min(masses) >= 0.0
    last, readings = waiting[-1][0], waiting[-1][4]["readings"]
    assert 0.001 < readings["poured"] < 0.03 and readings["elsewhere"] == 0.0
    assert 1e3 * readings["spilled"] <= 0.005 * load  # a grain or two may bounce
    assert last["scale"][0] == pytest.approx(readings["poured"], abs=1e-6)
    with pytest.raises(ConfigError, match="no episode is running"):
        spoon.step(STILL)


@pytest.mark.slow
def test_in_a_batch_each_ends_at_its_own_time() -> None:
    """Two tilt and come back, one 0.1 s after the other, and end 0.5 s after they are level; the third stays still."""
    vector = make_vector("DoseSpoon", action_repeat=25, obs=["time"])
    vector.reset(seed=5)
    ends = []
    for k in range(15):
        given = np.tile(STILL, (3, 1))
        for e, first in ((0, 0), (1, 2)):  # 2 rad/s for 0.05 s: 5.7 deg
            given[e, 3] = {first: -1.0, first + 1: 1.0}.get(k, 0.0)
        seen, _, ended, cut, infos = vector.step(given)
        assert not cut.any()
        for e in np.flatnonzero(ended):
            readings = {name: values[e] for name, values in infos["final_info"]["readings"].items()}
            assert readings["seconds"] == pytest.approx(0.05 * (k + 1)) and seen["time"][e] == 0.0
            masses = [readings[name] for name in ("poured", "spilled", "held", "elsewhere")]
            assert sum(masses) == pytest.approx(0.04206, abs=1e-5) and min(masses) >= 0.0
            ends.append((k, e))
    assert ends == [(11, 0), (13, 1)]
    vector.close()


def test_a_heap_in_a_still_spoon_stands(spoon: GrainEnv) -> None:
    """Its top falls by 0.2 mm in 2 s, with room for other processors; on a solid with a wall of 3 mm by 11 mm."""
    spoon.reset(seed=0, options={"nominal": True})
    tops = [spoon.solver.positions()[:, 2].max()]
    for _ in range(100):
        spoon.step(STILL)
    tops.append(spoon.solver.positions()[:, 2].max())
    assert -1e-4 < tops[0] - tops[1] < 6e-4
    assert spoon.episode.counts.in_inner == 320
    assert np.array_equal(spoon.solver.collider_pose(0).position, spoon.task.start.position)


@pytest.mark.slow
def test_a_place_moves_the_receiver_and_what_counts_as_in_it() -> None:
    """The cup stands 20 mm aside; a tool that follows pours into it."""
    env = make("DoseSpoon", obs=["goal", EXACT], randomize={"place_x": (0.02, 0.02), "place_y": (0.01, 0.01)})
    seen, _ = env.reset(seed=0, options={"nominal": True, "shift": (0.02, 0.01, 0.0)})
    assert seen["goal"] == pytest.approx([0.0, 0.035, -0.05], abs=1e-6)
    readings = turn(env, 60.0)[-1][4]["readings"]
    for _ in range(20):
        seen, _, _, _, info = env.step(STILL)
    readings = info["readings"]
    assert readings["poured"] > 0.005 and readings["spilled"] == 0.0
    assert seen["scale"][0] == pytest.approx(readings["poured"] + readings["elsewhere"], abs=3e-4)
    env.close()


@pytest.mark.slow
def test_the_arm_carries_the_vibration() -> None:
    """The servo follows a vibration of 1 mm from peak to peak at 20 Hz, if not exactly, and the arm touches nothing."""
    env = make("DoseSpoon", arm=True, obs=["tool", "scale"], action_repeat=1)
    env.reset(seed=0, options={"nominal": True})
    spread = []
    for amplitude in (-1.0, 1.0):
        action, away = STILL.copy(), []
        action[6:] = amplitude, -1.0
        for _ in range(150):
            seen = env.step(action)[0]
            away.append(seen["tool"][:3] - env.carrier.commanded.position)
        spread.append(np.ptp(np.array(away)[-60:], axis=0))
    assert spread[0].max() < 1e-4 and 5e-4 < spread[1][1] < 2e-3 and spread[1][1] > 2.0 * spread[1][[0, 2]].max()
    assert env.carrier.arm_readings["surroundings_contacts"] == 0.0
    env.close()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_the_script_shakes_salt_into_the_cup() -> None:
    """Upright it keeps all of it; turned over, what has left the holes is in the cup or falls there."""
    env = make("DoseShaker", task=load_task("DoseShaker").model_copy(update={"steps": 2000}), randomize={})
    _, info, _ = play(env)  # 4 s
    readings, passed = info["readings"], float(env.solver.passed_mass(TOOL).sum())
    grain = env.solver.masses()[0]
    assert passed > 20 * grain and readings["spilled"] == 0.0
    held = readings["held"] + readings["poured"] + readings["elsewhere"]
    assert held == pytest.approx(1000 * grain, rel=1e-6)
    assert readings["poured"] <= passed * (1 + 1e-6) and readings["poured"] > passed - 30 * grain
    # at most the law's rate times the time after it was turned over
    law = env.solver.colliders[TOOL].orifices[0]
    assert passed < 13 * law.rate(env.solver.bodies[0].material.density) * 4.0
    env.close()


def test_holes_lie_in_the_cap() -> None:
    shape = tool_shape("shaker")
    (orifice,) = shape.orifices(3.5e-4)
    assert orifice.positions.shape == (13, 3) and orifice.ratio == pytest.approx(2.5e-3 / 3.5e-4)
    apart = np.linalg.norm(orifice.positions[:, None] - orifice.positions, axis=2) + np.eye(13)
    assert apart.min() > 1.5 * orifice.diameter
    assert tool_shape("bottle").orifices(3.5e-4) == []


def test_what_a_shaker_cannot_be_used_with_is_refused() -> None:
    with pytest.raises(ConfigError, match="'shaker' with a material without grain_diameter"):
        make("DoseShaker", material="flour")
    with pytest.raises(ConfigError, match="randomize: material with the tool 'shaker'"):
        make("DoseShaker", randomize={"material": ["salt", "sugar"]})
    with pytest.raises(ConfigError, match="'shaker' with a wall of 0.003 m: its holes are smaller than a cell"):
        build_tool_sdf("shaker", 0.003)
