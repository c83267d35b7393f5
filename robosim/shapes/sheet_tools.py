"""Tools whose head is a wall between two curved sheets: the flour scoop and the shovel.

Scoop: a trough with a rounded back, open in front. Frame: centre of the rim plane, x to the open front, z up.
Shovel: a curved blade with wings that pushes, hollow side ahead. Frame: middle of the blade's lower edge, x ahead,
z up. Lengths are metres.
"""

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

import mpm
from robosim.shapes.faces import make_face
from robosim.shapes.tool import WALL, ToolShape

Array = NDArray[np.float64]

TROUGH_LENGTH, TROUGH_WIDTH, TROUGH_DEPTH = 0.085, 0.060, 0.030
"""Of the trough's cavity."""
BACK = 0.014
"""Length over which its back is rounded."""
SCOOP_HANDLE_START = (-0.0427, 0.0, -0.002)
"""Start of the handle."""
SCOOP_INTERIOR = mpm.Region((0.004, 0.0, 0.004), (0.0485, 0.036, 0.037))
"""The trough and the heap above it."""
BLADE_WIDTH, BLADE_HEIGHT = 0.080, 0.045
"""Of the blade."""
CURVE = 0.060
"""Radius of the blade's curve about a lateral axis ahead of it."""
WINGS = 0.025
"""Distance of the blade's ends ahead of its middle: without wings a pile flows off to both sides."""
SHOVEL_HANDLE_START = (-0.0062, 0.0, 0.022)
"""Start of the handle."""
SHOVEL_INTERIOR = mpm.Region((0.02, 0.0, 0.02), (0.03, 0.5 * BLADE_WIDTH, 0.025))
"""In front of the blade."""


def compute_normals(grid: Array) -> Array:
    """Compute unit normals (k, n, 3) of a grid of points (k, n, 3).

    Their direction is across rows x along rows.
    """
    rows, columns = np.gradient(grid, axis=0), np.gradient(grid, axis=1)
    normals = np.cross(rows, columns)
    return normals / np.maximum(np.linalg.norm(normals, axis=2, keepdims=True), 1e-12)


def make_wall(near: ArrayLike, far: ArrayLike) -> trimesh.Trimesh:
    """Make the closed solid between two grids of points (k, n, 3) [m].

    Its normals point outward.
    """
    near, far = np.asarray(near, float), np.asarray(far, float)
    k, n, _ = near.shape
    index = np.arange(k * n).reshape(k, n)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    front = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    border = np.concatenate([index[0, :-1], index[:-1, -1], index[-1, :0:-1], index[:0:-1, 0]])
    after = np.roll(border, -1)
    rim = np.concatenate([np.stack([border, after, after + k * n], -1), np.stack([border, after + k * n,
                                                                                border + k * n], -1)])
    faces = np.concatenate([front, front[:, ::-1] + k * n, rim])
    mesh = trimesh.Trimesh(np.concatenate([near.reshape(-1, 3), far.reshape(-1, 3)]), faces, process=False)
    if mesh.volume < 0.0:
        mesh.invert()
    return mesh


def trough_grid(around: int, along: int) -> Array:
    """Return points (along // 2 x 2, around + 1, 3) of the trough's inner face, in curves from the back."""
    back, front = -TROUGH_LENGTH / 2, TROUGH_LENGTH / 2
    angle_back = np.linspace(0.0, np.pi / 2, along // 2)
    x = np.concatenate([back + BACK * (1 - np.cos(angle_back)), np.linspace(back + BACK, front, along // 2 + 1)[1:]])
    size = np.concatenate([np.maximum(np.sin(angle_back), 0.05), np.ones(along // 2)])
    angle = np.linspace(0.0, np.pi, around + 1)
    section = np.stack([TROUGH_WIDTH / 2 * np.cos(angle), -TROUGH_DEPTH * np.sin(angle)], -1)
    inner = np.empty((len(x), around + 1, 3))
    inner[:, :, 0] = x[:, None]
    inner[:, :, 1:] = size[:, None, None] * section
    inner[:, [0, -1], 2] = 0.0
    return inner


def make_trough(wall: float = WALL, around: int = 32, along: int = 26) -> trimesh.Trimesh:
    """Make the wall of the trough, with a thickness [m] grown outward.

    Its flat rim lies in the plane z=0.
    """
    inner = trough_grid(around, along)
    outward = compute_normals(inner)
    outward *= np.sign(np.sum(outward[-1, around // 2] * [0.0, 0.0, -1.0]))
    outward[:, [0, -1], 2] = 0.0  # the rim stays in its plane, the front edge too
    outward[-1, :, 0] = 0.0
    outward /= np.linalg.norm(outward, axis=2, keepdims=True)
    return make_wall(inner, inner + wall * outward)


def make_trough_face() -> trimesh.Trimesh:
    """Make the inner face of the trough, closed at the back and open in front."""
    return make_face(trough_grid(32, 26), [-TROUGH_LENGTH / 2, 0.0, 0.0], closed=False)


SCOOP = ToolShape("scoop", make_trough, SCOOP_INTERIOR, SCOOP_HANDLE_START, make_trough_face)


def make_blade(wall: float = WALL, across: int = 16, up: int = 16) -> trimesh.Trimesh:
    """Make the blade with a thickness [m] grown backward.

    Its hollow side is ahead, its lower edge in the plane z=0.
    """
    half = np.arcsin(0.5 * BLADE_HEIGHT / CURVE)
    angle = np.linspace(-half, half, up + 1)
    edge = CURVE * np.cos(half)
    z = CURVE * np.sin(angle) + 0.5 * BLADE_HEIGHT
    x = edge - CURVE * np.cos(angle)
    y = np.linspace(-BLADE_WIDTH / 2, BLADE_WIDTH / 2, across + 1)
    front = np.empty((up + 1, across + 1, 3))
    front[:, :, 0] = x[:, None] + WINGS * np.abs(2.0 * y / BLADE_WIDTH) ** 3
    front[:, :, 1], front[:, :, 2] = y, z[:, None]
    back = compute_normals(front)
    back *= np.sign(np.sum(back[up // 2, across // 2] * [-1.0, 0.0, 0.0]))
    back[[0, -1], :, 2] = 0.0  # lower and upper edge stay in their planes
    back /= np.linalg.norm(back, axis=2, keepdims=True)
    return make_wall(front, front + wall * back)


SHOVEL = ToolShape("shovel", make_blade, SHOVEL_INTERIOR, SHOVEL_HANDLE_START)
