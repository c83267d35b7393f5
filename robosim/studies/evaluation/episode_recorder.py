"""The recording of an episode of a sub-task, as the viewer plays it."""

from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import mujoco

from robosim.base.provenance import commit
from robosim.envs.grain_env import GrainEnv
from robosim.episode.play import Transition
from robosim.randomization.variants import placed
from robosim.recordings.header import CurveEntry, RegionEntry, region_entry
from robosim.recordings.scene_recorder import SceneRecorder
from robosim.robot.mjspec import compile_spec
from robosim.scene.grains import container_region, grain_volume
from robosim.senses.task_scene import SeenBodies, build_task_spec
from robosim.shapes import tool_shape
from robosim.tasks.counting import TOOL
from robosim.tasks.sections import TARGET_MASS
from robosim.tasks.task import TaskConfig

SHARES = [CurveEntry(name="delivered", unit="%", chart="grains"), CurveEntry(name="spilled", unit="%", chart="grains")]
"""Readings that every frame has a value of."""
MASSES = [CurveEntry(name=name, unit="g", chart="mass") for name in ("poured", TARGET_MASS, "spilled")]
"""The same of a dosing task."""


class EpisodeRecorder(AbstractContextManager):
    """Records one episode: a frame at its start, and one after each action."""

    def __init__(self, env: GrainEnv, path: Path, policy: str) -> None:
        task, solver = env.task, env.solver
        self._env, self._total = env, 0.0
        self._curves, self._scale = (SHARES, 100.0) if task.dose is None else (MASSES, 1000.0)
        self._model = compile_spec(build_task_spec(task, env.carrier.build_spec()))
        self._bodies = SeenBodies(self._model, task)
        self._data = self._bodies.data
        self._info: dict[str, Any] = {"readings": {}}
        self._place()
        title = f"{env.TASK or task.description}: {policy}"
        self.recorder = SceneRecorder(
            path, self._model, self._data, solver, kind="task", title=title, caption=title,
            frame_rate=1.0 / (env.action_repeat * task.step_dt), tool=task.tool_name, colour=env.material.colour,
            grain_volume=grain_volume(task), curves=[*self._curves, CurveEntry(name="return", chart="return")],
            regions=places(placed(task, env.carrier.setting.place)), commit=commit())
        self._record()

    def add(self, step: Transition) -> None:
        """Record the state after an action."""
        self._total, self._info = self._total + step.reward, step.info
        self._place()
        self._record()

    def __exit__(self, *_: object) -> None:
        self.recorder.close()

    def _place(self) -> None:
        env, robot = self._env, self._env.carrier.robot_data
        self._bodies.place(env.carrier.setting.place, env.solver.collider_pose(TOOL),
                           None if robot is None else robot.qpos)
        self._data.time = env.step_count * env.task.step_dt
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)

    def _record(self) -> None:
        readings = self._info["readings"]
        values = [self._scale * readings.get(curve.name, float("nan")) for curve in self._curves]
        self.recorder.add(self._data, lambda grains: [*values, self._total])


def places(task: TaskConfig) -> list[RegionEntry]:
    """Return where grains may be: the target, containers, and the tool."""
    return [region_entry("target", task.target.region),
            region_entry(task.tool_name, tool_shape(task.tool).interior, body=task.tool_name),
            *(region_entry(name, *container_region(name, container)) for name, container in task.containers.items())]
