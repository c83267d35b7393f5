"""The shovel: a curved blade with wings that pushes, hollow side ahead, on a bent handle.

Frame: middle of the blade's lower edge, x ahead, z up; metres.
"""

import numpy as np
import trimesh
from numpy.typing import NDArray

import mpm
from robosim.shapes.sheets import compute_normals, make_wall
from robosim.shapes.tool import WALL, ToolShape

Array = NDArray[np.float64]

WIDTH, HEIGHT = 0.080, 0.045
"""Of the blade."""
CURVE = 0.060
"""Radius of the blade's curve about a lateral axis ahead of it."""
WINGS = 0.025
"""Distance of its ends ahead of its middle: without wings a pile flows off to both sides."""
HANDLE_START = (-0.0062, 0.0, 0.022)
"""Start of the handle."""
INTERIOR = mpm.Region((0.02, 0.0, 0.02), (0.03, 0.5 * WIDTH, 0.025))
"""In front of the blade."""


def make_blade(wall: float = WALL, across: int = 16, up: int = 16) -> trimesh.Trimesh:
    """Make the blade with a thickness [m] grown backward.

    Its hollow side is ahead, its lower edge in the plane z=0.
    """
    half = np.arcsin(0.5 * HEIGHT / CURVE)
    angle = np.linspace(-half, half, up + 1)
    edge = CURVE * np.cos(half)
    z = CURVE * np.sin(angle) + 0.5 * HEIGHT
    x = edge - CURVE * np.cos(angle)
    y = np.linspace(-WIDTH / 2, WIDTH / 2, across + 1)
    front = np.empty((up + 1, across + 1, 3))
    front[:, :, 0] = x[:, None] + WINGS * np.abs(2.0 * y / WIDTH) ** 3
    front[:, :, 1], front[:, :, 2] = y, z[:, None]
    back = compute_normals(front)
    back *= np.sign(np.sum(back[up // 2, across // 2] * [-1.0, 0.0, 0.0]))
    back[[0, -1], :, 2] = 0.0  # lower and upper edge stay in their planes
    back /= np.linalg.norm(back, axis=2, keepdims=True)
    return make_wall(front, front + wall * back)


SHAPE = ToolShape("shovel", make_blade, INTERIOR, HANDLE_START)
