"""Recorded motions for tests: plain ones with constant velocities."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from robosim.config.rehearsal import RehearsalConfig, load_rehearsal
from robosim.planning import recorded_motions
from robosim.planning.recorded_motions import place_target
from robosim.tasks.task import load_task


@pytest.fixture
def write_motions(tmp_path: Path) -> Callable[..., Path]:
    """Write motions of sub-tasks: 2 cm/s along y and 10 deg/s about x; returns their folder."""

    def write(*names: str) -> Path:
        for name in names:
            action = load_task(name).action
            row = np.array([0.0, 0.02 / action.speed, 0.0, np.radians(10.0) / action.angular_speed, 0.0, 0.0])
            np.savez(tmp_path / f"{name}.npz", actions=np.tile(row[: action.dimensions], (100, 1)), action_repeat=10)
        return tmp_path

    return write


@pytest.fixture
def chained(write_motions: Callable[..., Path], monkeypatch: pytest.MonkeyPatch) -> RehearsalConfig:
    """The rehearsal of the spoon with three plain motions."""
    folder = write_motions("SpoonScoop", "SpoonTranslate", "SpoonPour")
    monkeypatch.setattr(recorded_motions, "trained", lambda name: folder / f"{name}.npz")
    return place_target(load_rehearsal("spoon", {"trajectory": "recorded"}))
