"""The handle of spoon, scoop and shovel: a bend, then straight up and back, thick where the fingers close.

Tool frame: x towards the tip, y lateral, z up. All lengths are metres.
"""

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

from robosim.shapes.lofts import round_ends, smoothstep, stations, sweep

Array = NDArray[np.float64]

LENGTH = 0.200  # arc length of the axis
RISE = np.pi / 4  # slope of the straight part
BEND = 0.060  # radius of the curve between tool and straight part
THICK_FROM = 0.095  # arc length at which the full grip radius is reached
GRIP_RADIUS = 0.011
GRIP_TO_END = 0.055  # the outer finger pads reach 49 mm to either side and stay off the rounded end
DIRECTION: Array = np.array([-np.cos(RISE), 0.0, np.sin(RISE)])  # towards the end


def handle_point(s: ArrayLike, start: ArrayLike) -> Array:
    """Return points (k, 3) in m of the axis at the arc lengths s (k,) in m from its start (3,)."""
    s = np.atleast_1d(np.asarray(s, float))
    angle = np.minimum(s / BEND, RISE)
    straight = np.maximum(s - BEND * RISE, 0.0)
    x = -BEND * np.sin(angle) - straight * np.cos(RISE)
    z = BEND * (1.0 - np.cos(angle)) + straight * np.sin(RISE)
    return np.stack([x, np.zeros_like(s), z], axis=1) + np.asarray(start)


def handle_half_axes(s: ArrayLike) -> Array:
    """Return the half axes (k, 2) in m, lateral and upright, at arc lengths s (k,) in m."""
    s = np.asarray(s, float)
    root = np.array([0.0065, 0.0035])  # flatter at the weld, so that it stays low over the rim
    thin = np.array([0.0050, 0.0050])
    near = root + (thin - root) * smoothstep(s / 0.030)[:, None]
    return near + (GRIP_RADIUS - near) * smoothstep((s - 0.045) / (THICK_FROM - 0.045))[:, None]


def handle(start: ArrayLike, segments: int = 28) -> trimesh.Trimesh:
    """Return the handle from a weld at `start` (3,) to its rounded end, as one closed mesh."""
    end = 0.007
    s = stations(LENGTH, 0.001, end, inner=30, cap=4)
    scale = round_ends(s, 0.0, end)[:, None]
    scale[s < 0.001] *= 0.9  # a small chamfer at the weld
    return sweep(handle_point(s, start), handle_half_axes(s) * scale, segments=segments)


def grip_pose(start: ArrayLike) -> Array:
    """Return the pose (4, 4) of the grip frame in the tool frame.

    z runs along the handle towards the tool, y along the hand's approach (tool -y), and x = y x z points up
    and forward, to the side of the thumb.
    """
    z = -DIRECTION
    y = np.array([0.0, -1.0, 0.0])
    pose = np.eye(4)
    pose[:3, :3] = np.stack([np.cross(y, z), y, z], axis=1)
    pose[:3, 3] = handle_point(LENGTH - GRIP_TO_END, start)[0]
    return pose
