"""The tool about its lip: what stays where it is, and what is bounded."""

import numpy as np
import pytest

from mpm import Pose
from robosim.dosing.command import DoseCommand
from robosim.dosing.motion import Vibration
from robosim.planning.lip_motion import LipMotion

DT = 1e-3
LIP = np.array([0.035, 0.0, 0.0])
START = Pose(np.array([0.7, 0.1, 0.2]), np.array([np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)]))  # its tip points along y
GOAL = np.array([0.7, 0.15, 0.2])
STILL = np.zeros(3)


def make_motion(**changes: object) -> LipMotion:
    return LipMotion(**{"start": START, "lip": LIP, "goal": GOAL, "largest_tilt": np.radians(100.0)} | changes)  # pyright: ignore[reportArgumentType]


def test_the_lip_stays_where_it_is_while_the_tool_tilts() -> None:
    """The tip falls: the tool's x axis points down by the tilt."""
    motion = make_motion()
    place = motion.lip.copy()
    for _ in range(1000):
        pose = motion.advance(DoseCommand(np.radians(30.0), STILL, 0.0, 0.0, False), DT)
        assert np.abs(pose.apply(LIP[None])[0] - place).max() < 1e-12
    assert motion.tilt == pytest.approx(np.radians(30.0))
    assert pose.matrix[:, 0] == pytest.approx([0.0, np.cos(motion.tilt), -np.sin(motion.tilt)], abs=1e-12)


def test_tilt_and_lip_stay_within_what_was_checked() -> None:
    motion = make_motion()
    for rate, end in ((2.0, np.radians(100.0)), (-2.0, 0.0)):
        for _ in range(1500):
            motion.advance(DoseCommand(rate, np.array([0.01, 0.05, 0.3]), 0.0, 0.0, False), DT)
        assert motion.tilt == end
    assert motion.lip == pytest.approx(GOAL)


def test_a_vibration_moves_the_tool_alone() -> None:
    """By what `Vibration` gives, with the frequency that was commanded last; the lip's own place stays."""
    motion, vibration, frequency = make_motion(axis="z"), Vibration("z"), 20.0
    for k in range(600):
        amplitude = 5e-4 if k < 300 else 0.0
        pose = motion.advance(DoseCommand(0.0, STILL, amplitude, frequency if k < 300 else 0.0, False), DT)
        assert np.array_equal(pose.position, vibration.shake(motion.pose(), DT, amplitude, frequency).position)
    assert motion.lip == pytest.approx(START.apply(LIP[None])[0], abs=1e-12)
