"""A planned motion as a recording without grains: the arm along it, and its margins."""

from pathlib import Path

import mujoco
import numpy as np

from robosim.config.rehearsal_file import RehearsalConfig
from robosim.recordings.header import CurveEntry, WaypointEntry, three
from robosim.recordings.scene_recorder import SceneRecorder
from robosim.rehearsal.planning.motion_sequence import place_target
from robosim.rehearsal.planning.plan import Plan, plan_motion
from robosim.rehearsal.recorder import PATH_POINTS, counting_regions
from robosim.reports.provenance import commit
from robosim.robot.mjspec import body_ids_below
from robosim.scene.build import compile_rehearsal
from robosim.scene.compiled import Scene

FRAME_RATE = 50.0
"""Frames per second of the motion."""
NEIGHBOURS = 3
"""Bodies along the arm whose distance from each other hardly changes."""
FARTHEST = 0.2
"""Distance [m] up to which clearances are measured."""
CURVES = [
    CurveEntry(name="to table and containers", unit="mm", chart="clearance of arm, hand and tool"),
    CurveEntry(name="between parts of the robot", unit="mm", chart="clearance of arm, hand and tool"),
    CurveEntry(name="margin of the closest joint", unit="deg", chart="joint limits"),
    CurveEntry(name="largest speed", unit="% of its limit", chart="joint speeds and torques"),
    CurveEntry(name="largest torque", unit="% of its limit", chart="joint speeds and torques"),
]


def record_plan(config: RehearsalConfig, path: Path) -> Plan:
    """Plan a rehearsal's motion and record it; returns the plan.

    Raises ConfigError or UnreachableWaypoint as `plan_motion` does.
    """
    config = place_target(config)
    plan = plan_motion(config)
    config = plan.config
    scene = compile_rehearsal(config)
    data = mujoco.MjData(scene.model)
    data.qpos[scene.arm_qpos] = plan.motion.state(0.0).q
    mujoco.mj_forward(scene.model, data)
    times = np.linspace(0.0, plan.path.duration, PATH_POINTS)
    waypoints = [WaypointEntry(name=name, time=time, position=three(plan.path.pose(time).position))
                 for name, time in plan.path.times.items()]
    clearances = Clearances(scene)
    recorder = SceneRecorder(path, scene.model, data, None, kind="plan", title=f"plan: {config.description}",
                             curves=CURVES, frame_rate=FRAME_RATE, tool=config.tool, waypoints=waypoints,
                             regions=counting_regions(config), commit=commit(),
                             paths={"commanded": np.array([plan.path.pose(t).position for t in times])})
    try:
        for time in np.arange(0.0, plan.motion.duration + 0.5 / FRAME_RATE, 1.0 / FRAME_RATE):
            state = plan.motion.state(time)
            data.time, data.qpos[scene.arm_qpos] = time, state.q
            mujoco.mj_kinematics(scene.model, data)
            torque = plan.arm.inverse_dynamics(state.q, state.qd, state.qdd)
            margin = np.minimum(state.q - plan.arm.lower, plan.arm.upper - state.q).min()
            values = [*clearances.measure(data), float(np.degrees(margin)),
                      100.0 * float(np.abs(state.qd / plan.arm.velocity).max()),
                      100.0 * float(np.abs(torque / plan.arm.torque_limits).max())]
            recorder.add(data, lambda grains, values=values: values)
    finally:
        recorder.close()
    return plan


class Clearances:
    """Smallest distances of the robot's collision shapes from its surroundings, and between its own parts."""

    def __init__(self, scene: Scene) -> None:
        self._model = model = scene.model
        colliding = [g for g in range(model.ngeom) if model.geom_contype[g] or model.geom_conaffinity[g]]
        own = set(scene.robot_bodies().tolist())
        robot = [g for g in colliding if int(model.geom_bodyid[g]) in own]
        others = [g for g in colliding if int(model.geom_bodyid[g]) not in own]
        self._outer = [(a, b) for a in robot for b in others if model.body_weldid[model.geom_bodyid[a]] > 0]
        order = {int(body): k for k, body in enumerate(sorted({int(model.geom_bodyid[g]) for g in robot}))}
        hand = set(body_ids_below(model, scene.wrist).tolist())
        self._inner = [(a, b) for k, a in enumerate(robot) for b in robot[k + 1 :]
                       if abs(order[int(model.geom_bodyid[a])] - order[int(model.geom_bodyid[b])]) > NEIGHBOURS
                       and not {int(model.geom_bodyid[a]), int(model.geom_bodyid[b])} <= hand]

    def measure(self, data: mujoco.MjData) -> tuple[float, float]:
        """Return both distances [mm]; NaN beyond FARTHEST."""
        return self._least(data, self._outer), self._least(data, self._inner)

    def _least(self, data: mujoco.MjData, pairs: list[tuple[int, int]]) -> float:
        least = FARTHEST
        for a, b in pairs:
            if self._model.geom_type[b] != mujoco.mjtGeom.mjGEOM_PLANE and \
                    self._model.geom_type[a] != mujoco.mjtGeom.mjGEOM_PLANE:
                gap = np.linalg.norm(data.geom_xpos[a] - data.geom_xpos[b])
                if gap - self._model.geom_rbound[a] - self._model.geom_rbound[b] > least:
                    continue
            least = min(least, mujoco.mj_geomDistance(self._model, data, a, b, least, None))
        return 1e3 * least if least < FARTHEST else float("nan")
