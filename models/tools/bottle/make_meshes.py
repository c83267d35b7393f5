"""Write the meshes of the bottle, and of the shaker: `python models/tools/bottle/make_meshes.py`.

Bottle: a round body with a shoulder and a neck, open on top. Shaker: the same with a perforated cap. Frame: on the
axis, half way up the body, z towards the mouth. Lengths are metres.
"""

import sys
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parent
sys.path[:0] = map(str, ROOT.parents[:3])  # the script also runs from a plain checkout

from curves import revolve, revolve_face, smoothstep  # noqa: E402
from forms import WALL, make_files, write_files  # noqa: E402

RADIUS, BODY, SHOULDER, NECK_RADIUS, NECK = 0.030, 0.065, 0.015, 0.020, 0.013
"""Of the cavity: radius and height of the body, height of the shoulder, radius and height of the neck."""
FLOOR = -BODY / 2
MOUTH = FLOOR + BODY + SHOULDER + NECK
HOLE = 0.0025
"""Diameter of the cap's holes, of which the mesh has the middle one."""
AROUND = 48


def make_profile(grow: float) -> NDArray[np.float64]:
    """Make the outline (n, 2) of (radius, z) from floor to mouth, `grow` outside the cavity."""
    angle = np.linspace(0.0, np.pi / 2, 7)
    corner, r = 0.006, RADIUS + grow
    low = [[r - corner + corner * np.sin(a), FLOOR - grow + corner * (1 - np.cos(a))] for a in angle]
    t = np.linspace(0.0, 1.0, 10)
    shoulder = np.stack([r + (NECK_RADIUS - RADIUS) * smoothstep(t), FLOOR + BODY + SHOULDER * t], 1)
    return np.concatenate([[[0.0, FLOOR - grow]], low, shoulder, [[NECK_RADIUS + grow, MOUTH]]])


def make_bottle(wall: float = WALL) -> trimesh.Trimesh:
    """Make the wall of the bottle, grown outward."""
    return revolve(np.concatenate([make_profile(wall), make_profile(0.0)[::-1]]), AROUND)


def make_capped(wall: float = WALL) -> trimesh.Trimesh:
    """Make the wall of the shaker, grown outward; only the cap's middle hole is cut."""
    cap = [[NECK_RADIUS + wall, MOUTH + wall], [0.5 * HOLE, MOUTH + wall], [0.5 * HOLE, MOUTH]]
    return revolve(np.concatenate([make_profile(wall), cap, make_profile(0.0)[::-1]]), AROUND)


def make() -> dict[str, bytes]:
    """Make the files of the bottle's meshes."""
    return make_files("bottle", make_bottle, revolve_face(make_profile(0.0), AROUND))


def make_shaker() -> dict[str, bytes]:
    """Make the files of the shaker's meshes; its inner face is closed, as its holes are smaller than a cell."""
    face = revolve(np.concatenate([make_profile(0.0), [[0.0, MOUTH]]]), AROUND)
    face.invert()
    return make_files("shaker", make_capped, face)


if __name__ == "__main__":
    write_files(make(), ROOT / "assets")
    write_files(make_shaker(), ROOT.parent / "shaker" / "assets")
