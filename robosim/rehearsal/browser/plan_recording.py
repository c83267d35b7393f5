"""A planned motion as a recording without grains: the arm along it, and its margins."""

from pathlib import Path

import mujoco
import numpy as np

from robosim.base.provenance import commit
from robosim.config.rehearsal import RehearsalConfig
from robosim.planning.clearance import RobotClearance
from robosim.planning.plan import Plan, plan_motion
from robosim.planning.recorded_motions import place_target
from robosim.recordings.header import CurveEntry, WaypointEntry, floats
from robosim.recordings.scene_recorder import SceneRecorder
from robosim.rehearsal.recorder import PATH_POINTS, counting_regions
from robosim.scene.build import compile_rehearsal

FRAME_RATE = 50.0
"""Frames per second of the motion."""
FARTHEST = 0.2
"""Distance [m] up to which clearances are drawn."""
CURVES = [
    CurveEntry(name="to table and containers", unit="mm", chart="clearance of arm, hand and tool"),
    CurveEntry(name="between parts of the robot", unit="mm", chart="clearance of arm, hand and tool"),
    CurveEntry(name="margin of the closest joint", unit="deg", chart="joint limits"),
    CurveEntry(name="largest speed", unit="% of its limit", chart="joint speeds and torques"),
    CurveEntry(name="largest torque", unit="% of its limit", chart="joint speeds and torques"),
]


def record_plan(config: RehearsalConfig, path: Path) -> Plan:
    """Plan a rehearsal's motion and record it, after the way from home; errors as of `plan_motion`."""
    config = place_target(config)
    plan = plan_motion(config)
    config = plan.config
    scene = compile_rehearsal(config, plan.arm.assembly)
    data = mujoco.MjData(scene.model)
    motions = [plan.motion] if plan.approach is None else [plan.approach.motion, plan.motion]
    begin = sum(motion.duration for motion in motions[:-1])
    data.qpos[scene.arm_qpos] = motions[0].state(0.0).q
    mujoco.mj_forward(scene.model, data)
    times = np.linspace(0.0, plan.path.duration, PATH_POINTS)
    waypoints = [WaypointEntry(name=name, time=begin + time, position=floats(plan.path.pose(time).position))
                 for name, time in plan.path.times.items()]
    clearance = RobotClearance(scene, plan.arm)
    recorder = SceneRecorder(path, scene.model, data, None, kind="plan", title=f"plan: {config.description}",
                             curves=CURVES, frame_rate=FRAME_RATE, tool=config.tool_name, waypoints=waypoints,
                             regions=counting_regions(config), commit=commit(),
                             paths={"commanded": np.array([plan.path.pose(t).position for t in times])})
    try:
        for time in np.arange(0.0, begin + plan.motion.duration + 0.5 / FRAME_RATE, 1.0 / FRAME_RATE):
            state = motions[0].state(time) if time < begin else plan.motion.state(time - begin)
            data.time, data.qpos[scene.arm_qpos] = time, state.q
            mujoco.mj_kinematics(scene.model, data)
            torque = plan.arm.inverse_dynamics(state.q, state.qd, state.qdd)
            nearest = [one.distance for one in clearance.measure(state.q)]
            values = [*(1e3 * distance if distance < FARTHEST else np.nan for distance in nearest),  # a curve's gap
                      float(np.degrees(plan.arm.margin(state.q))),
                      100.0 * float(np.abs(state.qd / plan.arm.velocity).max()),
                      100.0 * float(np.abs(torque / plan.arm.torque_limits).max())]
            recorder.add(data, lambda grains, values=values: values)
    finally:
        recorder.close()
    return plan
