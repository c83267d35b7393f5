"""Write the meshes of the spoon: `python models/tools/spoon/make_meshes.py`.

A half-ellipsoid bowl on a bent handle. Frame: centre of the rim plane, x to the tip, z up. Lengths are metres.
"""

import sys
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parent
sys.path[:0] = map(str, ROOT.parents[:3])  # the script also runs from a plain checkout

from curves import loft, make_face, superellipse  # noqa: E402
from forms import WALL, make_files, write_files  # noqa: E402

BOWL: NDArray[np.float64] = np.array([0.035, 0.025, 0.030])
"""Semi-axes of the bowl's cavity."""
HANDLE_START = (-0.0352, 0.0, 0.0)
"""Inside the wall, outside the cavity."""


def sphere_rings(around: int = 48, down: int = 20) -> NDArray[np.float64]:
    """Return points (down, around, 3) of the lower half of a unit sphere, in rings from the rim."""
    polar = np.linspace(np.pi / 2.0, 0.0, down + 1)[:-1]  # from the rim to the last ring before the pole
    unit = np.empty((down, around, 3))
    unit[:, :, :2] = np.sin(polar)[:, None, None] * superellipse(1.0, 1.0, count=around)
    unit[:, :, 2] = -np.cos(polar)[:, None]
    unit[0, :, 2] = 0.0
    return unit


def make_bowl(wall: float = WALL) -> trimesh.Trimesh:
    """Make the wall of the bowl, which lies along the normals of its inner surface; the flat rim is in z = 0."""
    unit = sphere_rings()
    inner = unit * BOWL
    normal = unit / BOWL  # gradient of the ellipsoid's equation; horizontal at the rim, so that it stays flat
    outer = inner + wall * normal / np.linalg.norm(normal, axis=2, keepdims=True)
    depth = BOWL[2]
    return loft(np.concatenate([inner[::-1], outer]), ([0.0, 0.0, -depth], [0.0, 0.0, -depth - wall]))


def make() -> dict[str, bytes]:
    """Make the files of the meshes."""
    face = make_face((sphere_rings() * BOWL)[::-1], [0.0, 0.0, -BOWL[2]])
    return make_files("spoon", make_bowl, face, HANDLE_START)


if __name__ == "__main__":
    write_files(make(), ROOT / "assets")
