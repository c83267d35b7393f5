"""Rehearsals from Python: plan, run, and what comes of them; what is exported may be trusted."""

import json
import os
from pathlib import Path

import numpy as np
import pytest
import yaml

import robosim
from robosim.config.rehearsal import load_rehearsal
from robosim.episode.film import find_camera
from robosim.rehearsal.session import Rehearsal
from robosim.scene.build import compile_rehearsal


@pytest.mark.slow
def test_a_rehearsal_is_planned_and_run(short: Path, tmp_path: Path) -> None:
    """Too short to deliver anything: its motion is not exported, or only under a name that says so."""
    rehearsal = Rehearsal(short, material="sugar", max_time_scale=2.0, grip_turn_deg=0.0)
    assert rehearsal.config.material == "sugar"
    plan = rehearsal.plan()
    assert 1.0 <= plan.time_scale <= 2.0 and plan.clearance.surroundings.distance > 0.0
    drawable = os.environ["MUJOCO_GL"] != "disable"
    result = rehearsal.run(camera="close" if drawable else None, height=180)
    assert result.figures["material"] == "sugar" and any("delivered" in line for line in result.missed)
    curves, steps = result.curves, len(result.curves["time"])
    assert curves["q"].shape == curves["torque"].shape == (steps, 7) and curves["wrist"].shape == (steps, 6)
    assert np.abs(curves["reached"] - curves["commanded"]).max() < 0.01 and result.positions.shape[1] == 3
    frames = result.frames(4)
    assert len(frames) == (4 if drawable else 0) and all(frame.shape == (180, 320, 3) for frame in frames)
    saved = result.save(tmp_path / "saved")
    assert {"report.json", "index.html", "trajectory.csv", "config.yaml"} <= {p.name for p in saved.iterdir()}
    assert json.loads((saved / "report.json").read_text())["missed"] == result.missed
    with pytest.raises(robosim.ConfigError, match=r"motion.yaml: not written, for bounds were missed: .*delivered"):
        result.export_ros2(tmp_path / "motion.yaml")
    assert not (tmp_path / "motion.yaml").exists()
    written = result.export_ros2(tmp_path / "motion.yaml", force=True, joint_prefix="lbr_")
    assert written.name == "motion_MISSED_BOUNDS.yaml"
    message, commands, approach, closing = (
        yaml.safe_load((tmp_path / f"motion_MISSED_BOUNDS{part}.yaml").read_text())
        for part in ("", "_gripper", "_approach", "_approach_gripper"))
    assert message["joint_names"] == [f"lbr_A{k}" for k in range(1, 8)]
    np.testing.assert_allclose(message["points"][0]["positions"], plan.motion.state(0.0).q, atol=1e-8)
    assert commands["actuator_names"] == ["f1", "f2", "fm"]
    assert [point["positions"] for point in commands["points"]] == [[0.9] * 3]  # it has closed at home
    assert approach["joint_names"] == message["joint_names"]
    np.testing.assert_allclose(approach["points"][0]["positions"], plan.arm.home, atol=1e-8)
    np.testing.assert_allclose(approach["points"][-1]["positions"], message["points"][0]["positions"], atol=1e-8)
    assert [point["positions"] for point in closing["points"]] == [[0.0] * 3, [0.9] * 3]
    times = [point["time_from_start"] for point in closing["points"]]
    assert times == [{"sec": 0, "nanosec": 0}, {"sec": 0, "nanosec": 120_000_000}]  # the grasp takes 0.2 s


def test_errors_come_before_any_work(short: Path) -> None:
    with pytest.raises(robosim.UnknownName, match="unknown rehearsal 'sponn'.*spoon"):
        Rehearsal("sponn")
    with pytest.raises(robosim.ConfigError, match=r"robotiq_3f with spoon weighs 2.43 kg; accepted: up to the payload"):
        table = {"model": str(Path("models/robots/iiwa14/iiwa14.xml").resolve()), "flange": "flange", "payload": 1.0,
                 "limits": {"velocity": [1.0] * 7}}
        Rehearsal(short, robot=table, gripper="robotiq_3f")
    with pytest.raises(robosim.ConfigError, match="acceleration has 6 values; accepted: 7, for A1, A2"):
        Rehearsal(short, limits={"velocity_fraction": 0.9, "acceleration": [1.0] * 6}).plan()


def test_paths_in_a_file_are_relative_to_it(short: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever the working directory is."""
    folder = tmp_path / "lab"
    folder.mkdir()
    (folder / "arm.yaml").write_text(yaml.safe_dump({
        "model": str(Path("models/robots/ur5e/ur5e.xml").resolve()), "flange": "flange", "gripper": "parallel_jaw",
        "limits": {"velocity": [3.0] * 6, "torque": [150.0, 150.0, 150.0, 28.0, 28.0, 28.0]}}))
    table = yaml.safe_load(short.read_text()) | {"robot": "arm.yaml"}
    (folder / "lab.yaml").write_text(yaml.safe_dump(table))
    monkeypatch.chdir(tmp_path)
    rehearsal = Rehearsal("lab/lab.yaml")
    assert rehearsal.config.robot == str(folder / "arm.yaml")
    assert rehearsal.plan().arm.joints[0] == "shoulder_pan_joint"


def test_a_film_is_seen_from_a_camera_that_the_scene_has(short: Path, tmp_path: Path) -> None:
    """The camera at the wrist is that of the hand; a tool that is bolted to the flange has none."""
    model = compile_rehearsal(load_rehearsal(str(short))).model
    assert find_camera(model, "close") == "close" and find_camera(model, "wrist") == "hand_wrist"
    with pytest.raises(robosim.UnknownName, match="'wrist'; valid: auto, close, near, orbit, overview"):
        Rehearsal(short, gripper="none").run(out=tmp_path, camera="wrist")


@pytest.mark.slow
def test_a_run_with_a_driver_and_one_that_fails(short: Path, tmp_path: Path) -> None:
    """The plan as a driver moves robot and grains as the plan does; after a fault the files say why."""
    rehearsal = Rehearsal(short)
    plain = rehearsal.run(out=tmp_path / "plan")
    own = rehearsal.run(out=tmp_path / "own", driver=lambda state: state.planned)
    np.testing.assert_array_equal(own.curves["q"], plain.curves["q"])
    np.testing.assert_array_equal(own.positions, plain.positions)
    assert own.figures["trajectory"] == "driver" and own.figures["driver"] == "<lambda>"
    with pytest.raises(robosim.ConfigError, match="not written, for driver <lambda> moved the arm"):
        own.export_ros2(tmp_path / "motion.yaml", force=True)
    with pytest.raises(robosim.DriverFault):
        rehearsal.run(out=tmp_path / "failed", driver=lambda state: np.nan * state.q if state.time > 1.5e-3
                      else state.planned)
    status = json.loads((tmp_path / "failed" / "status.json").read_text())
    assert status["state"] == "failed" and "DriverFault: driver <lambda> at t = 0.0020 s" in status["reason"]
    assert not (tmp_path / "failed" / "report.json").exists()
    assert len(np.loadtxt(tmp_path / "failed" / "trajectory.csv", delimiter=",", skiprows=1)) == 202
