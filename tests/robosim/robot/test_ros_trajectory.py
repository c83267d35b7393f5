"""joint_trajectory.yaml: its clock, and the names of frame and joints."""

import numpy as np
import pytest
from bundled import rehearsal

from robosim.base.errors import ConfigError, UnknownName
from robosim.commands.main import main
from robosim.config.motion import JointTrajectoryConfig
from robosim.robot.model import Arm
from robosim.robot.ros_trajectory import make_joint_trajectory, name_joints
from robosim.robot.timing import SmoothMotion
from robosim.scene.models import assemble

ARM = [f"A{i}" for i in range(1, 8)]


@pytest.fixture(scope="module")
def motion() -> SmoothMotion:
    """A swing of all joints by 0.05 rad within 0.5 s."""
    times = np.linspace(0.0, 0.5, 26)
    share = times / 0.5
    swing = 10 * share**3 - 15 * share**4 + 6 * share**5  # at rest at both ends
    limits = Arm(assemble("spoon")).limits(rehearsal("spoon").limits)
    return SmoothMotion(times, 0.05 * swing[:, None] + np.arange(7) / 10, limits, {"a": 0.0}, ARM)


def time_of(point: dict) -> float:
    return point["time_from_start"]["sec"] + 1e-9 * point["time_from_start"]["nanosec"]


def test_a_motion_that_begins_later_is_the_same_after_a_rest(motion: SmoothMotion) -> None:
    """While the fingers close the arm rests at its first point; then each point comes later by that time."""
    plain, later = make_joint_trajectory(motion, ARM), make_joint_trajectory(motion, ARM, start=1.25)
    rest, *points = later["points"]
    assert time_of(rest) == 0.0 and rest["positions"] == plain["points"][0]["positions"]
    assert rest["velocities"] == rest["accelerations"] == [0.0] * 7
    for point, same in zip(points, plain["points"], strict=True):
        assert time_of(point) == pytest.approx(time_of(same) + 1.25, abs=2e-9)
        assert point["positions"] == same["positions"]
        assert point["velocities"] == pytest.approx(same["velocities"], abs=2e-9)


def test_frame_and_joints_are_named_by_the_configuration(motion: SmoothMotion) -> None:
    """As `--set joint_trajectory.KEY=VALUE` sets them."""
    def names(*settings: str) -> JointTrajectoryConfig:
        return rehearsal("spoon", *(f"joint_trajectory.{one}" for one in settings)).joint_trajectory

    message = make_joint_trajectory(motion, ARM)
    assert message["header"]["frame_id"] == "" and message["joint_names"] == ARM
    message = make_joint_trajectory(motion, ARM, names("frame_id=lbr_link_0", "joint_prefix=lbr_"))
    assert message["header"]["frame_id"] == "lbr_link_0"
    assert message["joint_names"] == [f"lbr_{name}" for name in ARM]
    assert name_joints(ARM, names("joint_names.A2=shoulder")) == ["A1", "shoulder", *ARM[2:]]


def test_names_that_cannot_be_used_are_refused_before_any_work(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(UnknownName, match="joint 'A8'; valid: A1, A2"):
        name_joints(ARM, JointTrajectoryConfig(joint_names={"A8": "wrist"}))
    with pytest.raises(ConfigError, match="a different name for each joint"):
        name_joints(ARM, JointTrajectoryConfig(joint_names={"A1": "A2"}))
    assert main(["rehearse", "spoon", "--out", "nowhere", "--set", "joint_trajectory.joint_prefix=a",
                 "--set", "joint_trajectory.joint_names.A1=b"]) == 2
    assert "joint_prefix = 'a' with joint_names; accepted: one of the two" in capsys.readouterr().err
