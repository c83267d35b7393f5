"""A recording of the real arm plays beside the plan: its clock, its differences and its wrench are found."""

import csv
import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest
from bundled import write_short
from scipy.spatial.transform import Rotation

from robosim.base.errors import ConfigError
from robosim.commands.main import main
from robosim.config.rehearsal import load_rehearsal
from robosim.conversion.joint_log import JointLog, Samples
from robosim.conversion.joint_log_files import AXES
from robosim.planning.plan import Plan, plan_motion
from robosim.rehearsal.comparison import compare_wrench
from robosim.rehearsal.recorded_motion import RecordedMotion, read_log
from robosim.rehearsal.session import RunOptions, simulate

CLOCK, BIAS = 1234.5, np.array([0.7, 0.0, -0.4, 0.02, 0.0, -0.01])
"""Time [s] that the recording's clock is ahead, and what its sensor [N], [N m] adds."""
ANGLES, WRENCH = [f"q_A{k}_rad" for k in range(1, 8)], [f"wrist_{axis}" for axis in AXES]


@pytest.fixture(scope="module")
def plan(ran: Path) -> Plan:
    return plan_motion(load_rehearsal(str(ran.parent / "short.yaml")))


def write_recording(path: Path, rows: np.ndarray) -> Path:
    """Write times [s] and angles [rad], and a wrench [N], [N m] where the rows have one."""
    names = ["time_s", *ANGLES, *WRENCH][: rows.shape[1]]
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([names, *rows])
    return path


def replay(plan: Plan, folder: Path, times: np.ndarray, angles: np.ndarray) -> RecordedMotion:
    """Find the plan in a recording of angles (n, 7) [rad] at times (n,) [s]."""
    log = read_log(write_recording(folder / "real.csv", np.column_stack([times, angles])), plan.config)
    return RecordedMotion(log, plan.motion, plan.arm, plan.config)


@pytest.mark.slow
def test_a_run_played_again_is_that_run_with_the_clock_and_the_bias_of_the_recording(ran: Path, tmp_path: Path) -> None:
    rows = np.genfromtxt(ran / "trajectory.csv", delimiter=",", names=True)
    table = np.column_stack([rows[name] for name in ("time_s", *ANGLES, *WRENCH)])
    table[:, 0] += CLOCK
    table[:, 8:] += BIAS
    recording, file = write_recording(tmp_path / "real.csv", table[::4]), str(ran.parent / "short.yaml")
    main(["rehearse", file, "--recorded", str(recording), "--no-video", "--out", str(tmp_path / "again")])
    report = json.loads((tmp_path / "again" / "report.json").read_text())
    assert report["trajectory"] == "replay"
    assert report["recorded_clock_offset_s"] == pytest.approx(CLOCK + load_rehearsal(file).grasp_time, abs=0.01)
    assert report["recorded_joint_difference_max_deg"] < 0.2  # what the servo leaves
    assert report["recorded_force_offset_N"] == pytest.approx(BIAS[:3], abs=0.1)
    assert report["recorded_torque_offset_Nm"] == pytest.approx(BIAS[3:], abs=0.01)
    weight = 9.81 * 1.0  # of hand and tool, at least
    assert report["recorded_force_difference_rms_N"] < 0.05 * weight
    again = np.genfromtxt(tmp_path / "again" / "trajectory.csv", delimiter=",", names=True)
    n = min(len(rows), len(again))
    for name in ANGLES:
        assert np.abs(rows[name][:n] - again[name][:n]).max() < 2e-3
    page = (tmp_path / "again" / "index.html").read_text()
    assert "recorded less planned joint angle" in page and "recorded less its offset" in page


@pytest.mark.long
def test_another_clock_and_a_displaced_joint_are_seen(plan: Plan, tmp_path: Path) -> None:
    times = np.arange(-0.5, plan.motion.duration + 0.5, 0.008)
    angles = np.array([plan.motion.state(t).q for t in times])
    moved = angles + np.radians(0.8) * np.eye(7)[3]
    for start, given, difference in ((100.0, angles, 0.0), (-7.3, moved, 0.8)):
        motion = replay(plan, tmp_path, times + start, given)
        assert motion.offset == pytest.approx(start, abs=2e-3)
        middle = 0.5 * plan.motion.duration
        apart = np.degrees(motion.state(middle).q - plan.motion.state(middle).q)
        assert apart == pytest.approx(difference * np.eye(7)[3], abs=0.02)
        np.testing.assert_allclose(motion.state(middle).qd, plan.motion.state(middle).qd, atol=0.02)
        assert not motion.state(-10.0).qd.any() and not motion.state(1e3).qd.any()


@pytest.mark.long
def test_an_approach_before_the_motion_is_no_part_of_it(plan: Plan, tmp_path: Path) -> None:
    """The arm comes from elsewhere, waits, and moves; and stands long afterwards."""
    approach, wait, after = 3.0, 4.0, 60.0
    times = np.arange(0.0, approach + wait + plan.motion.duration + after, 0.01)
    shares = np.clip(times / approach, 0.0, 1.0)[:, None]
    angles = np.array([plan.motion.state(t - approach - wait).q for t in times]) - 0.3 * (1.0 - shares) ** 2
    motion = replay(plan, tmp_path, times, angles)
    assert motion.offset == pytest.approx(approach + wait, abs=5e-3)
    assert motion.duration < plan.motion.duration + 1.1
    np.testing.assert_allclose(motion.state(-plan.config.grasp_time).q, plan.motion.state(0.0).q, atol=1e-3)


@pytest.mark.long
def test_a_motion_of_its_own_is_played_from_a_dataset(plan: Plan, tmp_path: Path) -> None:
    """Ten angles a second of a robot that does something else: it is followed, and compared in duration and wrench."""
    pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    names, times = [f"A{k}.pos" for k in range(1, 8)], np.arange(0.0, 2.55, 0.1)
    angles = plan.motion.state(0.0).q + 0.1 * np.sin(np.pi * times / 2.5)[:, None] ** 2
    folder = tmp_path / "set"
    (folder / "meta").mkdir(parents=True)
    (folder / "meta" / "info.json").write_text(json.dumps({
        "codebase_version": "v3.0", "total_episodes": 1, "features": {
            "observation.state": {"dtype": "float32", "shape": [7], "names": names},
            "observation.force": {"dtype": "float32", "shape": [6], "names": ["fx", "fy", "fz", "tx", "ty", "tz"]}}}))
    (folder / "data").mkdir()
    pq.write_table(pa.table({"timestamp": times, "episode_index": np.zeros(len(times), int), "observation.state":
                             angles.tolist(), "observation.force": [[0.0, 0.0, 10.0, 0.0, 0.0, 0.0]] * len(times)}),
                   folder / "data" / "file-000.parquet")
    file = str(write_short(tmp_path / "short.yaml"))
    assert main(["rehearse", file, "--recorded", str(folder), "--unplanned", "--no-video", "--out",
                 str(tmp_path / "out")]) == 1  # it delivers nothing
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["trajectory"] == "replay" and report["driver"] == "recording"
    assert report["recorded_duration_s"] == pytest.approx(2.5, abs=0.01)
    assert report["tool_tracking_error_max_m"] < 3e-3 and "recorded_joint_difference_max_deg" not in report
    assert report["recorded_force_difference_rms_N"] > 0.0 and report["scooped_mass_kg"] == 0.0
    rows = np.genfromtxt(tmp_path / "out" / "trajectory.csv", delimiter=",", names=True)
    middle = np.searchsorted(rows["time_s"], 1.25 + load_rehearsal(file).grasp_time)
    assert rows["q_A1_rad"][middle] == pytest.approx(plan.motion.state(0.0).q[0] + 0.1, abs=0.01)


@pytest.mark.long
def test_a_bed_that_the_tool_reaches_into_is_no_load_of_a_motion_of_its_own(ran: Path, tmp_path: Path) -> None:
    """The planned run weighs in the bed; played as a motion of its own it lifts nothing."""
    file, out = str(ran.parent / "short.yaml"), tmp_path / "out"
    main(["rehearse", file, "--recorded", str(ran / "trajectory.csv"), "--unplanned", "--no-video", "--out", str(out)])
    planned, own = (json.loads((folder / "report.json").read_text()) for folder in (ran, out))
    assert planned["scooped_mass_kg"] > 0.1 and own["scooped_mass_kg"] == 0.0
    assert own["wrist_payload_kg"] is None and own["delivered_fraction"] is None
    assert load_rehearsal(str(out / "config.yaml")).weigh_at == load_rehearsal(file).weigh_at
    with pytest.raises(ConfigError, match="a tool that is picked up"):
        simulate(load_rehearsal("pick_bottle"), out, RunOptions(recorded=ran / "trajectory.csv", is_unplanned=True))


@pytest.mark.long
def test_recordings_of_something_else_are_refused(plan: Plan, tmp_path: Path) -> None:
    start, duration = plan.motion.state(0.0).q, plan.motion.duration
    cases = {"accepted: the whole planned motion of": (np.arange(0.0, 0.5 * duration, 0.01), 1.0),
             "does not follow the planned motion": (np.arange(0.0, 3.0 * duration, 0.01), -2.0),
             "of the planned motion; accepted: all": (np.arange(0.08 * duration, 2.0 * duration, 0.01), 1.0)}
    for message, (times, factor) in cases.items():
        angles = start + factor * (np.array([plan.motion.state(t).q for t in times]) - start)
        with pytest.raises(ConfigError, match=message):
            replay(plan, tmp_path, times, np.clip(angles, plan.arm.lower, plan.arm.upper))
    times = np.arange(0.0, duration, 0.01)
    beyond = np.zeros((len(times), 7))
    beyond[50, 1] = 2.5
    with pytest.raises(ConfigError, match=r"real.csv: joint A2 is at 2.5000 rad at 0.500 s; accepted: -2.09"):
        replay(plan, tmp_path, times, beyond)


def test_the_offset_of_a_sensor_turns_with_it() -> None:
    """A wrist that turns by 90 deg about y, its weight, and a sensor with a constant offset in its own axes."""
    model = mujoco.MjModel.from_xml_string("""<mujoco><worldbody><body><joint axis="0 1 0"/><geom size="0.1"/>
        <site name="wrist_sensor"/></body></worldbody></mujoco>""")
    times, grasp_time = np.arange(0.0, 4.0, 0.002), 1.0
    q = np.clip(times - 1.5, 0.0, np.pi / 2)[:, None]
    weight = np.array([0.0, 0.0, 9.81])
    axes = Rotation.from_rotvec(q * [0.0, 1.0, 0.0])
    recorded = np.column_stack([axes.inv().apply(weight), np.zeros((len(times), 3))]) + BIAS
    log = JointLog(Path("real"), Samples(times[::4], q[::4]), Samples(times[::4], recorded[::4]), "sensor")
    steps = {"time": times, "q": q, "wrist": np.tile([*weight, 0.0, 0.0, 0.0], (len(times), 1))}
    readings: Any = SimpleNamespace(stack_steps=steps.get)
    played: Any = SimpleNamespace(log=log, offset=grasp_time)
    found = compare_wrench(played, readings, model, np.array([0]), grasp_time)
    assert found is not None and found.offset == pytest.approx(BIAS)
    np.testing.assert_allclose(found.recorded, found.simulated, atol=1e-9)
