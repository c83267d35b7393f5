"""Laws of poses, waypoint paths and smoothed joint motion; test_any_arm.py has the inverse kinematics."""

import numpy as np
import pytest
from bundled import plan_of
from scipy.spatial.transform import Rotation

from mpm.geometry.rigid_motion import Pose, exponential, logarithm, screw
from robosim.planning.plan import Plan
from robosim.robot.joint_control import JointSmoother
from robosim.robot.model import Arm
from robosim.robot.timing import compute_time_scale
from robosim.scene.models import assemble


def random_pose(rng: np.random.Generator) -> Pose:
    return Pose(rng.uniform(-1, 1, 3), Rotation.random(random_state=rng).as_quat(scalar_first=True))


def test_exponential_undoes_logarithm() -> None:
    rng = np.random.default_rng(0)
    for _ in range(5):
        a, b = random_pose(rng), random_pose(rng)
        end = exponential(a, logarithm(a, b))
        assert end.position == pytest.approx(b.position, abs=1e-12)
        assert end.matrix == pytest.approx(b.matrix, abs=1e-12)


def test_screw_velocity_is_the_derivative_of_its_poses() -> None:
    """Central differences of the sampled poses equal the twist, which is constant in body axes."""
    rng = np.random.default_rng(3)
    a, b, n, T = random_pose(rng), random_pose(rng), 2000, 0.7
    s = screw(a, logarithm(a, b), T, n)
    h = T / n
    for k in (1, 700, 1500):
        linear = (s.positions[k + 1] - s.positions[k - 1]) / (2 * h)
        assert linear == pytest.approx(s.linear[k], rel=1e-4, abs=1e-5)
        rotation = Rotation.from_matrix(s.matrices[k + 1] @ s.matrices[k - 1].T).as_rotvec() / (2 * h)
        assert rotation == pytest.approx(s.angular[k], rel=1e-4, abs=1e-5)
    body = np.einsum("nji,nj->ni", s.matrices, s.linear)
    assert np.ptp(body, axis=0).max() < 1e-12
    assert s.positions[-1] == pytest.approx(b.position, abs=1e-12)


@pytest.fixture
def spoon() -> Plan:
    return plan_of("spoon")


def test_the_path_rests_exactly_at_stops_and_is_smooth(spoon: Plan) -> None:
    path, config = spoon.path, spoon.config
    for waypoint, pose in zip(config.waypoints, path.poses):
        if waypoint.dwell:
            rest = path.pose(path.times[waypoint.name] + waypoint.dwell * 0.9)
            assert rest.position == pytest.approx(pose.position, abs=1e-12)
    times = np.arange(0.0, path.duration, 1e-3)
    x = np.array([path.pose(t).position for t in times])
    acceleration = np.diff(x, 2, axis=0) / 1e-6
    # the limit bounds the peak of a rounded corner, 1.875 times its mean; screws add their own curvature
    assert np.linalg.norm(acceleration, axis=1).max() < 1.5 * config.path.acceleration
    jump = np.linalg.norm(np.diff(acceleration, axis=0), axis=1)
    assert jump.max() < 0.15 * config.path.acceleration


def test_smoothed_motion_is_near_the_path(spoon: Plan) -> None:
    """Within its limits it is by the verification case `jerk_limits`."""
    motion = spoon.motion
    times = np.arange(0.0, motion.duration, 1e-3)
    states = [motion.state(t) for t in times]
    q, qd = np.array([s.q for s in states]), np.array([s.qd for s in states])
    assert np.abs(np.diff(q, axis=0) / 1e-3 - 0.5 * (qd[1:] + qd[:-1])).max() < 1e-4
    assert motion.delay < 0.05
    worst = max(np.linalg.norm(spoon.arm.tool_pose(s.q).position - spoon.path.pose(t).position)
                for t, s in list(zip(times, states))[::7])
    assert worst < 5e-4


def test_a_motion_scaled_by_its_time_scale_is_at_its_limits(spoon: Plan) -> None:
    """Whichever of speed, acceleration and jerk is the critical one."""
    limits, times = spoon.arm.limits(spoon.config.limits), np.linspace(0.0, 1.0, 201)
    for amplitude, frequency in ((2.0, 1.0), (0.3, 4.0), (0.02, 20.0)):
        q = np.tile(amplitude * np.sin(2.0 * np.pi * frequency * times)[:, None], (1, 7))
        scale = compute_time_scale(times, q, limits).max()
        assert compute_time_scale(scale * times, q, limits).max() == pytest.approx(1.0, abs=1e-6)


def test_a_smoother_in_a_loaded_state_continues_to_the_bit() -> None:
    """Also where the goal stands still or speed is saturated, so that the request of a step is that of the last one."""
    arm = Arm(assemble("spoon"))
    limits = arm.step_limits()
    one, other = (JointSmoother(limits, 0.002, arm) for _ in range(2))
    one.restart(arm.home)
    for goal in (arm.home + 0.05, arm.upper + 1.0):
        for _ in range(12):
            for _ in range(40):
                one.step(goal, np.zeros(7))
            other.load(one.state())
            for _ in range(10):
                assert np.array_equal(one.step(goal, np.zeros(7)), other.step(goal, np.zeros(7)))
