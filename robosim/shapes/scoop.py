"""The flour scoop: a trough with a rounded back on a bent handle, open in front.

Frame: centre of the rim plane, x to the open front, z up; metres.
"""

import numpy as np
import trimesh
from numpy.typing import NDArray

import mpm
from robosim.shapes.sheets import compute_normals, make_wall
from robosim.shapes.tool import WALL, ToolShape

Array = NDArray[np.float64]

LENGTH, WIDTH, DEPTH = 0.085, 0.060, 0.030
"""Of the cavity."""
BACK = 0.014
"""Length over which the back is rounded."""
HANDLE_START = (-0.0427, 0.0, -0.002)
"""Start of the handle."""
INTERIOR = mpm.Region((0.004, 0.0, 0.004), (0.0485, 0.036, 0.037))
"""The trough and the heap above it."""


def make_trough(wall: float = WALL, around: int = 32, along: int = 26) -> trimesh.Trimesh:
    """Make the wall of the trough, with a thickness [m] grown outward.

    Its flat rim lies in the plane z=0.
    """
    back, front = -LENGTH / 2, LENGTH / 2
    angle_back = np.linspace(0.0, np.pi / 2, along // 2)
    x = np.concatenate([back + BACK * (1 - np.cos(angle_back)), np.linspace(back + BACK, front, along // 2 + 1)[1:]])
    size = np.concatenate([np.maximum(np.sin(angle_back), 0.05), np.ones(along // 2)])
    angle = np.linspace(0.0, np.pi, around + 1)
    section = np.stack([WIDTH / 2 * np.cos(angle), -DEPTH * np.sin(angle)], -1)
    inner = np.empty((len(x), around + 1, 3))
    inner[:, :, 0] = x[:, None]
    inner[:, :, 1:] = size[:, None, None] * section
    inner[:, [0, -1], 2] = 0.0
    outward = compute_normals(inner)
    outward *= np.sign(np.sum(outward[-1, around // 2] * [0.0, 0.0, -1.0]))
    outward[:, [0, -1], 2] = 0.0  # the rim stays in its plane, the front edge too
    outward[-1, :, 0] = 0.0
    outward /= np.linalg.norm(outward, axis=2, keepdims=True)
    return make_wall(inner, inner + wall * outward)


SHAPE = ToolShape("scoop", make_trough, INTERIOR, HANDLE_START)
