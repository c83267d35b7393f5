"""Pictures and films of a scene of one's own with its grains."""

from contextlib import AbstractContextManager

import mujoco
import numpy as np
from numpy.typing import NDArray

import mpm
from robosim.rendering.grain_skin import add_grain_skin
from robosim.rendering.renderer import SceneRenderer
from robosim.robot.mjspec import compile_spec

BALL = 0.62
"""Radius of a ball of volume 1."""
SALT = (0.93, 0.93, 0.95)


class GrainRenderer(AbstractContextManager["GrainRenderer"]):
    """Draws a copy of a specification with the grains of a solver, which have a colour.
    width, height: of pictures, in pixels. Raises RenderingUnavailable where there is no OpenGL."""

    def __init__(self, spec: mujoco.MjSpec, solver: mpm.Solver, *, colour: tuple[float, float, float] = SALT,
                 width: int = 1280, height: int = 720) -> None:
        drawn, count = spec.copy(), len(solver.masses())
        volume = solver.masses() / np.repeat([body.material.density for body in solver.bodies], solver.particles.counts)
        add_grain_skin(drawn, count, BALL * float(np.cbrt(np.mean(volume))), [*colour, 1.0])
        self._model = compile_spec(drawn)
        self._data, self._solver = mujoco.MjData(self._model), solver
        self._renderer = SceneRenderer(self._model, count, width, height)

    def draw(self, data: mujoco.MjData, camera: str | mujoco.MjvCamera | None = None) -> NDArray[np.uint8]:
        """Draw the present state (height, width, 3): bodies as in data, grains as in the solver.
        camera: of the specification, or a free one; None: a free one that sees everything."""
        self._data.qpos[:], self._data.mocap_pos[:] = data.qpos, data.mocap_pos
        self._data.mocap_quat[:] = data.mocap_quat
        if camera is None:
            camera = mujoco.MjvCamera()
            mujoco.mjv_defaultFreeCamera(self._model, camera)
        return self._renderer.draw(self._data, self._solver.positions(), camera)

    def close(self) -> None:
        """Free the OpenGL context."""
        self._renderer.close()

    def __exit__(self, *error: object) -> None:
        self.close()
