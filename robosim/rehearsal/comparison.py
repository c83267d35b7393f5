"""Recorded and simulated motion and wrench, side by side."""

from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np

from robosim.rehearsal.readings import Readings
from robosim.rehearsal.recorded_motion import RecordedMotion
from robosim.reports.curves import Chart, Curve
from robosim.robot.assembly import WRIST_SITE
from robosim.robot.model import Arm

AVERAGED = 20
"""Steps over which simulated wrenches are averaged: robots report them filtered."""
REST = 0.2
"""Time [s] before the motion in which the difference of both wrenches is taken as the sensor's offset."""
OPPOSITE = -0.5
"""Correlation of the forces below which the recorded ones are the hand's on the arm."""


class WrenchComparison(NamedTuple):
    """Recorded and simulated wrench (n, 6) [N], [N m] of the arm on the hand, in world axes."""

    times: np.ndarray
    """Simulated (n,) [s]."""
    recorded: np.ndarray
    """Less the offset."""
    simulated: np.ndarray
    offset: np.ndarray | None
    """Mean difference (6,) before the motion, in the axes of the recording; None: nothing was recorded before it."""


def compare_wrench(replay: RecordedMotion, readings: Readings, model: mujoco.MjModel, arm_qpos: np.ndarray,
                   grasp_time: float) -> WrenchComparison | None:
    """Compare the wrenches at the recorded times that were simulated; None without a recorded one.
    arm_qpos: addresses of the arm's angles in the model. grasp_time: at which the motion starts [s]."""
    wrench = replay.log.wrench
    if wrench is None:
        return None
    step_times, q, wrist = (readings.stack_steps(name) for name in ("time", "q", "wrist"))
    times = wrench.times - replay.offset + grasp_time
    is_inside = (times >= step_times[0]) & (times <= step_times[-1])
    times, recorded = times[is_inside], wrench.values[is_inside]
    if not len(times):
        return None
    kernel = np.ones(AVERAGED) / AVERAGED
    smooth = np.stack([np.convolve(column, kernel, mode="valid") for column in wrist.T], 1)
    centres = np.convolve(step_times, kernel, mode="valid")
    simulated = np.stack([np.interp(times, centres, column) for column in smooth.T], 1)
    axes = np.eye(3)[None]
    if replay.log.wrench_axes == "sensor":
        rows = np.minimum(np.searchsorted(step_times, times), len(q) - 1)
        axes = sensor_axes(q[rows], model, arm_qpos)
    at_rest = (times > grasp_time - REST) & (times <= grasp_time)
    offset = None
    if at_rest.any():  # a sensor's offset turns with it
        offset = np.mean((recorded - turn(simulated, axes.transpose(0, 2, 1)))[at_rest], axis=0)
        recorded = recorded - offset
    return WrenchComparison(times, turn(recorded, axes), simulated, offset)


def turn(wrenches: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """Turn forces and torques (n, 6) by matrices (n, 3, 3), or by one (1, 3, 3)."""
    return (wrenches.reshape(-1, 2, 3) @ axes.transpose(0, 2, 1)).reshape(-1, 6)


def sensor_axes(q: np.ndarray, model: mujoco.MjModel, arm_qpos: np.ndarray) -> np.ndarray:
    """Return the axes (n, 3, 3) of the wrist sensor in the world in postures q (n, joints) [rad] of the arm."""
    data, site = mujoco.MjData(model), model.site(WRIST_SITE).id
    axes = np.empty((len(q), 3, 3))
    for row, posture in enumerate(q):
        data.qpos[arm_qpos] = posture
        mujoco.mj_kinematics(model, data)
        axes[row] = data.site_xmat[site].reshape(3, 3)
    return axes


def joint_differences(replay: RecordedMotion) -> tuple[np.ndarray, np.ndarray]:
    """Return times (n,) [s] since the motion's start, and recorded less planned angles (n, joints) [rad]."""
    times = np.arange(0.0, max(replay.duration, replay.planned.duration), 0.01)
    return times, np.array([replay.state(t).q - replay.planned.state(t).q for t in times])


def replay_figures(replay: RecordedMotion, comparison: WrenchComparison | None, arm: Arm) -> dict[str, object]:
    """Return the report's figures of a replay; one of its own motion is compared in duration and wrench alone."""
    figures: dict[str, object] = {
        "recorded": str(replay.log.path), "recorded_clock_offset_s": replay.offset,
        "recorded_duration_s": replay.duration, "planned_duration_s": replay.planned.duration}
    if not replay.is_own:
        times, difference = joint_differences(replay)
        figures |= {
            "recorded_joint_difference_max_deg": float(np.degrees(np.abs(difference).max())),
            "recorded_joint_difference_rms_deg": float(np.degrees(np.sqrt(np.mean(difference**2)))),
            "recorded_tool_difference_max_m": max(float(np.linalg.norm(
                arm.tool_pose(replay.state(t).q).position - arm.tool_pose(replay.planned.state(t).q).position))
                for t in times[::5])}
    if comparison is None:
        return figures
    error = comparison.recorded - comparison.simulated
    forces = [values[:, :3] - values[:, :3].mean(0) for values in (comparison.recorded, comparison.simulated)]
    norms = np.linalg.norm(forces[0]) * np.linalg.norm(forces[1])
    correlation = float((forces[0] * forces[1]).sum() / norms) if norms > 0.0 else None
    return figures | {
        "recorded_force_offset_N": None if comparison.offset is None else comparison.offset[:3].tolist(),
        "recorded_torque_offset_Nm": None if comparison.offset is None else comparison.offset[3:].tolist(),
        "recorded_force_difference_rms_N": float(np.sqrt(np.mean(np.sum(error[:, :3] ** 2, 1)))),
        "recorded_force_difference_max_N": float(np.linalg.norm(error[:, :3], axis=1).max()),
        "recorded_torque_difference_rms_Nm": float(np.sqrt(np.mean(np.sum(error[:, 3:] ** 2, 1)))),
        "recorded_force_correlation": correlation}


def replay_charts(replay: RecordedMotion, comparison: WrenchComparison | None, names: Sequence[str],
                  grasp_time: float) -> list[Chart]:
    """Return the charts of a replay; names: of the joints."""
    if replay.is_own:
        times = np.arange(0.0, replay.duration, 0.01)
        title, angles = "recorded joint angle [deg]", np.array([replay.state(t).q for t in times])
    else:
        title, (times, angles) = "recorded less planned joint angle [deg]", joint_differences(replay)
    charts = [Chart(title, [
        Curve(name, times + grasp_time, np.degrees(angles[:, k])) for k, name in enumerate(names)])]
    if comparison is not None:
        for first, what, unit in ((0, "force", "N"), (3, "torque", "N m")):
            both = (("simulated", comparison.simulated, False), ("recorded", comparison.recorded, True))
            charts.append(Chart(f"wrist {what}, recorded less its offset [{unit}]", [
                Curve(f"{axis} {how}", comparison.times, values[:, first + k], dashed)
                for k, axis in enumerate("xyz") for how, values, dashed in both]))
    return charts
