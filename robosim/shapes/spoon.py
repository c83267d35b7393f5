"""The spoon: a half-ellipsoid bowl on a bent handle. Frame: centre of the rim plane, x to the tip, z up; metres."""

import numpy as np
import trimesh
from numpy.typing import NDArray

import mpm
from robosim.shapes.lofts import loft, superellipse
from robosim.shapes.tool import WALL, ToolShape

Array = NDArray[np.float64]

HANDLE_START = (-0.0352, 0.0, 0.0)
"""Start of the handle: inside the wall, outside the cavity."""
BOWL: Array = np.array([0.035, 0.025, 0.030])
"""Semi-axes of the cavity."""
INTERIOR = mpm.Region((0.0, 0.0, 0.00425), (3**0.5 * 0.035, 3**0.5 * 0.025, 0.03575), round=True)
"""Wider than the rim by sqrt(3) and 4 cm above it: grains lie on the thickened rim, and cohesive heaps overhang it."""


def make_bowl(wall: float = WALL, around: int = 48, down: int = 20) -> trimesh.Trimesh:
    """Make the wall of the bowl, whose flat rim lies in the plane z=0.

    The outer surface lies `wall` [m] along the normals of the inner one; each has around x down quads.
    """
    polar = np.linspace(np.pi / 2.0, 0.0, down + 1)[:-1]  # from the rim to the last ring before the pole
    circle = superellipse(1.0, 1.0, count=around)
    unit = np.empty((down, around, 3))
    unit[:, :, :2] = np.sin(polar)[:, None, None] * circle
    unit[:, :, 2] = -np.cos(polar)[:, None]
    unit[0, :, 2] = 0.0
    inner = unit * BOWL
    normal = unit / BOWL  # gradient of the ellipsoid's equation; horizontal at the rim, so that it stays flat
    outer = inner + wall * normal / np.linalg.norm(normal, axis=2, keepdims=True)
    depth = BOWL[2]
    return loft(np.concatenate([inner[::-1], outer]), ([0.0, 0.0, -depth], [0.0, 0.0, -depth - wall]))


SHAPE = ToolShape("spoon", make_bowl, INTERIOR, HANDLE_START)
