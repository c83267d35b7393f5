"""Write the visual meshes of the xArm7 as binary STL: `python models/robots/xarm7/make_meshes.py`.

Covers are drawn in the zero posture, x forward and z up, about the origin of their link (tables in mm), and are then
turned into the frame of their MJCF body, which lies as in UFACTORY's modified DH convention (files in m).
"""

import sys
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

FOLDER = Path(__file__).resolve().parent
sys.path[:0] = map(str, FOLDER.parents[1:3])  # the script also runs from a plain checkout

from curves import loft, revolve, superellipse, write_solids  # noqa: E402

Array = NDArray[np.float64]
Parts = dict[str, trimesh.Trimesh]

COUNT = 28
"""Points of a section: 0.3 mm between chord and circle at the largest radius."""
SEAM = 0.8
"""Half of the dark gap [mm] at every joint."""
LARGE, MIDDLE, SMALL = 47.5, 42.4, 37.4
"""Radii [mm] of the housings of joints 1 and 2, 3 to 5, 6 and 7."""
TURN = {"base": 0, "link1": 0, "link2": 90, "link3": 0, "link4": -90, "link5": 180, "link6": 90, "link7": 180}
"""Rotation about x [deg] from the axes of the zero posture to those of the body."""


def bend(rows: ArrayLike, exponent: float = 2.0) -> trimesh.Trimesh:
    """Loft a tube that bends in the y-z plane.

    rows (k, 6) in mm: y and z of the back, y and z of the front, half width along x, x of the middle. Each section is
    an ellipse (exponent 2) between its back and its front.
    """
    table = np.asarray(rows, float)
    curve = superellipse(1.0, 1.0, exponent, COUNT)
    rings = np.empty((len(table), COUNT, 3))
    for ring, (y0, z0, y1, z1, width, x) in zip(rings, table, strict=True):
        ring[:, 0] = x + width * curve[:, 0]
        ring[:, 1] = (y0 + y1) / 2.0 + curve[:, 1] * (y0 - y1) / 2.0
        ring[:, 2] = (z0 + z1) / 2.0 + curve[:, 1] * (z0 - z1) / 2.0
    return loft(rings)


def corner(back: ArrayLike, front: ArrayLike, radii: tuple[float, float], widths: tuple[float, float],
           count: int = 6) -> Array:
    """Make the rows (count, 5) of `bend` for a right-angled elbow from the y to the z direction; lengths in mm.

    back, front (2,): y and z at which the extended straight edges meet; radii: of the rounded back and front; widths:
    half widths along x of the first and the last section.
    """
    angle = np.linspace(0.0, np.pi / 2.0, count)
    sides = []
    for tip, radius in ((np.asarray(back, float), radii[0]), (np.asarray(front, float), radii[1])):
        towards = np.sign(np.subtract(front, back))
        sides.append(tip + radius * towards * np.stack([1.0 - np.sin(angle), 1.0 - np.cos(angle)], axis=1))
    width = np.linspace(*widths, count)
    return np.column_stack([sides[0], sides[1], width])


def make_plate(end: tuple[float, float], radius: float, inner: float, outer: float, edge: float) -> trimesh.Trimesh:
    """Make the flat cover between two parallel drums, with a round edge on its outer side; lengths in mm.

    end: x and z of the second drum, the first is at the origin; inner, outer: y of the two faces.
    """
    angle = np.arctan2(end[1], end[0])
    half = COUNT // 2 + 1
    first = angle + np.pi / 2.0 + np.linspace(0.0, np.pi, half)
    circle = np.concatenate([np.stack([np.cos(a), np.sin(a)], axis=1) for a in (first, first + np.pi)])
    middle = np.repeat([(0.0, 0.0), end], half, axis=0)
    side = np.sign(outer - inner)
    rows = [(inner, 0.0)]
    rows += [(outer - side * edge * (1.0 - np.sin(a)), edge * (1.0 - np.cos(a))) for a in np.radians([0, 30, 60, 90])]
    rings = np.empty((len(rows), 2 * half, 3))
    for ring, (y, inset) in zip(rings, rows, strict=True):
        outline = middle + (radius - inset) * circle
        ring[:, 0], ring[:, 1], ring[:, 2] = outline[:, 0], y, outline[:, 1]
    return loft(rings)


def make_drum(radius: float, low: float, high: float, edge: float, count: int = COUNT) -> trimesh.Trimesh:
    """Make a cylinder about z between two heights, with a round upper edge; lengths in mm."""
    angle = np.radians([0, 30, 60, 90])
    upper = np.stack([radius - edge * (1.0 - np.cos(angle)), high - edge * (1.0 - np.sin(angle))], axis=1)
    return revolve(np.concatenate([[(radius, low)], upper]), count)


def turn(mesh: trimesh.Trimesh, degrees: float, axis: tuple[int, int, int] = (1, 0, 0)) -> trimesh.Trimesh:
    """Rotate a mesh about an axis through the origin and return it."""
    mesh.apply_transform(trimesh.transformations.rotation_matrix(np.radians(degrees), axis))
    return mesh


def move(mesh: trimesh.Trimesh, x: float, y: float, z: float) -> trimesh.Trimesh:
    """Shift a mesh [mm] and return it."""
    mesh.apply_translation([x, y, z])
    return mesh


def make_base() -> Parts:
    """Make the column with its connector block, and the mounting ring."""
    column = revolve([(LARGE, 9.0), (LARGE, 155.0 - SEAM)], COUNT)
    ring = revolve([(63.0, 0.0), (63.0, 9.0), (62.0, 10.0)], COUNT)
    curve = superellipse(27.5, 17.0, 12.0, 20)
    block = loft([np.column_stack([np.full(20, x), curve[:, 0], curve[:, 1] + 26.5]) for x in (-50.5, -35.0)])
    return {"base_column": column, "base_ring": ring, "base_block": block}


def make_shoulder() -> Parts:
    """Make link 1, from joint 1 to the drum of joint 2, and link 2, a plate with an elbow up to joint 3."""
    low, face = -112.0 + SEAM, 75.5 - SEAM
    back = [(-47.5, low), (-47.5, -91.0), (-49.5, -60.0), (-53.5, -24.0), (-56.0, 6.0), (-53.0, 26.0), (-43.0, 40.0),
            (-26.0, 47.0), (4.0, LARGE), (face, LARGE)]
    front = [(47.5, low), (47.5, -91.0), (41.0, -78.0), (30.0, -63.0), (22.5, -53.0), (20.5, -49.5), (21.5, -48.0),
             (24.0, -47.5), (28.0, -LARGE), (face, -LARGE)]
    link1 = bend(np.column_stack([back, front, np.full(len(back), LARGE), np.zeros(len(back))]))
    start = [(100.0, 61.0, 100.0, 156.0, LARGE)]
    middle = corner((-MIDDLE, 61.0), (MIDDLE, 156.0), (28.0, 3.0), (LARGE, MIDDLE))
    end = [(-MIDDLE, 192.0 - SEAM, MIDDLE, 192.0 - SEAM, MIDDLE)]
    rows = np.concatenate([start, middle, end])
    link2 = bend(np.column_stack([rows, np.zeros(len(rows))]))
    plate = make_plate((0.0, 108.5), LARGE, 75.5 + SEAM, 119.0, 24.0)
    return {"link1": link1, "link2": link2, "link2_plate": plate}


def make_elbow() -> Parts:
    """Make link 3, which bends sideways and forward to joint 4, and link 4, a plate with an elbow down to joint 5."""
    low, face = -101.0 + SEAM, -67.5 + SEAM
    rows = [(42.4, low, -42.4, low, 42.4, 0.0), (42.4, -83.0, -42.4, -83.0, 42.4, 0.0),
            (47.0, -62.0, -37.0, -68.0, 42.4, 3.0), (55.0, -38.0, -26.0, -57.0, 42.4, 13.0),
            (64.0, -10.0, -14.0, -49.0, 42.4, 29.0), (68.5, 12.0, -8.0, -45.0, 42.4, 42.0),
            (66.0, 28.0, -6.0, -43.0, 42.4, 49.0), (54.0, 39.0, -8.0, -42.4, 42.4, 52.0),
            (30.0, 42.4, -12.0, -42.4, 42.4, 52.5), (face, 42.4, face, -42.4, 42.4, 52.5)]
    start = [(-90.0, -41.5, -90.0, -126.5, MIDDLE)]
    middle = corner((MIDDLE, -41.5), (-MIDDLE, -126.5), (34.0, 2.0), (MIDDLE, MIDDLE))
    end = [(MIDDLE, -169.5 + SEAM, -MIDDLE, -169.5 + SEAM, MIDDLE)]
    table = np.concatenate([start, middle, end])
    link4 = bend(np.column_stack([table, np.full(len(table), 77.5)]))
    plate = make_plate((77.5, -84.0), MIDDLE, -67.5 - SEAM, -107.0, 22.0)
    return {"link3": bend(rows), "link4": link4, "link4_plate": plate}


def make_forearm() -> Parts:
    """Make link 5: a collar at joint 5, a thin arm at the side and the drum of joint 6."""
    high, face = 173.0 - SEAM, -4.3 - SEAM
    back = [(-42.4, high), (-42.4, 149.0), (-47.0, 131.0), (-59.0, 110.0), (-72.0, 88.0), (-81.5, 62.0), (-86.0, 30.0),
            (-86.0, -6.0), (-80.0, -23.0), (-68.0, -34.0), (-50.0, -SMALL), (face, -SMALL)]
    front = [(42.4, high), (42.4, 149.0), (33.0, 133.0), (-2.0, 119.5), (-31.0, 102.0), (-49.0, 78.0), (-58.0, 52.0),
             (-58.5, 40.0), (-57.0, 38.0), (-54.0, SMALL), (-46.0, SMALL), (face, SMALL)]
    width = [42.4, 42.4, 41.0, 38.5, *8 * [SMALL]]
    return {"link5": bend(np.column_stack([back, front, width, np.zeros(len(width))]))}


def make_wrist() -> Parts:
    """Make link 6 (drum about joint 6, neck, hub about joint 7, cap with a hexagon) and link 7 (tool flange)."""
    face = -4.3 + SEAM
    drum = turn(make_drum(SMALL, face, 53.0, 16.0), -90.0)  # z of the drum becomes y
    hub = move(make_drum(SMALL, -69.0 + SEAM, 35.5, 12.0), 76.0, 0.0, 0.0)
    rings = []
    for x, low, high, half in ((4.0, face, 51.0, 36.0), (26.0, face, 48.0, 34.0), (60.0, -10.0, 40.0, 32.0)):
        curve = superellipse((high - low) / 2.0, half, 3.5, COUNT)
        rings.append(np.column_stack([np.full(COUNT, x), (low + high) / 2.0 + curve[:, 0], curve[:, 1]]))
    cap = turn(make_drum(20.5, 50.0, 56.0, 2.5, 20), -90.0)
    hexagon = turn(revolve([(15.0, 53.0), (15.0, 56.6), (13.5, 57.0)], 6), -90.0)
    flange = revolve([(SMALL, 28.0 - SEAM), (SMALL, 1.0), (36.4, 0.0), (21.0, 0.0), (20.0, 2.5)], COUNT)
    plug = turn(revolve([(9.0, 34.0), (9.0, 41.0), (6.5, 41.0), (6.5, 51.0)], 12), -90.0)
    return {"link6_drum": drum, "link6_neck": loft(rings), "link6_hub": hub, "link6_cap": cap,
            "link6_hexagon": hexagon, "link7": flange, "link7_plug": move(plug, 0.0, 0.0, 15.0)}


def main() -> None:
    """Write every mesh of the arm and print the total size."""
    parts = make_base() | make_shoulder() | make_elbow() | make_forearm() | make_wrist()
    for name, mesh in parts.items():  # drawn in mm, in the zero posture
        turn(mesh, TURN[name.split("_")[0]]).apply_scale(1e-3)
    print(f"{write_solids(parts, FOLDER / 'assets') / 1e3:.0f} kB of meshes")


if __name__ == "__main__":
    main()
