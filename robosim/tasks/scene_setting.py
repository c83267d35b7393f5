"""A setting in a compiled scene: places of bodies that stand, masses of the arm, and the servo's gains."""

import mujoco
import numpy as np

import mpm
from robosim.robot.joint_control import Servo
from robosim.robot.mjspec import body_ids_below
from robosim.scene.compiled import Scene
from robosim.tasks.draw import HOME, STANDARD, Setting
from robosim.tasks.task import TaskConfig


class StillBodies:
    """Bodies of a compiled model without joints, by their names."""

    def __init__(self, model: mujoco.MjModel, names: list[str]) -> None:
        self._model = model
        self._home = {body: mpm.Pose(model.body_pos[body].copy(), model.body_quat[body].copy())
                      for body in (model.body(name).id for name in names)}
        self._place = HOME

    def place(self, place: mpm.Pose) -> bool:
        """Put the bodies where a displacement has them; return whether they were elsewhere."""
        if place is self._place or all(np.array_equal(one, other) for one, other in zip(place, self._place)):
            return False
        self._place = place
        for body, home in self._home.items():
            pose = home if place is HOME else place @ home
            self._model.body_pos[body], self._model.body_quat[body] = pose
        return True


class SceneSetting:
    """Sets what a setting says in a scene; raises ConfigError for gains that MuJoCo's step is too long for."""

    def __init__(self, scene: Scene, servo: Servo, task: TaskConfig) -> None:
        self._scene, self._servo, self._present = scene, servo, STANDARD
        self._containers = StillBodies(scene.model, list(task.containers))
        self._carried = body_ids_below(scene.model, scene.wrist)
        self._scratch = mujoco.MjData(scene.model)  # for mj_setConst; to allocate one takes longer than that
        self._mass, self._inertia = scene.model.body_mass.copy(), scene.model.body_inertia.copy()

    def apply(self, setting: Setting, data: mujoco.MjData) -> None:
        """Set a setting; data: of the scene, in the posture in which gains are checked."""
        model, before, self._present = self._scene.model, self._present, setting
        self._containers.place(setting.place)
        if setting.payload != before.payload:
            model.body_mass[self._carried] = setting.payload * self._mass[self._carried]
            model.body_inertia[self._carried] = setting.payload * self._inertia[self._carried]
            mujoco.mj_setConst(model, self._scratch)
        if (setting.stiffness, setting.damping) != (before.stiffness, before.damping):
            self._servo.scale(setting.stiffness, setting.damping)
            self._servo.check_step(model, data, self._scene.arm_dofs)
