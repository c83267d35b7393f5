"""A rehearsal with a dose, from file to report, and what of one without a dose it leaves as it is."""

import json
from pathlib import Path

import numpy as np
import pytest

from robosim.base.errors import ConfigError
from robosim.config.rehearsal import RehearsalConfig, load_rehearsal
from robosim.dosing.command import DoseCommand, DoseSight
from robosim.planning.plan import plan_motion
from robosim.recordings.reader import FILE, Recording
from robosim.rehearsal.metrics import BOUNDS, find_missed, get_bounds
from robosim.rehearsal.run import RehearsalRun
from robosim.rehearsal.session import RunOptions, check_config, simulate

STEPS = 40


@pytest.fixture(scope="module")
def short() -> RehearsalConfig:
    """The dose of the spoon with a way of 2 cm and cells of 10 mm."""
    data = load_rehearsal("dose_spoon").model_dump()
    held, _, over, _, home = data["waypoints"]
    for waypoint in (held, home):
        waypoint |= {"position": (0.72, 0.165, 0.165), "dwell": 0.2, "speed": 0.1, "acceleration": 1.0}
    over |= {"dwell": 0.0, "speed": 0.1, "acceleration": 1.0}
    data |= {"waypoints": [held, over, home], "grasp_time": 0.05, "least_load": 0.0}
    data["field"] |= {"cell": 0.01, "grains_per_cell": 4}
    data["dose"] |= {"settle": 0.2, "time_limit": 10.0}
    return check_config(RehearsalConfig.model_validate(data))


class ThereAndBack:
    """Tilts to 75 deg and back with 60 deg/s."""

    def start(self, target: float, accepted: float) -> None:
        self.rate = np.radians(60.0)

    def command(self, sight: DoseSight) -> DoseCommand:
        if sight.tilt > np.radians(75.0):
            self.rate = -abs(self.rate)
        return DoseCommand(self.rate, np.zeros(3), 0.0, 0.0, self.rate < 0.0 and sight.tilt == 0.0)


@pytest.mark.slow
def test_before_its_dose_a_rehearsal_is_one_without(short: RehearsalConfig) -> None:
    """To the bit: grains, joints and readings."""
    states = []
    for config in (short, short.model_copy(update={"dose": None})):
        run = RehearsalRun(plan_motion(config))
        for k in range(STEPS):
            run.step(k)
        assert run.driver.motion_time(run.time) == run.time - config.grasp_time
        states.append((run.solver.positions(), run.cell.data.qpos.copy(), run.readings.stack_steps("torque"),
                       run.readings.stack_steps("commanded")))
    assert all(np.array_equal(a, b) for a, b in zip(*states))


def test_bounds_ask_for_the_dose_in_place_of_the_delivery(short: RehearsalConfig) -> None:
    bounds = get_bounds(short)
    assert set(BOUNDS) - set(bounds) == {"delivered_fraction"}
    assert bounds["dose_error_kg"][:2] == pytest.approx((-4e-4, 4e-4))
    assert set(BOUNDS) <= set(get_bounds(short.model_copy(update={"dose": None})))


@pytest.mark.long
def test_a_dose_from_file_to_report(short: RehearsalConfig, tmp_path: Path) -> None:
    """The motion goes on where it rested; figures, page and recording have the dose; no motion is exported."""
    result = simulate(short, tmp_path / "out", RunOptions(driver=ThereAndBack()))
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["dose_kg"] > 1e-3 and report["dose_error_kg"] == pytest.approx(report["dose_kg"] - 0.02)
    assert report["dosing_time_s"] == pytest.approx(2.0 * 75.0 / 60.0, abs=0.1)
    assert report["dose_kg"] + report["retained_fraction"] * report["scooped_mass_kg"] == pytest.approx(
        report["scooped_mass_kg"] * (1.0 - report["spilled_fraction"]), abs=2.0 * report["dose_grain_mass_kg"])
    assert ("dose_error_kg" in " ".join(find_missed(result.figures, short))) == (abs(report["dose_error_kg"]) > 4e-4)
    times, q, commanded = (result.curves[name] for name in ("time", "q", "commanded"))
    assert len(times) == pytest.approx(report["simulated_time_s"] / short.host_dt, abs=1)
    assert np.abs(np.diff(commanded[:, :3], axis=0)).max() < 1e-3  # no jump: 1 m/s at most
    assert np.abs(np.diff(q, axis=0)).max() < 3e-3  # nor of the joints
    assert commanded[-1, :3] == pytest.approx(short.waypoints[-1].position, abs=1e-4)
    assert report["tool_tracking_error_max_m"] < BOUNDS["tool_tracking_error_max_m"].high
    assert result.curves["dose_mass"][-1] == pytest.approx(report["dose_kg"], abs=5e-4)
    assert len(result.curves["dose_time"]) == len(result.curves["dose_tilt"])
    assert "dose [g]" in (tmp_path / "out" / "index.html").read_text()
    with Recording(tmp_path / "out" / FILE) as recording:
        names = [curve.name for curve in recording.header.curves]
        values = recording.values()[1]
    assert values[-1, names.index("target")] == pytest.approx(20.0)
    assert values[-1, names.index("in the cup")] == pytest.approx(1e3 * report["dose_kg"], abs=0.5)
    assert not list((tmp_path / "out").glob("joint_trajectory*"))
    with pytest.raises(ConfigError, match="the balance controls the dose"):
        result.export_ros2(tmp_path / "motion.yaml", force=True)


def test_a_recording_cannot_replay_a_dose(short: RehearsalConfig) -> None:
    plan = plan_motion(short)
    with pytest.raises(ConfigError, match="a recording with a dose or a driver"):
        RehearsalRun(plan, replay=object())  # pyright: ignore[reportArgumentType]
    with pytest.raises(ConfigError, match="in a rehearsal with a dose; accepted: a controller of doses, with the meth"):
        RehearsalRun(plan, driver=lambda state: state.planned)
