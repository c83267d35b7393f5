"""What a sub-task looks like: its MuJoCo model with cameras, for pictures and for the terms that see."""

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np

import mpm
from robosim.base.errors import ConfigError, UnknownName
from robosim.rendering.renderer import TARGET_MARK, add_mark
from robosim.robot.mjspec import assembling
from robosim.scene.build import add_container
from robosim.scene.models import load_spec, load_tool_model
from robosim.tasks.scene_setting import StillBodies
from robosim.tasks.task import TaskConfig

OWN = "own_camera"
"""Name in the model of a camera that is given by numbers."""
PLACE = {"position", "look_at", "fovy_deg"}
"""Keys of such a camera."""


def build_task_spec(task: TaskConfig, arm: mujoco.MjSpec | None, *, marks: bool = True) -> mujoco.MjSpec:
    """Build what a sub-task looks like, without its grains.
    arm: the scene with the arm; None: the tool alone. marks: whether the target is marked."""
    spec = load_spec("workcell", "workcell.xml") if arm is None else arm
    if arm is None:
        carrier = spec.worldbody.add_body(name="carrier", mocap=True)
        with assembling():
            carrier.add_frame().attach_body(load_tool_model(task.tool).spec.body(task.tool_name), "", "")
            for name, container in task.containers.items():
                add_container(spec, name, container)
    if marks and not task.containers:
        add_mark(spec, task.target)
    if task.stand is not None:
        spec.worldbody.add_geom(name="stand", type=mujoco.mjtGeom.mjGEOM_BOX, pos=list(task.stand.centre), contype=0,
                                conaffinity=0, mass=0, size=list(task.stand.half), rgba=[0.55, 0.42, 0.30, 1.0])
    start, goal = np.array(task.start.position), np.array(task.goal)
    middle, width = 0.5 * (start + goal), np.linalg.norm(start - goal) + 0.30
    spec.worldbody.add_body(name="task_target", pos=(middle - [0.0, 0.0, 0.03]).tolist())
    for name, direction in (("task", [0.85, -0.25, 0.55]), ("side", [1.0, 0.0, 0.12])):  # they see start and goal
        position = middle + 1.5 * width * np.array(direction) / np.linalg.norm(direction)
        _add_camera(spec, name, position, 34.0, "task_target")
    return spec


def build_seen_spec(task: TaskConfig, arm: Any, camera: str | Mapping[str, Any], *,
                    marks: bool = True) -> tuple[mujoco.MjSpec, str]:
    """Build what a camera sees of a sub-task, and return it with the camera's name.
    arm: the `ArmTool`, or None. camera: a name, or {"position": [m] (3,), "look_at": [m] (3,), "fovy_deg": 45}.
    Raises UnknownName, ConfigError for a camera that cannot be used."""
    spec = build_task_spec(task, None if arm is None else arm.build_spec(), marks=marks)
    if not isinstance(camera, str):
        position, look_at, fovy_deg = read_place(camera)
        spec.worldbody.add_body(name=f"{OWN}_target", pos=look_at.tolist())
        _add_camera(spec, OWN, position, fovy_deg, f"{OWN}_target")
        return spec, OWN
    names = [one.name for one in spec.cameras]
    if camera not in names:
        raise UnknownName("camera", camera, names, 'or {"position": [x, y, z], "look_at": [x, y, z]}')
    return spec, camera


def read_place(camera: Mapping[str, Any]) -> tuple[np.ndarray, np.ndarray, float]:
    """Return position [m] (3,), point looked at [m] (3,) and field of view [deg] of a camera; raises ConfigError."""
    try:
        position, target = (np.array(camera[key], float) for key in ("position", "look_at"))
        fovy = float(camera.get("fovy_deg", 45.0))
        is_usable = position.shape == target.shape == (3,) and np.isfinite([position, target]).all() \
            and set(camera) <= PLACE and np.linalg.norm(position - target) > 1e-3 and 1.0 <= fovy <= 170.0
    except (KeyError, TypeError, ValueError):
        is_usable, position, target, fovy = False, np.zeros(3), np.zeros(3), 0.0
    if not is_usable:
        raise ConfigError(f'obs: camera = {dict(camera)!r}; accepted: {{"position": [x, y, z], "look_at": [x, y, z], '
                          f'"fovy_deg": 45}} in metres and degrees, with a distance between the two points')
    return position, target, fovy


class SeenBodies:
    """Bodies of a compiled scene of `build_task_spec`, where an episode has them."""

    def __init__(self, model: mujoco.MjModel, task: TaskConfig) -> None:
        self.data = mujoco.MjData(model)
        names = [*task.containers, TARGET_MARK]
        self._still = StillBodies(model, [name for name in names if mujoco.mj_name2id(
            model, mujoco.mjtObj.mjOBJ_BODY, name) >= 0])

    def place(self, place: mpm.Pose, tool: mpm.Pose, qpos: np.ndarray | None) -> bool:
        """Put all to where they are: the arm into a posture, or without one the tool alone at its pose.
        place: of container and target. qpos: of the scene with the arm. Returns whether what stands still has moved."""
        if qpos is not None:
            self.data.qpos[:] = qpos
        else:
            self.data.mocap_pos[0], self.data.mocap_quat[0] = tool.position, tool.quaternion
        return self._still.place(place)


def _add_camera(spec: mujoco.MjSpec, name: str, position: np.ndarray, fovy_deg: float, target: str) -> None:
    """Add a camera at a position [m] (3,) that looks at a body, with z up in its picture."""
    spec.worldbody.add_camera(name=name, pos=position.tolist(), fovy=fovy_deg, targetbody=target,
                              mode=mujoco.mjtCamLight.mjCAMLIGHT_TARGETBODY)
