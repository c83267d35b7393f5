"""Pictures of a sub-task: tool or whole arm, container, target and grains on the table."""

import mujoco
import numpy as np

import mpm
from robosim.config.materials import MaterialConfig
from robosim.errors import ConfigError
from robosim.rendering.grain_skin import GRAIN_RADIUS, add_grain_skin
from robosim.rendering.renderer import SceneRenderer, add_mark, apply_quality
from robosim.robot.assembly import load_tool_model
from robosim.robot.mjspec import compile_spec, quiet_attachment
from robosim.scene.build import add_container
from robosim.scene.models import load_spec
from robosim.tasks.counting import TOOL
from robosim.tasks.field import grain_volume
from robosim.tasks.task import RegionConfig, TaskConfig

WIDTH, HEIGHT = 640, 480
"""Size of a picture in pixels."""


class Picture:
    """Draws a solver's grains and tool.

    arm: specification of the scene with the arm; None: the tool alone. window: show pictures instead of returning them.
    """

    def __init__(self, task: TaskConfig, material: MaterialConfig, camera: str, *, arm: mujoco.MjSpec | None = None,
                 window: bool = False) -> None:
        spec = build_task_spec(task, arm)
        apply_quality(spec)
        add_grain_skin(spec, task.grains.count, GRAIN_RADIUS * grain_volume(task) ** (1 / 3), material.colour)
        self._model = compile_spec(spec)
        self._data = mujoco.MjData(self._model)
        self._renderer = SceneRenderer(self._model, task.grains.count, WIDTH, HEIGHT)
        self._camera, self._window = camera, _Window() if window else None

    def draw(self, solver: mpm.Solver, robot_data: mujoco.MjData | None) -> np.ndarray | None:
        """Return a picture (height, width, 3), uint8; None where it is shown in a window.

        robot_data: the posture of the arm; None: the tool is drawn at its collider's pose.
        """
        place_tool(self._data, solver, robot_data)
        frame = self._renderer.draw(self._data, solver.positions(), self._camera)
        if self._window is None:
            return frame
        self._window.show(frame)
        return None

    def close(self) -> None:
        """Free the OpenGL context and the window."""
        self._renderer.close()
        if self._window is not None:
            self._window.close()


def build_task_spec(task: TaskConfig, arm: mujoco.MjSpec | None) -> mujoco.MjSpec:
    """Build what a sub-task looks like, without its grains; arm: the scene with the arm, None: the tool alone."""
    spec = arm if arm is not None else _build_scene_without_arm(task)
    _add_regions(spec, task)
    _add_cameras(spec, task)
    return spec


def place_tool(data: mujoco.MjData, solver: mpm.Solver, robot_data: mujoco.MjData | None) -> None:
    """Put the arm into the posture of a robot, or the tool alone at its collider's pose."""
    if robot_data is not None:
        data.qpos[:] = robot_data.qpos
    else:
        pose = solver.collider_pose(TOOL)
        data.mocap_pos[0], data.mocap_quat[0] = pose.position, pose.quaternion


def _build_scene_without_arm(task: TaskConfig) -> mujoco.MjSpec:
    """Build table, container, and the tool on a mocap body."""
    spec = load_spec("workcell", "workcell.xml")
    carrier = spec.worldbody.add_body(name="carrier", mocap=True)
    with quiet_attachment():
        carrier.add_frame().attach_body(load_tool_model(task.tool).spec.body(task.tool_name), "", "")
        for name, container in task.containers.items():
            add_container(spec, name, container)
    return spec


def _add_regions(spec: mujoco.MjSpec, task: TaskConfig) -> None:
    """Add the target, where it meets the table or as a box in the air, and the stand."""
    if task.container is None:
        add_mark(spec, task.target)
    if task.stand is not None:
        _add_block(spec, task.stand)


def _add_block(spec: mujoco.MjSpec, region: RegionConfig) -> None:
    """Add a block without contacts or mass."""
    spec.worldbody.add_geom(name="stand", type=mujoco.mjtGeom.mjGEOM_BOX, pos=list(region.centre), contype=0,
                            conaffinity=0, mass=0, size=list(region.half), rgba=[0.55, 0.42, 0.30, 1.0])


def _add_cameras(spec: mujoco.MjSpec, task: TaskConfig) -> None:
    """Add two cameras that see start and goal."""
    middle = 0.5 * (np.array(task.start.position) + np.array(task.goal))
    width = np.linalg.norm(np.array(task.start.position) - task.goal) + 0.30
    spec.worldbody.add_body(name="task_target", pos=(middle - [0.0, 0.0, 0.03]).tolist())
    for name, direction in (("task", [0.85, -0.25, 0.55]), ("side", [1.0, 0.0, 0.12])):
        position = middle + 1.5 * width * np.array(direction) / np.linalg.norm(direction)
        spec.worldbody.add_camera(name=name, pos=position.tolist(), fovy=34.0, targetbody="task_target",
                                  mode=mujoco.mjtCamLight.mjCAMLIGHT_TARGETBODY)


class _Window:
    """A window that shows frames; pygame is an optional dependency, imported with the first window."""

    def __init__(self) -> None:
        try:
            import pygame  # pyright: ignore[reportMissingImports]
        except ImportError as error:
            raise ConfigError('render_mode = "human" needs pygame: pip install ".[human]" in the checkout; without a '
                              'display use "rgb_array"') from error
        self._pygame = pygame
        self._screen = None

    def show(self, frame: np.ndarray) -> None:
        """Show a frame (height, width, 3)."""
        if self._screen is None:
            self._pygame.display.init()
            self._screen = self._pygame.display.set_mode((frame.shape[1], frame.shape[0]))
        self._pygame.event.pump()
        self._screen.blit(self._pygame.surfarray.make_surface(np.swapaxes(frame, 0, 1)), (0, 0))
        self._pygame.display.flip()

    def close(self) -> None:
        """Close the window."""
        if self._screen is not None:
            self._pygame.display.quit()
