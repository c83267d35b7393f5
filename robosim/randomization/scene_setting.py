"""A setting in the compiled scene of an arm: places of containers, masses, and the servo's gains."""

import mujoco

from robosim.randomization.draw import STANDARD, Setting
from robosim.randomization.still_bodies import StillBodies
from robosim.robot.joint_control import Servo
from robosim.robot.mjspec import body_ids_below
from robosim.scene.compiled import Scene
from robosim.tasks.task import TaskConfig


class SceneSetting:
    """Sets what a setting says in a scene; raises ConfigError for gains that MuJoCo's step is too long for."""

    def __init__(self, scene: Scene, servo: Servo, task: TaskConfig) -> None:
        self._scene, self._servo, self._present = scene, servo, STANDARD
        self._containers = StillBodies(scene.model, list(task.containers))
        self._carried = body_ids_below(scene.model, scene.wrist)
        self._scratch = mujoco.MjData(scene.model)
        """For MuJoCo's computation of the model's constants; to allocate one takes longer than the computation."""
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
