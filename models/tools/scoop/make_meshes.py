"""Write the meshes of the flour scoop: `python models/tools/scoop/make_meshes.py`.

A trough with a rounded back, open in front. Frame: centre of the rim plane, x to the front, z up. Lengths are metres.
"""

import sys
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parent
sys.path[:0] = map(str, ROOT.parents[:3])  # the script also runs from a plain checkout

from curves import make_face  # noqa: E402
from forms import WALL, make_files, write_files  # noqa: E402
from sheets import compute_normals, make_wall  # noqa: E402

LENGTH, WIDTH, DEPTH = 0.085, 0.060, 0.030
"""Of the trough's cavity."""
BACK = 0.014
"""Length over which its back is rounded."""
HANDLE_START = (-0.0427, 0.0, -0.002)


def trough_grid(around: int = 32, along: int = 26) -> NDArray[np.float64]:
    """Return points (along // 2 x 2, around + 1, 3) of the trough's inner face, in curves from the back."""
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
    return inner


def make_trough(wall: float = WALL) -> trimesh.Trimesh:
    """Make the wall of the trough, grown outward; its flat rim lies in the plane z = 0."""
    inner = trough_grid()
    outward = compute_normals(inner)
    outward *= np.sign(np.sum(outward[-1, inner.shape[1] // 2] * [0.0, 0.0, -1.0]))
    outward[:, [0, -1], 2] = 0.0  # the rim stays in its plane, the front edge too
    outward[-1, :, 0] = 0.0
    outward /= np.linalg.norm(outward, axis=2, keepdims=True)
    return make_wall(inner, inner + wall * outward)


def make() -> dict[str, bytes]:
    """Make the files of the meshes."""
    face = make_face(trough_grid(), [-LENGTH / 2, 0.0, 0.0], closed=False)
    return make_files("scoop", make_trough, face, HANDLE_START)


if __name__ == "__main__":
    write_files(make(), ROOT / "assets")
