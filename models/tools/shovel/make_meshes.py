"""Write the meshes of the shovel: `python models/tools/shovel/make_meshes.py`.

A curved blade with wings that pushes, hollow side ahead. Frame: middle of the blade's lower edge, x ahead, z up.
Lengths are metres.
"""

import sys
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parent
sys.path[:0] = map(str, ROOT.parents[:3])  # the script also runs from a plain checkout

from forms import WALL, make_files, write_files  # noqa: E402
from sheets import compute_normals, make_wall  # noqa: E402

WIDTH, HEIGHT = 0.080, 0.045
CURVE = 0.060
"""Radius of the blade's curve about a lateral axis ahead of it."""
WINGS = 0.025
"""Distance of the blade's ends ahead of its middle: without wings a pile flows off to both sides."""
HANDLE_START = (-0.0062, 0.0, 0.022)


def make_blade(wall: float = WALL, across: int = 16, up: int = 16) -> trimesh.Trimesh:
    """Make the blade, grown backward; its lower edge lies in the plane z = 0."""
    half = np.arcsin(0.5 * HEIGHT / CURVE)
    angle = np.linspace(-half, half, up + 1)
    edge = CURVE * np.cos(half)
    z = CURVE * np.sin(angle) + 0.5 * HEIGHT
    x = edge - CURVE * np.cos(angle)
    y = np.linspace(-WIDTH / 2, WIDTH / 2, across + 1)
    front: NDArray[np.float64] = np.empty((up + 1, across + 1, 3))
    front[:, :, 0] = x[:, None] + WINGS * np.abs(2.0 * y / WIDTH) ** 3
    front[:, :, 1], front[:, :, 2] = y, z[:, None]
    back = compute_normals(front)
    back *= np.sign(np.sum(back[up // 2, across // 2] * [-1.0, 0.0, 0.0]))
    back[[0, -1], :, 2] = 0.0  # lower and upper edge stay in their planes
    back /= np.linalg.norm(back, axis=2, keepdims=True)
    return make_wall(front, front + wall * back)


def make() -> dict[str, bytes]:
    """Make the files of the meshes."""
    return make_files("shovel", make_blade, handle_start=HANDLE_START)


if __name__ == "__main__":
    write_files(make(), ROOT / "assets")
