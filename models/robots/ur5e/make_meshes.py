"""Write the visual meshes of the UR5e as binary STL: `python models/robots/ur5e/make_meshes.py`.

Lengths in m. The arm uses two sizes of one joint housing: a barrel about z (the joint axis) with a lid at its
upper end and a neck along +x; ur5e.xml has the poses. The other meshes are in the frame of their MJCF body.
"""

import sys
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

ROOT = Path(__file__).resolve().parent
sys.path[:0] = map(str, ROOT.parents[1:3])  # the script also runs from a plain checkout

from curves import bezier, loft, revolve, smoothstep, superellipse, write_solids  # noqa: E402

Array = NDArray[np.float64]
Parts = dict[str, trimesh.Trimesh]

LARGE = 0.058
"""Radius [m] of the housings of the base, shoulder and elbow joints."""
SMALL = 0.038
"""Radius [m] of the housings of the three wrist joints."""
Z_TO_X = trimesh.transformations.rotation_matrix(np.pi / 2.0, [0.0, 1.0, 0.0])
Z_TO_Y = trimesh.transformations.rotation_matrix(-np.pi / 2.0, [1.0, 0.0, 0.0])


def turn(mesh: trimesh.Trimesh, matrix: Array, offset: ArrayLike = (0.0, 0.0, 0.0)) -> trimesh.Trimesh:
    """Rotate a mesh by a (4, 4) matrix, then shift it by offset (3,) in m; returns the same object."""
    mesh.apply_transform(matrix)
    mesh.apply_translation(offset)
    return mesh


def make_housing(radius: float, low: float, high: float, port: float, segments: int) -> trimesh.Trimesh:
    """Make a joint housing: a barrel about z from low to high and a neck along +x that ends at port (all m)."""
    edge = 0.05 * radius
    barrel = revolve([(radius - edge, low), (radius, low + edge), (radius, high)], segments)
    neck = revolve([(radius, 0.0), (radius, port - edge), (radius - edge, port)], segments)
    return trimesh.util.concatenate([barrel, turn(neck, Z_TO_X)])


def make_lid(radius: float, back: float, front: float, top: float, segments: int) -> trimesh.Trimesh:
    """Make the lid of a housing, a cap about z with an oblique rim.

    radius: largest radius; back, front: z of the rim at -x and at +x; top: z of the apex (all m).
    """
    circle = superellipse(1.0, 1.0, count=segments)
    rim = 0.5 * (back + front) + 0.5 * (front - back) * circle[:, 0]
    edge, crown, lip = 0.20 * radius, 0.06 * radius, 0.025 * radius
    rings = [(radius - lip, rim), (radius, rim + 0.5 * lip), (radius, rim + 2.0 * lip), (radius - lip, rim + 2.6 * lip)]
    for angle in np.linspace(0.0, 0.5 * np.pi, 4):
        height = top - crown - edge * (1.0 - np.sin(angle))
        rings.append((radius - lip - edge * (1.0 - np.cos(angle)), np.maximum(height, rim + 2.7 * lip)))
    rings.append((0.4 * radius, np.full(segments, top - 0.25 * crown)))
    sections = [np.column_stack([size * circle, height]) for size, height in rings]
    return loft(sections, (None, (0.0, 0.0, top)))


def make_tube(
    start: float, end: float, collars: tuple[float, float], radii: tuple[float, float], flare: float
) -> trimesh.Trimesh:
    """Make an arm tube about x from start to end with a collar at both ends.

    collars: radii of the two collars; radii: those of the tube next to them; flare: length over which a collar
    narrows to the tube (all m).
    """
    length, band = end - start, 0.007
    t = np.linspace(0.0, 1.0, 4)
    head = np.column_stack([collars[0] + (radii[0] - collars[0]) * smoothstep(t) ** 0.6, band + flare * t])
    tail = np.column_stack([radii[1] + (collars[1] - radii[1]) * (1.0 - smoothstep(1.0 - t) ** 0.6),
                            length - band - flare * (1.0 - t)])
    ends = [(collars[0], 0.0)], [(collars[1], length)]
    return turn(revolve(np.concatenate([ends[0], head, tail, ends[1]]), 28), Z_TO_X, (start, 0.0, 0.0))


def make_bend() -> trimesh.Trimesh:
    """Make the curved elbow of the forearm, from the elbow joint (facing +y) to the tube (along +x)."""
    outer = [(-0.058, 0.060), (-0.058, 0.030), (-0.060, -0.010), (-0.042, -0.041), (0.010, -0.041), (0.063, -0.041)]
    inner = [(0.058, 0.060), (0.058, 0.0575), (0.0605, 0.0555), (0.063, 0.055)]
    t = np.linspace(0.0, 1.0, 10)
    back, front = bezier(outer, t), bezier(inner, t)
    width = LARGE + (0.048 - LARGE) * smoothstep(t)
    circle = superellipse(1.0, 1.0, count=28)
    rings = np.empty((len(t), len(circle), 3))
    for i in range(len(t)):
        rings[i, :, :2] = 0.5 * (back[i] + front[i]) + 0.5 * circle[:, :1] * (front[i] - back[i])
        rings[i, :, 2] = width[i] * circle[:, 1]
    return loft(rings)


def make_base() -> trimesh.Trimesh:
    """Make the conical foot with four pockets above the mounting screws."""
    rows = [(0.0, 0.0735), (0.0015, 0.0745), (0.0115, 0.0745), (0.0125, 0.0740), (0.030, 0.0715), (0.055, 0.0650),
            (0.066, 0.0622), (0.074, 0.0600), (0.085, 0.0580)]
    circle = superellipse(1.0, 1.0, count=40)
    angle = np.arctan2(circle[:, 1], circle[:, 0])
    offset = np.abs((angle % (0.5 * np.pi)) - 0.25 * np.pi)  # from the nearest of 45, 135, 225 and 315 deg
    pocket = smoothstep((0.33 - offset) / 0.14)
    rings = []
    for height, radius in rows:
        deep = 1.0 - float(smoothstep((height - 0.050) / 0.024)) if height > 0.012 else 0.0
        rings.append(np.column_stack([circle * (radius - (radius - 0.056) * pocket * deep)[:, None],
                                      np.full(len(circle), height)]))
    return loft(rings)


def make_flange() -> trimesh.Trimesh:
    """Make wrist 3 about y with the flange face at y=0: a drum, a collar and the centring recess."""
    profile = [(0.0365, -0.0466), (0.0375, -0.0456), (0.0375, -0.0175), (0.0360, -0.0155), (0.0350, -0.0150),
               (0.0350, -0.0085), (0.0325, -0.0075), (0.0315, -0.0065), (0.0315, -0.0008), (0.0307, 0.0),
               (0.0158, 0.0), (0.0158, -0.006), (0.0, -0.006)]
    return turn(revolve(profile, 24), Z_TO_Y)


def make_arm() -> Parts:
    """Make all meshes of the arm."""
    return {
        "base": make_base(),
        "housing_large": make_housing(LARGE, -0.064, 0.052, 0.060, 30),
        "housing_small": make_housing(SMALL, -0.046, 0.042, 0.046, 26),
        "housing_wrist_1": make_housing(SMALL, -0.046, 0.042, 0.0733, 26),
        "lid_large": make_lid(0.0605, 0.009, 0.052, 0.072, 28),
        "lid_small": make_lid(0.0395, 0.008, 0.039, 0.057, 24),
        "tube_upper_arm": make_tube(0.073, 0.352, (LARGE, LARGE), (0.0435, 0.0435), 0.024),
        "tube_forearm": make_tube(0.076, 0.339, (0.048, SMALL), (0.0405, 0.0365), 0.018),
        "bend_forearm": make_bend(),
        "wrist_3": make_flange(),
    }


if __name__ == "__main__":
    print(f"{write_solids(make_arm(), ROOT / 'assets') / 1e3:.0f} kB of meshes")
