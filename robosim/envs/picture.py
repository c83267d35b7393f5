"""Pictures of a sub-task: tool or whole arm, container, target and grains on the table."""

import mujoco
import numpy as np

import mpm
from robosim.base.errors import ConfigError
from robosim.config.materials import MaterialConfig
from robosim.rendering.grain_skin import GRAIN_RADIUS, add_grain_skin
from robosim.rendering.renderer import SceneRenderer, apply_quality
from robosim.robot.mjspec import compile_spec
from robosim.scene.grains import grain_volume
from robosim.senses.task_scene import SeenBodies, build_task_spec
from robosim.tasks.counting import TOOL
from robosim.tasks.task import TaskConfig

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
        self._bodies = SeenBodies(self._model, task)
        self._renderer = SceneRenderer(self._model, task.grains.count, WIDTH, HEIGHT)
        self._camera, self._window = camera, _Window() if window else None

    def draw(self, solver: mpm.Solver, robot_data: mujoco.MjData | None, place: mpm.Pose) -> np.ndarray | None:
        """Return a picture (height, width, 3), uint8; None where it is shown in a window.

        robot_data: the posture of the arm; None: the tool is drawn at its collider's pose. place: displacement of
        container and target.
        """
        self._bodies.place(place, solver.collider_pose(TOOL), None if robot_data is None else robot_data.qpos)
        frame = self._renderer.draw(self._bodies.data, solver.positions(), self._camera)
        if self._window is None:
            return frame
        self._window.show(frame)
        return None

    def close(self) -> None:
        """Free the OpenGL context and the window."""
        self._renderer.close()
        if self._window is not None:
            self._window.close()


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
