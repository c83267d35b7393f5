"""Write the visual meshes of iiwa, three-finger gripper and containers: `python models/make_meshes.py`.

Lengths in m; every mesh is in the frame of its MJCF body.
"""

import sys
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

ROOT = Path(__file__).resolve().parent
sys.path[:0] = [str(ROOT), str(ROOT.parent)]  # the script also runs from a plain checkout

from curves import (  # noqa: E402
    bezier,
    compute_end_scale,
    loft,
    make_stack,
    revolve,
    smoothstep,
    space_stations,
    superellipse,
    sweep,
    write_solids,
)

from robosim.shapes.containers import make_container_shell  # noqa: E402

Array = NDArray[np.float64]
Parts = dict[str, trimesh.Trimesh]

SEAM = 0.0015
"""Half of the dark gap [m] at every joint of the arm."""


def revolve_about_y(profile: ArrayLike, segments: int = 40) -> trimesh.Trimesh:
    """Revolve a profile (n, 2) of (radius, y) [m] about the y axis."""
    mesh = revolve(profile, segments)
    mesh.apply_transform(trimesh.transformations.rotation_matrix(-np.pi / 2.0, [1.0, 0.0, 0.0]))
    return mesh


def make_disc_profile(radius: float, low: float, high: float, edge_low: float, edge_high: float) -> Array:
    """Make the profile (n, 2) of a disc between two heights, with rounded edges; lengths in m."""
    angle = np.linspace(0.0, np.pi / 2.0, 5)
    rise, fall = 1.0 - np.sin(angle), 1.0 - np.cos(angle)
    lower = np.stack([radius - edge_low * rise, low + edge_low * fall], axis=1)
    upper = np.stack([radius - edge_high * fall, high - edge_high * rise], axis=1)
    return np.concatenate([lower, upper])


def make_elbow(
    tube: float, height: float, head: float, bulge: float, side: int, flip: bool = False, ring: float = SEAM
) -> trimesh.Trimesh:
    """Make a link cover: a round tube about z that bends to one side and ends in a disc facing the other.

    tube: radius at z=0; height: distance to the sideways joint; head: radius of the joint's disc; bulge:
    largest y of the back; ring: y of the disc's plane (all m). side: +1 or -1, the y side to which the cover
    bends. With flip the tube is at the top (z=height) and the disc about the joint at z=0.
    """
    top, low = height + head, height - head
    # back and front of the cover as Bezier curves (y, z); a pair of points for each section
    outer = [(tube, SEAM), (tube, 0.30 * height), (0.93 * bulge, 0.45 * height),
             (bulge, height - 0.45 * head), (1.1 * bulge, height + 0.35 * head),
             (1.1 * bulge, height + 0.9 * head), (0.95 * bulge, top), (0.5 * (bulge + ring), top),
             (ring, top)]
    inner = [(-tube, SEAM), (-tube, 0.30 * height), (-tube, 0.72 * low), (-0.75 * tube, 0.86 * low),
             (-0.35 * tube, low - 0.006), (ring - 0.012, low - 0.002), (ring - 0.004, low), (ring, low)]
    t = np.linspace(0.0, 1.0, 26)
    back, front = bezier(outer, t), bezier(inner, t)
    middle, half = (back + front) / 2.0, (back - front) / 2.0
    width = tube + (head - tube) * smoothstep((t - 0.2) / 0.8)
    exponent = 2.0 + 0.5 * np.sin(np.pi * t) ** 2  # slightly square between the two round ends
    rings = np.empty((len(t), 36, 3))
    for i in range(len(t)):
        curve = superellipse(1.0, 1.0, exponent[i], 36)
        rings[i, :, 0] = width[i] * curve[:, 0]
        rings[i, :, 1:] = middle[i] + curve[:, 1:] * half[i]
    rings[:, :, 1] *= side
    if flip:
        rings[:, :, 2] = height - rings[:, :, 2]
    return loft(rings)


def make_elbow_cap(radius: float) -> trimesh.Trimesh:
    """Make the round cover plate (radius in m) on the back of an elbow; about y, convex towards +y."""
    arc = np.linspace(0.0, 1.0, 6)[::-1]
    lens = np.stack([radius * 0.96 * arc, 0.0010 + 0.0030 * (1.0 - arc**2)], axis=1)
    return revolve_about_y(np.concatenate([[(radius, -0.012), (radius, 0.0)], lens]), 36)


def make_base() -> Parts:
    """Make the base: dark foot plate and connector block, light column up to A1."""
    t = np.linspace(0.0, 1.0, 16)
    radius = bezier([(0.100, 0), (0.098, 0), (0.078, 0), (0.070, 0), (0.070, 0), (0.070, 0)], t)[:, 0]
    heights = 0.014 + t * (0.1575 - SEAM - 0.014)
    rows = np.column_stack([heights, radius, radius, 2.0 + 3.0 * (1.0 - t) ** 2])
    foot = make_stack([(0.0, 0.107, 0.107, 6.0), (0.010, 0.107, 0.107, 6.0), (0.014, 0.103, 0.103, 6.0)])
    block = make_stack([(0.0, 0.058, 0.064, 7.0), (0.066, 0.058, 0.064, 7.0), (0.074, 0.050, 0.056, 6.0)])
    block.apply_translation([-0.100, 0.0, 0.006])
    return {"link0": make_stack(rows), "link0_foot": foot, "link0_plug": block}


def make_wrist() -> Parts:
    """Make link 6 (a ball-like drum about A6 with a neck up to A7) and link 7 (hub and steel flange)."""
    drum = revolve_about_y(make_disc_profile(0.058, -0.020 + SEAM, 0.068, 0.004, 0.036))
    t = np.linspace(0.0, 1.0, 12)
    blend = smoothstep(t)
    heights = 0.02 + t * (0.061 - SEAM)
    neck = make_stack(np.column_stack([heights, 0.0545 - 0.0065 * blend, 0.042 + 0.006 * blend, 2.6 - 0.6 * t]))
    hub = revolve(make_disc_profile(0.048, SEAM, 0.034, 0.001, 0.006))
    flange = revolve([(0.040, 0.030), (0.040, 0.0435), (0.0385, 0.045), (0.0170, 0.045), (0.0160, 0.042),
                      (0.0, 0.042)])
    return {"link6": drum, "link6_neck": neck, "link7": hub, "link7_flange": flange}


def make_arm() -> Parts:
    """Make all covers of the arm; the MJCF has the poses of the caps."""
    parts = make_base() | make_wrist()
    parts["link1"] = make_elbow(0.070, 0.2025, 0.072, 0.094, -1)
    parts["link2"] = make_elbow(0.068, 0.2045, 0.072, 0.094, 1, flip=True)
    parts["link3"] = make_elbow(0.068, 0.2155, 0.066, 0.088, 1)
    parts["link4"] = make_elbow(0.062, 0.1845, 0.066, 0.088, -1, flip=True)
    parts["link5"] = make_elbow(0.062, 0.2155, 0.056, 0.075, -1, ring=0.020 + SEAM)
    parts["cap_large"], parts["cap_small"] = make_elbow_cap(0.042), make_elbow_cap(0.034)
    return parts


def make_bar(points: ArrayLike, thickness: ArrayLike, width: float, start: float, end: float) -> trimesh.Trimesh:
    """Make a rounded finger bar in the x-y plane of a phalanx.

    points (m, 2) is a Bezier curve of its axis, thickness (m,) the half thicknesses along it, width the half
    width along z, start and end the lengths over which its ends are rounded (all m).
    """
    fine = bezier(points, np.linspace(0.0, 1.0, 200))
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(fine, axis=0), axis=1))])
    s = space_stations(arc[-1], start, end, inner=8, cap=5)
    t = np.interp(s, arc, np.linspace(0.0, 1.0, 200))
    scale = compute_end_scale(s, start, end)
    half = bezier(np.reshape(thickness, (-1, 1)), t)[:, 0] * scale
    wide = width * (0.55 + 0.45 * scale)  # the ends stay broad, like a barrel
    line = np.column_stack([bezier(points, t), np.zeros(len(t))])
    curves = [superellipse(w, h, 4.5, 28) for w, h in zip(wide, half, strict=True)]
    return sweep(line, curves, side=(0.0, 0.0, 1.0))


def make_hand() -> Parts:
    """Make palm, knuckle, the three phalanges and the finger pad."""
    body = make_stack([(0.010, 0.046, 0.046, 2.0), (0.016, 0.050, 0.052, 2.4), (0.024, 0.053, 0.058, 3.0),
                  (0.032, 0.051, 0.062, 3.6), (0.040, 0.039, 0.063, 4.0), (0.050, 0.026, 0.062, 4.0),
                  (0.058, 0.024, 0.060, 4.0), (0.062, 0.021, 0.056, 4.0)])
    disc = revolve(make_disc_profile(0.045, 0.0, 0.0105, 0.001, 0.001))
    plate = make_stack([(0.060, 0.018, 0.050, 5.0), (0.0645, 0.017, 0.049, 5.0), (0.0655, 0.015, 0.047, 5.0)])
    z_to_y = trimesh.transformations.rotation_matrix(-np.pi / 2.0, [1.0, 0.0, 0.0])
    for mesh in (body, disc, plate):  # z of the stacks becomes the palm's y
        mesh.apply_transform(z_to_y)
    parts = {"palm": body, "palm_disc": disc, "palm_plate": plate}
    parts["knuckle"] = make_bar(
        [(-0.012, 0.004), (0.0, 0.002), (0.020, 0.0)], [0.015, 0.015, 0.0135], 0.0195, 0.002, 0.010)
    parts["phalanx1"] = make_bar(
        [(-0.011, 0.003), (0.020, -0.006), (0.030, -0.022), (0.058, -0.031)],
        [0.0120, 0.0135, 0.0135, 0.0115], 0.0155, 0.010, 0.010)
    parts["phalanx2"] = make_bar(
        [(-0.010, 0.0), (0.020, -0.004), (0.049, 0.0)], [0.0110, 0.0125, 0.0105], 0.0150, 0.009, 0.009)
    parts["phalanx3"] = make_bar(
        [(-0.010, -0.004), (0.012, 0.002), (0.0355, 0.0165)], [0.0105, 0.0105, 0.0065], 0.0140, 0.009, 0.008)
    pad = make_stack([(-0.004, 0.013, 0.013, 6.0), (0.002, 0.013, 0.013, 6.0), (0.004, 0.0115, 0.0115, 6.0)], 32)
    pad.apply_transform(z_to_y)  # contact face towards the pad's own +y
    return parts | {"pad": pad}


def main() -> None:
    """Write every mesh of the models and print the total size."""
    total = write_solids(make_arm(), ROOT / "robots/iiwa14/assets")
    total += write_solids(make_hand(), ROOT / "grippers/robotiq_3f/assets")
    boxes = {"source": make_container_shell((0.16, 0.13, 0.08)), "target": make_container_shell((0.16, 0.16, 0.08)),
             "tray": make_container_shell((0.20, 0.15, 0.08))}
    total += write_solids(boxes, ROOT / "containers/assets")
    print(f"{total / 1e6:.2f} MB of meshes")


if __name__ == "__main__":
    main()
