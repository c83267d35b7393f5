"""Cameras of a film that frame what happens, beside those of the scene."""

from collections.abc import Callable

import mujoco
import numpy as np
from scipy.ndimage import gaussian_filter1d

import mpm
from robosim.base.errors import UnknownName
from robosim.episode import FRAMING, NEAR, ORBIT
from robosim.recordings.header import RegionEntry, body_poses, region_pose
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
NEAR_ELEVATION_DEG, BESIDE_DEG, LEAST_TILT_DEG = -38.0, 55.0, 25.0
"""Of `NEAR`: height of its sight, angle between it and the side to which the tool opens as it empties, and least tilt
that counts as emptying; a tool that stays upright is seen from the side to which it moves."""
NEAR_WIDTH, LEAST_WIDTH, BELOW, NEAR_LAG = 3.1, 0.25, 0.16, 0.5
"""Width of what is seen, in the widest place of grains, and at least [m]; how far below a tool that empties its middle
is, in this width; and time [s] over which the tool's way is smoothed."""


def find_camera(model: mujoco.MjModel, name: str) -> str:
    """Return the name that a camera of a film, of the scene, or of the hand in it, has; raises UnknownName."""
    names = [model.camera(k).name for k in range(model.ncam)] + [*FRAMING]
    for found in (name, HAND_PREFIX + name):
        if found in names:
            return found
    raise UnknownName("camera", name, [known.removeprefix(HAND_PREFIX) for known in names if known])


def make_camera(recording: Recording, model: mujoco.MjModel, data: mujoco.MjData, name: str) -> Camera:
    """Make a camera of a film by its name, as of `find_camera`.
    data: of the model, in which the bodies of frames are placed."""
    if name not in FRAMING:
        return lambda time: name
    model.vis.global_.fovy = FOVY_DEG
    if name == NEAR:
        return follow_tool(recording)
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


def follow_tool(recording: Recording) -> Callable[[float], mujoco.MjvCamera]:
    """Return a camera that follows the inside of the tool, or the middle of all bodies that move where it has none."""
    header = recording.header
    inside = next((r for r in header.regions if r.body and r.body == header.tool), None)
    frames = [recording.scene(k) for k in range(len(recording))]
    times = np.array([frame.time for frame in frames])
    poses = [tool_pose(recording, frame.poses, inside) for frame in frames]
    steps = NEAR_LAG * header.frame_rate
    places = gaussian_filter1d(np.array([pose.position for pose in poses]), steps, axis=0, mode="nearest")
    up = np.array([pose.matrix[:, 2] for pose in poses])
    opens = up[np.argmin(up[:, 2])]
    below = BELOW
    if opens[2] > np.cos(np.radians(LEAST_TILT_DEG)):
        way, below = places - places[0], 0.0
        opens = way[np.argmax(np.linalg.norm(way[:, :2], axis=1))]
    side = np.degrees(np.arctan2(-opens[1], -opens[0]))  # of a camera that looks into the tool
    azimuth = min((side - BESIDE_DEG, side + BESIDE_DEG),
                  key=lambda angle: abs((angle - AZIMUTH_DEG + 180.0) % 360.0 - 180.0))
    widest = max((2.0 * max(r.half[:2]) for r in header.regions if r.is_place and not r.body), default=0.0)
    width = max(NEAR_WIDTH * widest, LEAST_WIDTH)

    def camera(time: float) -> mujoco.MjvCamera:
        result = mujoco.MjvCamera()
        result.type, result.azimuth, result.elevation = mujoco.mjtCamera.mjCAMERA_FREE, azimuth, NEAR_ELEVATION_DEG
        result.distance = width / (2.0 * ASPECT * np.tan(np.radians(FOVY_DEG / 2)))
        result.lookat[:] = [np.interp(time, times, column) for column in places.T]
        result.lookat[2] -= below * width
        return result

    return camera


def tool_pose(recording: Recording, poses: np.ndarray, inside: RegionEntry | None) -> mpm.Pose:
    """Return the world pose of the inside of a tool in a frame; without one of the tool, or of the middle of what moves
    or of the scene."""
    bodies = body_poses(recording.header, poses)
    if inside is not None:
        return region_pose(inside, bodies)
    if recording.header.tool in bodies:
        return bodies[recording.header.tool]
    middle = poses[:, :3].mean(0) if len(poses) else np.mean([recording.header.lower, recording.header.upper], axis=0)
    return mpm.Pose(middle, np.array([1.0, 0.0, 0.0, 0.0]))
