"""Shapes of the spoon and of the containers, shared by the visual models and by the material simulation.

Tool frame: origin at the centre of the bowl's rim plane, x towards the tip, y lateral, z up (the open side).
All lengths are metres.
"""

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

from robosim.lofts import loft, round_ends, smoothstep, stations, superellipse, sweep

Array = NDArray[np.float64]

HANDLE_LENGTH = 0.200  # arc length of the handle's axis
HANDLE_RISE = np.pi / 4  # slope of the straight part
HANDLE_BEND = 0.060  # radius of the curve between bowl and straight part
HANDLE_START = -0.0352  # x of the first section: inside the 1.5 mm wall, never inside the bowl's cavity
HANDLE_THICK_FROM = 0.095  # arc length at which the full grip radius is reached
GRIP_RADIUS = 0.011
GRIP_TO_END = 0.055  # the outer finger pads reach 49 mm to either side and stay off the rounded end
HANDLE_DIRECTION: Array = np.array([-np.cos(HANDLE_RISE), 0.0, np.sin(HANDLE_RISE)])  # towards the end


def spoon_bowl(
    length: float = 0.070, width: float = 0.050, depth: float = 0.030, wall: float = 0.0015,
    around: int = 48, down: int = 20,
) -> trimesh.Trimesh:
    """Return the wall of a half-ellipsoid bowl whose flat rim lies in the plane z=0.

    The inner surface is the half ellipsoid with semi-axes (length/2, width/2, depth) below z=0; the outer one
    lies `wall` further along the surface normal. Lengths in m; around x down quads on each surface.
    """
    axes = np.array([length / 2.0, width / 2.0, depth])
    polar = np.linspace(np.pi / 2.0, 0.0, down + 1)[:-1]  # from the rim to just before the pole
    circle = superellipse(1.0, 1.0, count=around)
    unit = np.empty((down, around, 3))
    unit[:, :, :2] = np.sin(polar)[:, None, None] * circle
    unit[:, :, 2] = -np.cos(polar)[:, None]
    unit[0, :, 2] = 0.0
    inner = unit * axes
    normal = unit / axes  # gradient of the ellipsoid's equation; horizontal at the rim, which keeps it flat
    outer = inner + wall * normal / np.linalg.norm(normal, axis=2, keepdims=True)
    return loft(
        np.concatenate([inner[::-1], outer]), ([0.0, 0.0, -depth], [0.0, 0.0, -depth - wall])
    )


def handle_point(s: ArrayLike) -> Array:
    """Return points (k, 3) in m of the handle's axis at the arc lengths s (k,) in m from the bowl."""
    s = np.atleast_1d(np.asarray(s, float))
    angle = np.minimum(s / HANDLE_BEND, HANDLE_RISE)
    straight = np.maximum(s - HANDLE_BEND * HANDLE_RISE, 0.0)
    x = -HANDLE_BEND * np.sin(angle) - straight * np.cos(HANDLE_RISE)
    z = HANDLE_BEND * (1.0 - np.cos(angle)) + straight * np.sin(HANDLE_RISE)
    return np.stack([HANDLE_START + x, np.zeros_like(s), z], axis=1)


def handle_half_axes(s: ArrayLike) -> Array:
    """Return the handle's half axes (k, 2) in m, lateral and upright, at arc lengths s (k,) in m."""
    s = np.asarray(s, float)
    root = np.array([0.0065, 0.0035])  # flatter at the weld, so that it stays low over the rim
    thin = np.array([0.0050, 0.0050])
    near = root + (thin - root) * smoothstep(s / 0.030)[:, None]
    return near + (GRIP_RADIUS - near) * smoothstep((s - 0.045) / (HANDLE_THICK_FROM - 0.045))[:, None]


def spoon_handle(segments: int = 28) -> trimesh.Trimesh:
    """Return the curved handle, from the bowl's back wall to the rounded end, as one closed mesh."""
    end = 0.007
    s = stations(HANDLE_LENGTH, 0.001, end, inner=30, cap=4)
    scale = round_ends(s, 0.0, end)[:, None]
    scale[s < 0.001] *= 0.9  # a small chamfer at the weld
    return sweep(handle_point(s), handle_half_axes(s) * scale, segments=segments)


def spoon_components(wall: float = 0.0015) -> list[trimesh.Trimesh]:
    """Return [bowl, handle] in the tool frame, for a bowl wall thickness in m."""
    return [spoon_bowl(wall=wall), spoon_handle()]


def grip_point() -> Array:
    """Return the point (3,) in m of the handle's axis where the grip centre lies, in the tool frame."""
    return handle_point(HANDLE_LENGTH - GRIP_TO_END)[0]


def grip_pose() -> Array:
    """Return the pose (4, 4) of the grip frame in the tool frame.

    z runs along the handle towards the bowl, y along the hand's approach (tool -y), and x = y x z points up
    and forward, to the side of the thumb.
    """
    z = -HANDLE_DIRECTION
    y = np.array([0.0, -1.0, 0.0])
    pose = np.eye(4)
    pose[:3, :3] = np.stack([np.cross(y, z), y, z], axis=1)
    pose[:3, 3] = grip_point()
    return pose


def container_shell(inner_size: ArrayLike, wall: float = 0.006, corner: float = 0.008) -> trimesh.Trimesh:
    """Return an open-topped box with rounded upright edges; origin at the centre of the inner floor, z up.

    inner_size (3,) is the cavity in m, wall the thickness of walls and floor, corner the inner edge radius.
    """
    size = np.asarray(inner_size, float)

    def outline(grow: float, z: float) -> Array:
        """Return the rounded rectangle (n, 3), grown outward by `grow`, at height z."""
        arc = np.linspace(0.0, np.pi / 2.0, 7)
        half = size[:2] / 2.0 - corner
        parts = []
        for i, sign in enumerate(((1, 1), (-1, 1), (-1, -1), (1, -1))):
            angle = arc + i * np.pi / 2.0
            turn = np.stack([np.cos(angle), np.sin(angle)], axis=1)
            parts.append(half * np.array(sign) + (corner + grow) * turn)
        flat = np.concatenate(parts)
        return np.column_stack([flat, np.full(len(flat), z)])

    lip = wall / 3.0  # bevels of the upper rim catch the light
    top = float(size[2])
    rings = [
        outline(wall - lip, -wall), outline(wall, lip - wall), outline(wall, top - lip),
        outline(wall - lip, top), outline(lip, top), outline(0.0, top - lip), outline(0.0, 0.0),
    ]
    return loft(rings)


def self_check() -> None:
    """Assert closed meshes, outward normals, one piece each, and the bowl's cavity of 55 cm^3."""
    for wall in (0.001, 0.0015, 0.006, 0.012):
        bowl = spoon_bowl(wall=wall)
        assert bowl.is_watertight and bowl.is_winding_consistent and bowl.body_count == 1
        hull = spoon_bowl(wall=wall).convex_hull
        cavity = hull.volume - bowl.volume
        assert abs(cavity / (2.0 / 3.0 * np.pi * 0.035 * 0.025 * 0.030) - 1.0) < 0.01, (wall, cavity)
        assert np.allclose(bowl.bounds[1, 2], 0.0) and np.allclose(bowl.bounds[1, 0], 0.035 + wall)
    handle = spoon_handle()
    box = container_shell((0.16, 0.13, 0.08))
    for mesh in (handle, box):
        assert mesh.is_watertight and mesh.is_winding_consistent and mesh.volume > 0.0
        assert mesh.body_count == 1


if __name__ == "__main__":
    self_check()
