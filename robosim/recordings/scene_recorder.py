"""Recording a MuJoCo scene with its field, at a fixed rate of simulated time."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

import mpm
from robosim.base.errors import ConfigError
from robosim.recordings.appearance import body_name, pack_appearance, viewed_bodies
from robosim.recordings.frames import GrainState, SceneState
from robosim.recordings.header import VERSION, BodyEntry, CameraEntry, RecordingHeader, floats
from robosim.recordings.writer import RecordingWriter
from robosim.rendering.body_shapes import body_shapes, can_move
from robosim.rendering.grain_skin import GRAIN_RADIUS

FRAME_RATE = 20.0
"""Frames per second of simulated time, unless one asks for others."""
PRESSURE_INTERVAL = 4
"""Frames for which the pressure of grains that was read once stands: reading it takes longer than all the rest."""
NO_GRAINS = GrainState(np.zeros((0, 3)), np.zeros(0), np.zeros(0), np.zeros(0, bool))


class SceneRecorder:
    """Records poses, grains and readings of a scene into a file.
    solver: None for a scene without grains. paths: name -> positions (n, 3) [m]. more: further entries of
    `RecordingHeader`: kind, title, curves that `add` is given values of, tool at which grains act, ...
    Raises OSError where the file cannot be written."""

    def __init__(self, path: Path, model: mujoco.MjModel, data: mujoco.MjData, solver: mpm.Solver | None, *,
                 frame_rate: float = FRAME_RATE, grain_volume: float | None = None,
                 colour: Sequence[float] = (0.85, 0.82, 0.75), paths: dict[str, np.ndarray] | None = None,
                 **more: Any) -> None:
        if not 0.0 < frame_rate <= 1000.0:
            raise ConfigError(f"frame rate of a recording: {frame_rate} 1/s; accepted: above 0, up to 1000")
        self._solver, self._interval, self._next = solver, 1.0 / frame_rate, float(data.time)
        shapes = body_shapes(model)
        drawn = sorted(shapes.keys() | viewed_bodies(model))
        moves = can_move(model)
        self._moving = [body for body in drawn if moves[body]]
        grid = solver.grid if solver is not None else None
        self._pressures = read_grains(solver).pressures  # compiles what reads stresses
        volume = 1e-9 if solver is None else grain_volume or float(np.mean(solver.masses() / solver.densities()))
        header = RecordingHeader(
            version=VERSION, frame_rate=frame_rate,
            grains=0 if solver is None else int(sum(solver.particles.counts)),
            grain_radius=GRAIN_RADIUS * volume ** (1 / 3), colour=floats(colour[:3]),
            lower=floats(np.zeros(3) if grid is None else grid.lower),
            upper=floats(np.ones(3) if grid is None else np.asarray(grid.lower) + grid.cells * grid.cell),
            bodies=[BodyEntry(name=body_name(model, body), moves=bool(moves[body]), position=floats(data.xpos[body]),
                              quaternion=floats(data.xquat[body])) for body in drawn],
            cameras=list(_cameras(model, data)), **more)
        self.writer = RecordingWriter(path, header, {body_name(model, body): shape for body, shape in shapes.items()},
                                      paths, pack_appearance(model))
        self.close = self.writer.close

    def is_due(self, time: float) -> bool:
        """Return whether a frame is due at a time [s]."""
        return time + 1e-9 >= self._next

    def add(self, data: mujoco.MjData, values: Callable[[GrainState], Sequence[float]] | None = None,
            wrench: mpm.Wrench | None = None) -> bool:
        """Record the present state if a frame is due; return whether it was.
        values: called with the grains for the values of the curves. wrench: of the grains on the tool."""
        if not self.is_due(data.time):
            return False
        while self.is_due(data.time):
            self._next += self._interval
        poses = np.concatenate([data.xpos[self._moving], data.xquat[self._moving]], axis=1)
        row = np.zeros(6) if wrench is None else np.concatenate(wrench)
        is_read = self.writer.frames % PRESSURE_INTERVAL == 0
        grains = read_grains(self._solver, None if is_read else self._pressures)
        self._pressures = grains.pressures
        numbers = np.asarray(values(grains) if values else [], float)
        self.writer.add(SceneState(float(data.time), poses, row, numbers), grains)
        return True


def read_grains(solver: mpm.Solver | None, pressures: np.ndarray | None = None) -> GrainState:
    """Return what a frame has of a solver's grains; pressures (n,) [Pa]: None: as they are now."""
    if solver is None:
        return NO_GRAINS
    if pressures is None:
        stresses = solver.stresses()
        pressures = -(stresses[:, 0, 0] + stresses[:, 1, 1] + stresses[:, 2, 2]) / 3.0
    return GrainState(solver.positions(), np.linalg.norm(solver.velocities(), axis=1), pressures, solver.awake)


def _cameras(model: mujoco.MjModel, data: mujoco.MjData) -> list[CameraEntry]:
    entries = []
    for camera in range(model.ncam):
        if model.body_weldid[model.cam_bodyid[camera]] != 0:
            continue
        position, aimed = data.cam_xpos[camera], int(model.cam_targetbodyid[camera])
        target = data.xpos[aimed] if aimed >= 0 else \
            position - 0.6 * data.cam_xmat[camera].reshape(3, 3)[:, 2]  # [m], to the point that a view turns about
        entries.append(CameraEntry(name=model.camera(camera).name or f"camera {camera}", position=floats(position),
                                   target=floats(target), fov_deg=float(np.clip(model.cam_fovy[camera], 2.0, 160.0))))
    return entries
