"""Drivers of one's own: what they command is followed as the plan is, or refused by name, time and limit."""

from typing import Any

import numpy as np
import pytest
from bundled import plan_of

import robosim
from robosim.cell.drivers import OwnDriver, RobotState
from robosim.planning.plan import Plan
from robosim.robot.timing import JointState

DT = 1e-3


@pytest.fixture
def plan() -> Plan:
    return plan_of("shovel")


def make(plan: Plan, own: Any, latency: float = 0.0) -> OwnDriver:
    """A driver that begins at 0.5 s, of an arm that is where it is planned to be."""
    return OwnDriver(own, plan.motion, 0.5, latency, plan.arm, DT, lambda time, planned: RobotState(
        time, planned.q, planned.qd, plan.arm.tool_pose(planned.q), np.zeros(6), planned))


def drive(plan: Plan, own: Any, steps: int = 3, latency: float = 0.0) -> list[JointState]:
    """The commands of a driver in its first steps."""
    driver = make(plan, own, latency)
    return [driver.command(0.5 + k * DT) for k in range(steps)]


def test_the_plan_as_a_driver_is_the_plan(plan: Plan) -> None:
    for k, command in enumerate(drive(plan, lambda state: state.planned, 50)):
        for given, wanted in zip(command, plan.motion.state(0.5 + k * DT - 0.5)):
            np.testing.assert_array_equal(given, wanted)


def test_angles_alone_have_the_speed_of_their_difference(plan: Plan) -> None:
    first = plan.motion.state(0.0).q
    commands = drive(plan, lambda state: first + 0.2 * state.time)
    np.testing.assert_allclose(commands[2].qd, 0.2, atol=1e-9)
    late = drive(plan, lambda state: first + 0.2 * state.time, latency=DT)
    np.testing.assert_array_equal(late[2].q, commands[1].q)


def test_a_driver_has_its_own_duration(plan: Plan) -> None:
    driver = make(plan, type("Short", (), {"duration": 0.25, "command": lambda self, state: state.planned.q})())
    assert driver.name == "Short" and driver.duration == 0.75


def nan(state: RobotState) -> np.ndarray:
    return np.full(7, np.nan) if state.time > 1.5e-3 else state.planned.q


def jump(state: RobotState) -> np.ndarray:
    return state.planned.q + (0.01 * np.eye(7)[2] if state.time > 0.5e-3 else 0.0)


@pytest.mark.parametrize(("own", "message"), [
    (nan, r"driver nan at t = 0.0020 s commands \[nan, [^\[]*; accepted: finite numbers"),
    (jump, r"driver jump at t = 0.0010 s commands joint A3 at 10 rad/s; accepted: up to 1.745 rad/s"),
    (lambda state: state.q[:3], r"driver <lambda> at t = 0.0000 s commands array.*; accepted: joint angles \(7,\)"),
    (lambda state: tuple(state.planned[:2]), r"commands tuple of length 2; accepted: joint angles"),
    (lambda state: state.planned.q + 0.01, r"begins with joint A1 0.01 rad from .*; accepted: up to 0.001484 rad"),
    (lambda state: None, r"commands None; accepted: joint angles"),
    (lambda state: state.planned._replace(q=np.full(7, 9.0)), r"joint A1 to 9.0000 rad; accepted: -2.9671 to 2.9671"),
    (lambda state: state.planned._replace(qd=np.full(7, 5.0)), r"joint A1 at 5 rad/s; accepted: up to 1.484 rad/s"),
])
def test_commands_that_cannot_be_followed_are_refused(plan: Plan, own: Any, message: str) -> None:
    with pytest.raises(robosim.DriverFault, match=message):
        drive(plan, own)


@pytest.mark.parametrize(("own", "message"), [
    (3, "driver = 3; accepted: a function of the robot's state, or an object with a method `command`"),
    (type("Stir", (), {"command": lambda self, state: state.planned}), "driver = class Stir; accepted: a function"),
    (type("Mute", (), {"command": lambda self: None})(), r"driver = .*lambda>\(\); accepted: a function of the"),
    (type("Endless", (), {"duration": np.inf, "command": lambda self, state: state.planned})(),
     "driver Endless: duration = inf s; accepted: above 0, up to 600 s"),
])
def test_what_is_no_driver_is_refused(plan: Plan, own: Any, message: str) -> None:
    with pytest.raises(robosim.ConfigError, match=message):
        drive(plan, own)
