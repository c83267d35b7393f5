"""Rehearsals from file to report: a short one, and the bundled ones under the marker `slow`."""

import itertools
import json
import os
import re
from pathlib import Path

import av
import numpy as np
import pytest
import yaml
from scipy.interpolate import CubicHermiteSpline

from robosim.commands.main import main
from robosim.config.rehearsal import load_rehearsal
from robosim.recordings.scene_recorder import FRAME_RATE
from robosim.rehearsal.metrics import BOUNDS, find_missed
from robosim.rehearsal.readings import name_columns
from robosim.rehearsal.run import RehearsalRun
from robosim.rehearsal.session import MISSED_TRAJECTORY, TRAJECTORY, rehearse
from robosim.robot.model import Arm
from robosim.scene.models import assemble

UNIT = re.compile("_(s|m|kg|deg)$")
"""End of a figure's name that gives its unit."""


def check_the_trajectories(out: Path, rows: np.ndarray, arm: Arm) -> None:
    """trajectory.csv and joint_trajectory.yaml share a clock; the tool's pose at joint angles between the points of the
    .yaml file is the commanded one of the .csv file's row."""
    message = yaml.safe_load((out / MISSED_TRAJECTORY).read_text())
    times = np.array([p["time_from_start"]["sec"] + 1e-9 * p["time_from_start"]["nanosec"] for p in message["points"]])
    q, qd = (np.array([p[key] for p in message["points"]]) for key in ("positions", "velocities"))
    first = name_columns(arm.joints).index("commanded_x")
    commanded = rows[:, first : first + 7]
    assert times[0] == 0.0 and times[-1] == pytest.approx(rows[-1, 0], abs=2e-3)
    for row in range(0, len(rows), 50):
        pose = arm.tool_pose(CubicHermiteSpline(times, q, qd)(rows[row, 0]))
        assert commanded[row, :3] == pytest.approx(pose.position, abs=1e-6)
        assert abs(commanded[row, 3:] @ pose.quaternion) == pytest.approx(1.0, abs=1e-6)


def test_a_short_rehearsal_writes_all_files(ran: Path) -> None:
    assert not (ran / TRAJECTORY).exists()
    report = json.loads((ran / "report.json").read_text())
    assert set(BOUNDS) <= set(report)
    assert {name for name, value in report.items() if isinstance(value, float) and not UNIT.search(name)} == {
        "realtime_factor", "delivered_fraction", "spilled_fraction", "returned_fraction", "retained_fraction",
        "momentum_residual", "momentum_residual_linear", "momentum_residual_angular", "velocity_limit_ratio_max",
        "torque_limit_ratio_max", "joint_limit_ratio_max", "wrist_payload_relative_error",
        "awake_share", "motion_time_scale", "wrist_load_ratio_max", "coupling_missed_fraction"}  # shares and ratios
    for name in ("momentum_residual", "velocity_limit_ratio_max", "torque_limit_ratio_max", "joint_limit_ratio_max",
                 "ik_position_error_max_m", "particles_lost", "tool_container_contacts"):
        assert report[name] <= BOUNDS[name].high, name
    arm = Arm(assemble("spoon"))
    with (ran / "trajectory.csv").open() as file:
        assert file.readline().strip().split(",") == name_columns(arm.joints)
    rows = np.loadtxt(ran / "trajectory.csv", delimiter=",", skiprows=1)
    assert np.diff(rows[:, 0]) == pytest.approx(1e-3, abs=1e-9)
    assert len(rows) == pytest.approx(report["simulated_time_s"] / 1e-3, abs=1)
    check_the_trajectories(ran, rows, arm)
    assert load_rehearsal(str(ran / "config.yaml")) == load_rehearsal(str(ran.parent / "short.yaml"))
    assert (ran / "index.html").stat().st_size > 20_000
    if os.environ["MUJOCO_GL"] != "disable":
        with av.open(str(ran / "rehearsal.mp4")) as container:
            frames = [f.to_ndarray(format="rgb24") for f in container.decode(video=0)]
        assert len(frames) == pytest.approx(report["simulated_time_s"] * FRAME_RATE, abs=2)
        assert frames[0].shape == (720, 1280, 3)
        assert np.ptp(frames[0]) > 100 and np.abs(frames[0].astype(int) - frames[-15]).max() > 50
        assert (ran / "frames.png").exists()


def test_divergence_keeps_the_last_good_state(short: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                              capsys: pytest.CaptureFixture) -> None:
    """A grain at 1e5 m/s stops the run with time, particle and CFL number; all files are complete."""
    original = RehearsalRun.step

    def step_with_fast_grain(self: RehearsalRun, index: int) -> None:
        if index == 20:
            state = self.solver.state()
            state["v"][3] = 1e5
            self.solver.load(state)
        original(self, index)

    monkeypatch.setattr(RehearsalRun, "step", step_with_fast_grain)
    out = tmp_path / "out"
    assert main(["rehearse", str(short), "--no-video", "--out", str(out)]) == 1
    message = capsys.readouterr().err
    assert "diverged at t = " in message and "CFL number" in message and "particle" in message
    with np.load(out / "last_good_state.npz") as state:
        assert all(np.isfinite(state[name]).all() for name in ("x", "v", "C", "e", "qpos"))
    assert len(np.loadtxt(out / "trajectory.csv", delimiter=",", skiprows=1)) == 20


@pytest.mark.slow
@pytest.mark.parametrize("material", ["salt", "sugar", "flour"])
@pytest.mark.parametrize("name, trajectory", [
    ("pick_bottle", "script"), *itertools.product(("spoon", "scoop", "bottle", "shovel"), ("script", "recorded"))])
def test_the_rehearsal_is_within_its_bounds(name: str, trajectory: str, material: str, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert rehearse(name, out, material=material, trajectory=trajectory) == 0
    assert find_missed(json.loads((out / "report.json").read_text()), load_rehearsal(str(out / "config.yaml"))) == []


@pytest.mark.slow
def test_the_spoon_held_by_friction_delivers_as_the_fixed_one(tmp_path: Path) -> None:
    """Slip in the fingers costs at most five percentage points of the delivery."""
    reports = {}
    for grasp in ("weld", "friction"):
        assert rehearse("spoon", tmp_path / grasp, grasp=grasp) == 0
        reports[grasp] = json.loads((tmp_path / grasp / "report.json").read_text())
    assert abs(reports["friction"]["delivered_fraction"] - reports["weld"]["delivered_fraction"]) <= 0.05
    assert 0.0 < reports["friction"]["grasp_slip_m"] < 0.002
    assert reports["weld"]["grasp_slip_m"] == 0.0


@pytest.mark.slow
def test_a_film_that_fails_costs_no_report(short: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """The report is there, and the exit status and the message say that the film is not."""
    out = tmp_path / "out"
    (out / "rehearsal.mp4").mkdir(parents=True)
    (out / "rehearsal.mp4" / "kept").touch()
    (out / ".lock").touch()  # of an earlier run
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("robosim.base.output_folder.OutputFolder.clear", lambda *_: None)
        assert main(["rehearse", str(short), "--out", str(out)]) == 2
    assert "no film" in capsys.readouterr().err
    assert json.loads((out / "report.json").read_text())["grains"] > 0
    assert (out / "trajectory.csv").is_file() and (out / "index.html").is_file()
