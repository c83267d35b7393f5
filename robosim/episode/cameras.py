"""Cameras of a film that frame what happens, beside those of the scene."""

from collections.abc import Callable

import mujoco
import numpy as np

from robosim.base.errors import UnknownName
from robosim.episode import AUTO, ORBIT
from robosim.recordings.header import region_pose
from robosim.recordings.reader import Recording
from robosim.rendering.body_shapes import can_move
from robosim.robot.assembly import HAND_PREFIX

Camera = Callable[[float], str | mujoco.MjvCamera]
"""Gives the camera at a time [s]."""
FOVY_DEG, ASPECT = 30.0, 16 / 9
"""Vertical angle, and width by height of pictures."""
AZIMUTH_DEG, ELEVATION_DEG, SWING_DEG = 152.0, -21.0, 40.0
"""Direction of sight, from the other side of the table, and half the angle through which `ORBIT` turns."""
MARGIN, LOOKS = 1.06, 60
"""Room around what is framed, and frames that are looked at for it."""


def find_camera(model: mujoco.MjModel, name: str) -> str:
    """Return the name that a camera of a film, of the scene, or of the hand in it, has; raises UnknownName."""
    names = [model.camera(k).name for k in range(model.ncam)] + [AUTO, ORBIT]
    for found in (name, HAND_PREFIX + name):
        if found in names:
            return found
    raise UnknownName("camera", name, [known.removeprefix(HAND_PREFIX) for known in names if known])


def make_camera(recording: Recording, model: mujoco.MjModel, data: mujoco.MjData, name: str) -> Camera:
    """Make a camera of a film by its name, as of `find_camera`.
    data: of the model, in which the bodies of frames are placed."""
    if name not in (AUTO, ORBIT):
        return lambda time: name
    model.vis.global_.fovy = FOVY_DEG
    points, end = find_framed(recording, model, data), max(float(recording.values()[0][-1]), 1e-9)
    swing = SWING_DEG * (name == ORBIT)
    return lambda time: frame(points, AZIMUTH_DEG + swing * (2.0 * time / end - 1.0))


def find_framed(recording: Recording, model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """Return the corners (n, 3) [m] of what is to be seen over the whole run: moving geoms, and places of grains."""
    corners = np.array(np.meshgrid(*3 * [(-1.0, 1.0)])).reshape(3, 8).T
    geoms = np.flatnonzero(can_move(model)[model.geom_bodyid] & (model.geom_group < 3))
    found = []
    for k in np.unique(np.linspace(0, len(recording) - 1, LOOKS).astype(int)):
        scene = recording.scene(k)
        data.mocap_pos[:], data.mocap_quat[:] = scene.poses[:, :3], scene.poses[:, 3:]
        mujoco.mj_kinematics(model, data)
        boxes = corners * model.geom_aabb[geoms, None, 3:] + model.geom_aabb[geoms, None, :3]
        axes = data.geom_xmat[geoms].reshape(-1, 3, 3)
        found.append(np.einsum("nij,nkj->nki", axes, boxes) + data.geom_xpos[geoms, None])
    for region in recording.header.regions:
        if region.is_place and not region.body:
            found.append(region_pose(region, {}).apply(1.3 * corners * region.half)[None])
    return np.concatenate(found).reshape(-1, 3) if found else np.array([*corners * model.stat.extent / 2])


def frame(points: np.ndarray, azimuth_deg: float) -> mujoco.MjvCamera:
    """Return the nearest camera of this direction whose picture has all points (n, 3) [m]."""
    azimuth, elevation = np.radians((azimuth_deg, ELEVATION_DEG))
    forward = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    right = np.array([np.sin(azimuth), -np.cos(azimuth), 0.0])
    z, slope = points @ forward, np.tan(np.radians(FOVY_DEG / 2)) / MARGIN
    eye, ahead = np.zeros(3), np.inf
    for axis, tangent in ((right, ASPECT * slope), (np.cross(right, forward), slope)):
        x = points @ axis
        low, high = np.max(x - tangent * z), np.min(x + tangent * z)
        eye += 0.5 * (low + high) * axis
        ahead = min(ahead, (high - low) / (2.0 * tangent))
    camera = mujoco.MjvCamera()
    camera.type, camera.azimuth, camera.elevation = mujoco.mjtCamera.mjCAMERA_FREE, azimuth_deg, ELEVATION_DEG
    camera.distance = float(np.mean(z)) - ahead
    camera.lookat[:] = eye + (ahead + camera.distance) * forward
    return camera
