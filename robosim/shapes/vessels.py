"""Vessels that are lofted or revolved: the spoon, the bottle, the shaker and open-topped containers.

Spoon: a half-ellipsoid bowl. Frame: centre of the rim plane, x to the tip, z up.
Bottle: a round body with a shoulder and a neck, open on top, gripped around its body. Frame: on the axis, half way up
the body, z towards the mouth. Shaker: the bottle with a perforated cap on its mouth. Lengths are metres.
"""

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

import mpm
from robosim.shapes.faces import make_face, revolve_face
from robosim.shapes.lofts import loft, revolve, smoothstep, superellipse
from robosim.shapes.tool import WALL, Holes, ToolShape

Array = NDArray[np.float64]

CONTAINER_CORNER = 0.008
"""Inner radius [m] of a container's upright edges."""
SPOON_HANDLE_START = (-0.0352, 0.0, 0.0)
"""Start of the spoon's handle: inside the wall, outside the cavity."""
BOWL: Array = np.array([0.035, 0.025, 0.030])
"""Semi-axes of its cavity."""
SPOON_INTERIOR = mpm.Region((0.0, 0.0, 0.00425), (3**0.5 * 0.035, 3**0.5 * 0.025, 0.03575), round=True)
"""Wider than the rim by sqrt(3) and 4 cm above it: grains lie on the thickened rim, and cohesive heaps overhang it."""
RADIUS, BODY, SHOULDER, NECK_RADIUS, NECK = 0.030, 0.065, 0.015, 0.020, 0.013
"""Of the bottle's cavity: radius and height of the body, height of the shoulder, radius and height of the neck."""
FLOOR = -BODY / 2
"""Height of its floor."""
MOUTH = FLOOR + BODY + SHOULDER + NECK
"""Height of its mouth."""
BOTTLE_INTERIOR = mpm.Region((0.0, 0.0, 0.5 * (FLOOR + MOUTH)),
                             (1.1 * RADIUS, 1.1 * RADIUS, 0.5 * (MOUTH - FLOOR) + 0.004), round=True)

SHAKER_INTERIOR = mpm.Region((0.0, 0.0, 0.5 * (FLOOR + MOUTH)),
                             (1.1 * RADIUS, 1.1 * RADIUS, 0.5 * (MOUTH - FLOOR)), round=True)
"""Up to its cap."""
HOLE, HOLE_RINGS = 0.0025, (0.006, 0.012)
"""Diameter of a hole in the shaker's cap, and radii of the two rings of holes."""


def bowl_directions(around: int, down: int) -> Array:
    """Return points (down, around, 3) of the lower half of a unit sphere, in rings from the rim."""
    polar = np.linspace(np.pi / 2.0, 0.0, down + 1)[:-1]  # from the rim to the last ring before the pole
    circle = superellipse(1.0, 1.0, count=around)
    unit = np.empty((down, around, 3))
    unit[:, :, :2] = np.sin(polar)[:, None, None] * circle
    unit[:, :, 2] = -np.cos(polar)[:, None]
    unit[0, :, 2] = 0.0
    return unit


def make_bowl(wall: float = WALL, around: int = 48, down: int = 20) -> trimesh.Trimesh:
    """Make the wall of the bowl, whose flat rim lies in the plane z=0.

    The outer surface lies `wall` [m] along the normals of the inner one; each has around x down quads.
    """
    unit = bowl_directions(around, down)
    inner = unit * BOWL
    normal = unit / BOWL  # gradient of the ellipsoid's equation; horizontal at the rim, so that it stays flat
    outer = inner + wall * normal / np.linalg.norm(normal, axis=2, keepdims=True)
    depth = BOWL[2]
    return loft(np.concatenate([inner[::-1], outer]), ([0.0, 0.0, -depth], [0.0, 0.0, -depth - wall]))


def make_bowl_face() -> trimesh.Trimesh:
    """Make the inner face of the bowl."""
    return make_face((bowl_directions(48, 20) * BOWL)[::-1], [0.0, 0.0, -BOWL[2]])


SPOON = ToolShape("spoon", make_bowl, SPOON_INTERIOR, SPOON_HANDLE_START, make_bowl_face)


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


def make_bottle_face() -> trimesh.Trimesh:
    """Make the inner face of the bottle."""
    return revolve_face(make_profile(0.0))


BOTTLE = ToolShape("bottle", make_bottle, BOTTLE_INTERIOR, None, make_bottle_face)


def make_cap_holes() -> Holes:
    """Make the holes of the shaker's cap: one in the middle, and two rings of six."""
    places = [(0.0, 0.0, MOUTH)]
    for radius, offset in zip(HOLE_RINGS, (0.0, 0.5)):
        angles = 2.0 * np.pi * (np.arange(6) + offset) / 6
        places += [(float(radius * np.cos(a)), float(radius * np.sin(a)), MOUTH) for a in angles]
    return Holes(tuple(places), (0.0, 0.0, 1.0), HOLE)


def make_shaker(wall: float = WALL, around: int = 48) -> trimesh.Trimesh:
    """Make the wall of the shaker, with a thickness [m] grown outward; only the cap's middle hole is cut."""
    cap = [[NECK_RADIUS + wall, MOUTH + wall], [0.5 * HOLE, MOUTH + wall], [0.5 * HOLE, MOUTH]]
    return revolve(np.concatenate([make_profile(wall), cap, make_profile(0.0)[::-1]]), around)


def make_shaker_face() -> trimesh.Trimesh:
    """Make the inner face of the shaker, closed: its holes are orifices of the shell."""
    face = revolve(np.concatenate([make_profile(0.0), [[0.0, MOUTH]]]), 48)
    face.invert()
    return face


SHAKER = ToolShape("shaker", make_shaker, SHAKER_INTERIOR, None, make_shaker_face, make_cap_holes())


def box_outline(size: Array, corner: float, grow: float, z: float) -> Array:
    """Make the rounded rectangle (n, 3) of a box, grown outward by `grow` [m], at height z [m]."""
    arc = np.linspace(0.0, np.pi / 2.0, 7)
    half = size[:2] / 2.0 - corner
    parts = []
    for i, sign in enumerate(((1, 1), (-1, 1), (-1, -1), (1, -1))):
        angle = arc + i * np.pi / 2.0
        direction = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        parts.append(half * np.array(sign) + (corner + grow) * direction)
    flat = np.concatenate(parts)
    return np.column_stack([flat, np.full(len(flat), z)])


def make_box_face(inner_size: ArrayLike, corner: float) -> trimesh.Trimesh:
    """Make the inner face of an open-topped box with rounded upright edges; arguments as of `make_container_shell`."""
    size = np.asarray(inner_size, float)
    return make_face([box_outline(size, corner, 0.0, z) for z in (0.0, float(size[2]))], np.zeros(3))


def make_container_shell(inner_size: ArrayLike, wall: float = 0.006,
                         corner: float = CONTAINER_CORNER) -> trimesh.Trimesh:
    """Make an open-topped box with rounded upright edges.

    Its origin is the centre of the inner floor, z up. inner_size (3,): cavity [m]. wall: thickness [m] of walls and
    floor, by default the real one. corner: inner radius [m] of the upright edges.
    """
    size = np.asarray(inner_size, float)

    def make_outline(grow: float, z: float) -> Array:
        """Make the rounded rectangle (n, 3), grown outward by `grow`, at height z."""
        return box_outline(size, corner, grow, z)

    lip = wall / 3.0  # bevels of the upper rim catch the light
    top = float(size[2])
    rings = [
        make_outline(wall - lip, -wall), make_outline(wall, lip - wall), make_outline(wall, top - lip),
        make_outline(wall - lip, top), make_outline(lip, top), make_outline(0.0, top - lip), make_outline(0.0, 0.0),
    ]
    return loft(rings)
