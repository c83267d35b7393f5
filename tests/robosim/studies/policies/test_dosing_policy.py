"""Dosing controllers as policies: actions that carry a command out."""

from types import SimpleNamespace
from typing import Any

import gymnasium
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from robosim.base.errors import ConfigError
from robosim.dosing import CONTROLLERS
from robosim.dosing.command import DoseCommand
from robosim.dosing.numbers import DosingNumbers
from robosim.envs.carrier import Carrier
from robosim.studies.policies.dosing import DosingPolicy
from robosim.studies.policies.make import make_policy
from robosim.studies.policies.tool_view import ToolView, numbers_of, terms_of
from robosim.studies.tuning.curve import given_numbers
from robosim.tasks.actions import ActionScaling
from robosim.tasks.task import load_task

SPOON = load_task("DoseSpoon")
NUMBERS = numbers_of(SPOON, "pi")
LEVEL = np.zeros(3)


def stub(task: Any = SPOON, terms: tuple[str, ...] = terms_of(SPOON)) -> Any:
    """Return what a policy takes of an environment, without a field."""
    return SimpleNamespace(task=task, TASK="DoseSpoon", action_repeat=10,
                           observation_space=SimpleNamespace(spaces=dict.fromkeys(terms)))


def observe(carrier: Carrier, shown: float = 0.0, time: float = 0.0) -> dict[str, np.ndarray]:
    pose = carrier.commanded
    return {"tool": np.concatenate(pose), "goal": np.array(SPOON.goal) - pose.position, "time": np.array([time]),
            "scale": np.array([shown]), "target": np.array([5e-3])}


@pytest.mark.parametrize("velocity", [(0.0, 0.0, 0.0), (0.02, -0.01, 0.015)], ids=["turns about the lip", "moves, too"])
def test_actions_turn_about_the_lip_and_move_it(velocity: tuple[float, ...]) -> None:
    """Over a second, from a tilt of 20 deg; the tool's box is wide enough."""
    carrier, view, scaling = Carrier(SPOON), ToolView(stub()), ActionScaling(SPOON)
    tilted = Rotation.from_euler("ZY", (90.0, 20.0), degrees=True).as_quat(scalar_first=True)
    carrier.commanded = carrier.commanded._replace(quaternion=tilted, position=np.array([0.78, -0.03, 0.17]))
    first = view.look(observe(carrier))
    assert np.degrees(first.tilt) == pytest.approx(20.0)
    np.testing.assert_allclose(first.goal, SPOON.goal)
    rate = np.radians(25.0)
    for _ in range(50):
        sight = view.look(observe(carrier))
        action = view.act(sight, DoseCommand(rate, np.array(velocity), 2e-4, 30.0, False))
        *motion, vibration = scaling.velocities(action)
        np.testing.assert_allclose(vibration, [2e-4, 30.0], rtol=1e-4)
        for _ in range(10):
            carrier.command(*motion)
    last = view.look(observe(carrier))
    assert np.degrees(last.tilt - first.tilt) == pytest.approx(25.0, abs=1e-3)
    np.testing.assert_allclose(last.lip - first.lip, velocity, atol=2e-4)


def test_a_motion_that_is_too_fast_is_carried_out_more_slowly_along_the_same_way() -> None:
    view, scaling = ToolView(stub()), ActionScaling(SPOON)
    sight = view.look(observe(Carrier(SPOON)))
    slow, fast = (scaling.velocities(view.act(sight, DoseCommand(k * 1.0, k * np.array([0.02, 0.03, 0.0]), 0.0, 30.0,
                                                                 False))) for k in (1.0, 10.0))
    assert max(np.abs(fast[0]).max() / SPOON.action.speed, np.abs(fast[1]).max() / SPOON.action.angular_speed) == \
        pytest.approx(1.0, rel=1e-6)
    for one, other in zip(slow[:2], fast[:2], strict=True):
        np.testing.assert_allclose(other / np.linalg.norm(np.concatenate(fast[:2])),
                                   one / np.linalg.norm(np.concatenate(slow[:2])), atol=1e-6)
    assert slow[2][0] == 0.0


def test_the_balance_is_tared_at_the_start() -> None:
    view, carrier = ToolView(stub()), Carrier(SPOON)
    assert view.look(observe(carrier, 0.25)).shown == 0.0
    second = view.look(observe(carrier, 0.253, time=0.5))
    assert second.shown == pytest.approx(3e-3) and second.time == pytest.approx(0.5 * SPOON.steps * SPOON.step_dt)


def test_the_tilt_goes_on_beyond_half_a_turn_and_back() -> None:
    carrier, view = Carrier(SPOON), ToolView(stub())
    tilts = [*range(0, 240, 30), *range(210, -60, -30)]
    for tilt in tilts:
        turned = Rotation.from_euler("ZY", (90.0, tilt), degrees=True).as_quat(scalar_first=True)
        carrier.commanded = carrier.commanded._replace(quaternion=turned)
        assert np.degrees(view.look(observe(carrier)).tilt) == pytest.approx(tilt, abs=1e-6)


@pytest.mark.parametrize("name", CONTROLLERS)
def test_a_policy_by_name_begins_towards_the_cup(name: str) -> None:
    env, carrier = stub(), Carrier(SPOON)
    env.observation = observe(carrier)
    action = make_policy(name, env, 0)(env.observation)
    assert action.shape == (8,) and action.dtype == np.float32 and np.abs(action).max() <= 1.0
    lip = carrier.commanded.position + carrier.commanded.matrix @ [0.035, 0.0, 0.0]
    assert action[:3] @ (np.array(SPOON.goal) - lip) > 0.0 and action[6] == -1.0


@pytest.mark.parametrize(("tolerances", "accepted"), [({}, 0.3e-3), ({"tolerance_percent": 20.0}, 1e-3),
                                                      ({"tolerance_percent": 0.0, "tolerance_g": 0.1}, 0.1e-3)])
def test_a_controller_is_given_the_tolerances_of_the_task(tolerances: dict[str, float], accepted: float,
                                                          monkeypatch: pytest.MonkeyPatch) -> None:
    env = stub(SPOON.model_copy(update={"dose": SPOON.dose.model_copy(update=tolerances)}))
    env.observation = observe(Carrier(SPOON))
    policy, given = DosingPolicy("pi", env), []
    start = policy.controller.start
    monkeypatch.setattr(policy.controller, "start", lambda *mass: (given.append(mass), start(*mass)))
    policy(env.observation)
    assert given == [pytest.approx((5e-3, accepted))]


def test_what_a_policy_refuses() -> None:
    with pytest.raises(ConfigError, match="tool 'shovel': its pouring edge is not known; accepted: a tool with lip"):
        DosingPolicy("pi", stub(SPOON.model_copy(update={"tool": "shovel"})))
    pour = load_task("SpoonPour")
    with pytest.raises(ConfigError, match="no section dose, or no action.vibration; accepted: dosing tasks"):
        DosingPolicy("pi", stub(pour))
    with pytest.raises(ConfigError, match="policy 'pi': the task has no section dose"):
        numbers_of(pour, "policy 'pi'")
    with pytest.raises(ConfigError, match="scale, target missing; accepted for dosing controllers"):
        DosingPolicy("pi", stub(terms=("tool", "goal", "time")))
    without = SPOON.model_copy(update={"dose": SPOON.dose.model_copy(update={"controllers": None})})
    with pytest.raises(ConfigError, match=r"dose.controllers is missing; accepted: .*DoseSpoon"):
        DosingPolicy("pi", stub(without))
    for changed in ({"amplitude": 0.004}, {"frequency": 200.0}):
        vibration = NUMBERS.vibration.model_copy(update=changed)
        strong = DosingNumbers.model_validate(NUMBERS.model_dump() | {"vibration": vibration})
        with pytest.raises(ConfigError, match="accepted in this task: up to 0.001 m at 20 to 60 Hz"):
            DosingPolicy("pi", stub(), strong)


def test_a_pour_curve_needs_a_receiver() -> None:
    with pytest.raises(ConfigError, match="ScoopTo: no empty container, .*; accepted: dosing tasks that pour"):
        given_numbers(load_task("ScoopTo"), "ScoopTo")
    assert given_numbers(SPOON, "DoseSpoon") == NUMBERS


def test_a_tool_that_begins_empty_is_filled_by_the_script_and_not_with_an_arm() -> None:
    task = load_task("ScoopTo")
    for change, robot, message in (({"script": None}, None, "no section script; accepted: one with it"),
                                   ({}, object(), "arm=True with a tool that begins empty; accepted: without an arm")):
        one = stub(task.model_copy(update=change), terms_of(task))
        one.carrier = SimpleNamespace(robot_data=robot)
        with pytest.raises(ConfigError, match=message):
            DosingPolicy("pi", one)


@pytest.mark.long
def test_a_scoop_is_weighed_and_pours_back_what_is_too_much() -> None:
    """The wrist shows its load to 0.2 %; what it holds at the end is the target, within what is accepted."""
    env: Any = gymnasium.make("robosim/ScoopTo-v0").unwrapped
    observation, info = env.reset(seed=0)
    policy = DosingPolicy("pi", env)
    loads, is_over = [], False
    while not is_over:
        observation, _, terminated, truncated, info = env.step(policy(observation))
        if policy.command is None:
            loads.append(info["readings"]["held"])
        is_over = terminated or truncated
    assert policy._scooping.load == pytest.approx(loads[-1], rel=2e-3)
    assert loads[-1] > 1.5 * info["readings"]["target_mass"]
    assert info["is_success"]
    assert info["readings"]["seconds"] < 20.0


def test_numbers_of_another_tool_or_a_longer_dose_are_refused() -> None:
    scoop = DosingNumbers.model_validate(NUMBERS.model_dump() | {"tool": "scoop"})
    long = DosingNumbers.model_validate(NUMBERS.model_dump() | {"motion": {"duration": 20.1}})
    for wrong, message in ((scoop, "for the tool 'scoop'; the tool is 'spoon'"),
                           (long, "motion.duration = 20.1 s; accepted in this task: up to its 10000 steps")):
        with pytest.raises(ConfigError, match=f"policy 'pi': .*{message}"):
            DosingPolicy("pi", stub(), wrong)
    with pytest.raises(ConfigError, match="policy 'pi': dose.controllers: numbers of DoseScoop for the tool 'scoop'"):
        numbers_of(SPOON.model_copy(update={"dose": SPOON.dose.model_copy(update={"controllers": "DoseScoop"})}),
                   "policy 'pi'")
