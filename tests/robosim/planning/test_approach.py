"""The way from the arm's home to the start: free, within limits, around what stands there; or why there is none."""

from itertools import pairwise

import numpy as np
import pytest
from bundled import plan_of, rehearsal

from robosim.base.errors import ConfigError
from robosim.config.rehearsal import RehearsalConfig
from robosim.config.scene import ObstacleConfig
from robosim.planning.approach import MARGIN, between, find_route, plan_approach
from robosim.planning.clearance import Clearances
from robosim.planning.plan import Plan, plan_motion
from robosim.robot.timing import StraightMotion


@pytest.fixture
def spoon() -> Plan:
    return plan_of("spoon")


def check(plan: Plan, config: RehearsalConfig, motion: StraightMotion) -> float:
    """Assert that a motion starts and ends at rest where it should, within limits; return its least clearance [m]."""
    arm, limits = plan.arm, plan.arm.limits(config.limits)
    times = np.linspace(0.0, motion.duration, 400)
    states = [motion.state(time) for time in times]
    assert np.allclose(states[0].q, arm.home, atol=1e-9)
    assert np.allclose(states[-1].q, plan.motion.state(0.0).q, atol=1e-6)
    assert max(np.abs(states[k].qd).max() for k in (0, -1)) < 1e-6
    assert all(np.all(np.abs(s.qd) <= 0.5 * limits.velocity + 1e-9) for s in states)
    assert all(np.all(np.abs(s.qdd) <= 0.25 * limits.acceleration + 1e-9) for s in states)
    torques = np.array([arm.inverse_dynamics(*s) for s in states])
    assert np.all(np.abs(torques) <= 0.9 * arm.torque_limits + 1e-9)
    clearances = Clearances(config, arm, is_standing=True)
    return min(clearances.least(s.q, MARGIN).distance for s in states[::4])


def test_the_way_is_straight_where_it_is_free(spoon: Plan) -> None:
    approach = plan_approach(spoon.config, spoon.arm, spoon.motion.state(0.0).q)
    assert len(approach.motion.corners) == 2
    assert check(spoon, spoon.config, approach.motion) >= MARGIN
    q = np.array([approach.motion.state(t).q for t in np.linspace(0.0, approach.motion.duration, 50)])
    start, end = q[0], q[-1]
    along = (q - start) @ (end - start) / ((end - start) @ (end - start))
    assert np.abs(q - start - along[:, None] * (end - start)).max() < 1e-6


def test_it_leads_around_an_obstacle(spoon: Plan) -> None:
    """A post in the middle of the straight way."""
    straight = plan_approach(spoon.config, spoon.arm, spoon.motion.state(0.0).q).motion
    middle = spoon.arm.tool_pose(straight.state(0.5 * straight.duration).q).position
    x, y, z = map(float, middle)
    post = ObstacleConfig(name="post", position=(x, y, z), half=(0.03, 0.03, 0.10))
    config = spoon.config.model_copy(update={"obstacles": (post,)})
    approach = plan_approach(config, spoon.arm, spoon.motion.state(0.0).q)
    assert len(approach.motion.corners) > 2
    assert check(spoon, config, approach.motion) > 0.9 * MARGIN
    assert min(Clearances(config, spoon.arm).least(straight.state(t).q, MARGIN).distance
               for t in np.linspace(0.0, straight.duration, 60)) < 0.0


def test_routes_avoid_walls_in_the_plane() -> None:
    """A wall with a gap in the square: through the gap; a wall without one: no route."""
    begin, end, limits = np.array([-0.8, 0.0]), np.array([0.8, 0.0]), (np.full(2, -1.0), np.full(2, 1.0))
    for gap, is_found in ((0.6, True), (2.0, False)):
        route = find_route(begin, end, limits, lambda q, gap=gap: abs(q[0]) > 0.1 or q[1] > gap)
        assert (route is not None) == is_found
        if route is not None:
            assert np.array_equal(route[0], begin) and np.array_equal(route[-1], end)
            passed = np.concatenate([between(a, b, 0.01) for a, b in pairwise(route)])
            assert passed[np.abs(passed[:, 0]) < 0.07, 1].min() > gap


def test_a_home_that_collides_is_said_and_the_plan_stands(spoon: Plan) -> None:
    x, y, z = map(float, spoon.arm.tool_pose(spoon.arm.home).position)
    post = {"name": "post", "position": [x, y, z], "half": [0.03, 0.03, 0.03]}
    plan = plan_motion(rehearsal("spoon", obstacles=[post]))
    assert plan.approach is None
    assert "in home" in plan.no_approach and "post overlap by" in plan.no_approach


def test_a_full_tool_has_no_way_from_home() -> None:
    plan = plan_of("bottle")
    assert plan.approach is None and "the tool is full at the start" in plan.no_approach


def test_an_open_hand_keeps_clear_of_the_tool_that_stands() -> None:
    plan = plan_of("pick_bottle")
    assert plan.approach is not None and plan.approach.clearance.distance > 0.9 * MARGIN
    stand = plan.config.waypoints[1]
    x, y, _ = stand.position
    wall = ObstacleConfig(name="wall", position=(x, y, 0.25), half=(0.2, 0.2, 0.3))
    with pytest.raises(ConfigError, match="wall overlap by .* mm; accepted"):
        plan_approach(plan.config.model_copy(update={"obstacles": (wall,)}), plan.arm, plan.motion.state(0.0).q)
