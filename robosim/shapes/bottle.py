"""The bottle: a round body with a shoulder and a neck, open on top, gripped around its body.

Frame: on the axis, half way up the body, z towards the mouth; metres.
"""

import numpy as np
import trimesh
from numpy.typing import NDArray

import mpm
from robosim.shapes.lofts import revolve, smoothstep
from robosim.shapes.tool import WALL, ToolShape

Array = NDArray[np.float64]

RADIUS, BODY, SHOULDER, NECK_RADIUS, NECK = 0.030, 0.065, 0.015, 0.020, 0.013
"""Of the cavity: radius and height of the body, height of the shoulder, radius and height of the neck."""
FLOOR = -BODY / 2
"""Height of the cavity's floor."""
MOUTH = FLOOR + BODY + SHOULDER + NECK
"""Height of the mouth."""
INTERIOR = mpm.Region((0.0, 0.0, 0.5 * (FLOOR + MOUTH)), (1.1 * RADIUS, 1.1 * RADIUS, 0.5 * (MOUTH - FLOOR) + 0.004),
                      round=True)


def make_profile(grow: float) -> Array:
    """Make the outline (n, 2) of (radius, z) [m], from the floor to the mouth.

    grow: distance [m] outside the cavity.
    """
    angle = np.linspace(0.0, np.pi / 2, 7)
    corner, r = 0.006, RADIUS + grow
    low = [[r - corner + corner * np.sin(a), FLOOR - grow + corner * (1 - np.cos(a))] for a in angle]
    t = np.linspace(0.0, 1.0, 10)
    shoulder = np.stack([r + (NECK_RADIUS - RADIUS) * smoothstep(t), FLOOR + BODY + SHOULDER * t], 1)
    return np.concatenate([[[0.0, FLOOR - grow]], low, shoulder, [[NECK_RADIUS + grow, MOUTH]]])


def make_bottle(wall: float = WALL, around: int = 48) -> trimesh.Trimesh:
    """Make the wall of the bottle, with a thickness [m] grown outward."""
    return revolve(np.concatenate([make_profile(wall), make_profile(0.0)[::-1]]), around)


SHAPE = ToolShape("bottle", make_bottle, INTERIOR)
