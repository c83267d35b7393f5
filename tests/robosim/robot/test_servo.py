"""The sampled servo: how far it is stable, how it tracks, and what is named where it is unstable."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from bundled import rehearsal
from written_arms import write_arm

from robosim.base.errors import ConfigError, RobotDiverged
from robosim.cell.cell import Cell
from robosim.config.arm import ArmConfig
from robosim.rehearsal.session import check_config
from robosim.robot.model import Arm
from robosim.robot.robot import load_robot_model
from robosim.robot.timing import JointState
from robosim.scene.build import build_scene_spec
from robosim.scene.compiled import compile_scene
from robosim.scene.models import assemble


def make_cell(path: Path, dt: float, servo: dict[str, Any] | None) -> Cell:
    """Return an arm of light links without armature that holds a spoon."""
    robot = load_robot_model(ArmConfig.model_validate({
        "model": str(write_arm(path / "arm.xml", 6)), "flange": "tip", "limits": {"velocity": [2.0] * 6},
        "servo": servo}), path)
    assembly = replace(assemble("spoon", gripper="none"), robot=robot)
    scene, arm = compile_scene(build_scene_spec(assembly, "weld", {}, dt, contact=False), assembly), Arm(assembly)
    return Cell(scene, arm, arm.home, ())


@pytest.mark.parametrize("dt", [1e-4, 1e-3, 5e-3])
def test_the_default_allows_a_fifth_of_the_inertia_in_every_posture(dt: float, tmp_path: Path) -> None:
    cell = make_cell(tmp_path, dt, None)
    cell.servo.scale(5.0, 5.0)
    cell.check_path(np.random.default_rng(0).uniform(cell.arm.lower, cell.arm.upper, (50, 6)))


@pytest.mark.parametrize("servo", [{"bandwidth": 30.0, "damping_ratio": 0.7},
                                   {"stiffness": [1e-2] * 6, "damping": [0.05, 0.5, 0.05, 0.5, 0.05, 0.2]}])
def test_the_loop_is_stable_up_to_the_checked_bound_and_no_further(servo: dict[str, Any], tmp_path: Path) -> None:
    """MuJoCo decides about the largest factor on the gains by 2 dt d + dt^2 k = 4; the unstable joint is named."""
    cell, dt = make_cell(tmp_path, 1e-3, servo), 1e-3
    gains, home = cell.servo.gains, cell.arm.home
    inertia = np.eye(6) if gains.per_inertia else cell.arm.inertia(home)
    k, d = (np.linalg.eigvals(np.linalg.solve(inertia, np.diag(gain))).max() for gain in gains[:2])
    most = 4.0 / (2.0 * dt * d + dt * dt * k)

    def hold(factor: float) -> np.ndarray:
        cell.servo.scale(factor, factor)
        mujoco.mj_resetData(cell.model, cell.data)
        cell.data.qpos[cell.scene.arm_qpos], cell.data.qvel[cell.scene.arm_dofs], speeds = home, 1e-4, []
        for step in range(500):
            cell.command(JointState(home, np.zeros(6), np.zeros(6)))
            mujoco.mj_step(cell.model, cell.data)
            speeds.append(cell.qd.copy())
            if step % 20 == 19:
                cell.servo.check_motion(cell.data.time, dt, np.array(speeds[-20:]))
        return np.abs(speeds).max(axis=1)

    speeds = hold(0.97 * most)
    assert speeds[-1] < 0.1 * speeds[0]
    cell.check_path([home])
    with pytest.raises(RobotDiverged, match=r"the servo of joint j. \(.*\) is unstable in steps of host_dt = 0.001 s"):
        hold(1.03 * most)
    with pytest.raises(ConfigError, match=r"host_dt = 0.001 s: the servo of joint j. \(.* needs steps below 0.0009"):
        cell.check_path([home])


def test_the_default_follows_a_motion_and_holds_a_load(tmp_path: Path) -> None:
    """A swing of all joints by 0.5 rad in 1 s to 0.2 mm; 0.1 kg at a spoon of light links moves it by less."""
    cell, errors, all_joints, w = make_cell(tmp_path, 1e-3, None), [], np.ones(6), 2.0 * np.pi
    for time in np.arange(0.0, 2.0, 1e-3):
        sine, cosine, is_swinging = np.sin(w * min(time, 1.0)), np.cos(w * min(time, 1.0)), time < 1.0
        target = JointState(cell.arm.home + 0.25 * (1.0 - cosine), 0.25 * w * sine * all_joints,
                            0.25 * w * w * cosine * is_swinging * all_joints)
        cell.data.xfrc_applied[cell.scene.tool, 2] = 0.0 if is_swinging else -0.981
        cell.command(target)
        reached, commanded = (cell.arm.tool_pose(q).position for q in (cell.q, target.q))
        errors.append(np.linalg.norm(reached - commanded))
        mujoco.mj_step(cell.model, cell.data)
    assert max(errors) < 2e-4 and cell.servo.saturations == 0


def test_gains_that_the_step_is_too_long_for_are_refused_before_the_plan() -> None:
    for servo in ("{bandwidth: 500}", "{stiffness: [9000, 9000, 9000, 9000, 9000, 9000, 9000], damping: "
                                      "[900, 900, 900, 900, 900, 900, 900]}"):
        with pytest.raises(ConfigError, match=r"host_dt = 0.001 s: the servo of joint .* needs steps below .* softer"):
            check_config(rehearsal("spoon", f"servo={servo}"))
