"""Write the visual meshes of the Panda as binary STL: `python models/robots/panda/make_meshes.py`.

Lengths in m; every mesh is in the frame of its MJCF body. Links 1 and 2 share the cover `shoulder`, links 3 and 4
the four parts `elbow_*`; the MJCF turns them into the frames of links 2 and 4. Main dimensions (radii, lengths) are
measured on the maker's published description; the shapes are our own curves.
"""

import sys
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

ROOT = Path(__file__).resolve().parent
sys.path[:0] = map(str, ROOT.parents[1:3])  # the script also runs from a plain checkout

from curves import bezier, compute_end_scale, loft, revolve, superellipse, sweep, write_solids  # noqa: E402

Array = NDArray[np.float64]
Parts = dict[str, trimesh.Trimesh]

SEAM = 0.0015
"""Half of the dark gap [m] at every joint."""
TUBE = 0.055
"""Radius [m] of the tubes and of the drums about joints 2 and 4."""
ELBOW = 0.0825
"""Offset a4 [m] of the elbow axis."""
SEGMENTS = 22
"""Points of a section."""


def interpolate(points: ArrayLike, t: ArrayLike) -> Array:
    """Evaluate the Catmull-Rom spline through points (m, d) at t (k,) in 0..1; returns (k, d)."""
    knots = np.asarray(points, float)
    padded = np.concatenate([[2.0 * knots[0] - knots[1]], knots, [2.0 * knots[-1] - knots[-2]]])
    s = np.clip(np.asarray(t, float), 0.0, 1.0) * (len(knots) - 1)
    i = np.minimum(s.astype(int), len(knots) - 2)
    u = (s - i)[:, None]
    p0, p1, p2, p3 = (padded[i + j] for j in range(4))
    return p1 + 0.5 * u * (p2 - p0 + u * (2.0 * p0 - 5.0 * p1 + 4.0 * p2 - p3 + u * (3.0 * (p1 - p2) + p3 - p0)))


def turn(mesh: trimesh.Trimesh, angle: float, axis: ArrayLike) -> trimesh.Trimesh:
    """Rotate a mesh about an axis (3,) through the origin by an angle in rad, in place; returns the mesh."""
    mesh.apply_transform(trimesh.transformations.rotation_matrix(angle, axis))
    return mesh


def revolve_about_y(profile: ArrayLike, segments: int = SEGMENTS) -> trimesh.Trimesh:
    """Revolve a profile (n, 2) of (radius, y) [m] about the y axis."""
    return turn(revolve(profile, segments), -np.pi / 2.0, [1.0, 0.0, 0.0])


def make_stack(rows: ArrayLike, count: int = SEGMENTS, tilt: float = 0.0) -> trimesh.Trimesh:
    """Make a loft along z of sections given as rows (k, 6): z, low x, high x, low y, high y in m, exponent.

    tilt lowers the last three sections towards +x by this slope.
    """
    rings = []
    table = np.asarray(rows, float)
    for i, (z, x0, x1, y0, y1, exponent) in enumerate(table):
        curve = superellipse((x1 - x0) / 2.0, (y1 - y0) / 2.0, exponent, count)
        height = z - tilt * curve[:, 0] * (i >= len(table) - 3)
        rings.append(np.column_stack([curve[:, 0] + (x0 + x1) / 2.0, curve[:, 1] + (y0 + y1) / 2.0, height]))
    return loft(rings)


def make_shoulder() -> trimesh.Trimesh:
    """Make the cover of link 1: a tube about z that bends towards -y into the drum about joint 2 at z=0."""
    low = -0.192 + SEAM
    outer = [(-TUBE, low), (-0.0565, -0.140), (-0.066, -0.103), (-0.091, -0.070), (-0.118, -0.036),
             (-0.129, -0.002), (-0.123, 0.028), (-0.105, 0.047), (-0.075, 0.0545), (-0.035, TUBE), (-SEAM, TUBE)]
    inner = [(TUBE, low), (TUBE, -0.145), (0.053, -0.112), (0.041, -0.094), (0.022, -0.084), (0.008, -0.075),
             (0.001, -0.067), (-0.001, -0.062), (-SEAM, -0.059), (-SEAM, -0.056), (-SEAM, -TUBE)]
    t = np.linspace(0.0, 1.0, 16)
    back, front = interpolate(outer, t), interpolate(inner, t)
    rings = np.empty((len(t), SEGMENTS, 3))
    for i, (middle, half) in enumerate(zip((back + front) / 2.0, (back - front) / 2.0, strict=True)):
        curve = superellipse(TUBE, 1.0, 2.0 + 0.5 * np.sin(np.pi * t[i]) ** 2, SEGMENTS)
        rings[i, :, 0] = curve[:, 0]
        rings[i, :, 1:] = middle + curve[:, 1:] * half
    return loft(rings)


def make_elbow() -> Parts:
    """Make the parts of link 3: neck from joint 3 to the elbow, sleeve, dark ring and end cap of its drum."""
    t = np.linspace(0.0, 1.0, 8)
    line = bezier([(0.0, 0.0, -0.124 + SEAM), (0.0, 0.0, -0.09), (-0.002, 0.0, -0.045), (0.028, 0.016, -0.028),
                   (0.064, 0.026, -0.012)], t)
    half = bezier([(0.055, 0.055), (0.055, 0.055), (0.056, 0.058), (0.045, 0.046), (0.026, 0.038)], t)
    parts = {"neck": sweep(line, half, side=(0.0, 1.0, 0.0), segments=SEGMENTS)}
    parts["sleeve"] = revolve_about_y([(0.053, SEAM), (TUBE, 0.003), (TUBE, 0.056)])
    parts["ring"] = revolve_about_y([(0.0550, 0.054), (0.0575, 0.058), (0.0575, 0.080), (0.0550, 0.092),
                                     (0.0490, 0.101), (0.0400, 0.105)])
    parts["cap"] = revolve_about_y([(0.0400, 0.100), (0.0395, 0.1055), (0.030, 0.1097), (0.0, 0.1115)])
    for name in ("sleeve", "ring", "cap"):
        parts[name].apply_translation([ELBOW, 0.0, 0.0])
    return {f"elbow_{name}": mesh for name, mesh in parts.items()}


def make_base() -> Parts:
    """Make the base: foot plate, column up to joint 1 and the sloping housing of the connectors behind it."""
    foot = make_stack([(0.0, -0.154, 0.071, -0.094, 0.094, 5.0), (0.008, -0.154, 0.071, -0.094, 0.094, 5.0),
                       (0.011, -0.151, 0.068, -0.091, 0.091, 5.0)])
    front = foot.vertices[:, 0] > 0.0  # the plate is narrower in front of the column
    foot.vertices[front, 1] *= 1.0 - 3.2 * foot.vertices[front, 0]
    column = revolve([(0.071, 0.006), (0.066, 0.024), (0.060, 0.060), (0.0555, 0.105), (TUBE, 0.141 - SEAM)], SEGMENTS)
    housing = make_stack([(0.006, -0.137, 0.02, -0.078, 0.078, 5.0), (0.060, -0.127, 0.02, -0.076, 0.076, 4.8),
                          (0.088, -0.102, 0.02, -0.069, 0.069, 4.0), (0.108, -0.078, 0.02, -0.057, 0.057, 3.0),
                          (0.125, -0.054, 0.02, -0.046, 0.046, 2.5)])
    return {"base_foot": foot, "base_column": column, "base_housing": housing}


def make_forearm() -> Parts:
    """Make link 5: bulb, slender arm on the +y side, drum about joint 6, dark back cover and its light inlay."""
    low = -0.260 + SEAM
    arm = make_stack([(low, -0.055, 0.055, -0.055, 0.055, 2.0), (-0.235, -0.055, 0.055, -0.055, 0.060, 2.0),
                      (-0.212, -0.053, 0.053, -0.053, 0.074, 2.0), (-0.194, -0.050, 0.050, -0.047, 0.083, 2.1),
                      (-0.178, -0.045, 0.045, -0.033, 0.088, 2.2), (-0.164, -0.040, 0.040, -0.010, 0.092, 2.3),
                      (-0.150, -0.035, 0.035, 0.024, 0.096, 2.5), (-0.134, -0.032, 0.032, 0.052, 0.100, 2.8),
                      (-0.112, -0.030, 0.030, 0.064, 0.104, 3.0), (-0.075, -0.030, 0.030, 0.070, 0.110, 3.0),
                      (-0.050, -0.035, 0.035, 0.064, 0.115, 3.0), (-0.028, -0.042, 0.042, 0.045, 0.120, 3.0)])
    drum = revolve_about_y([(0.048, 0.016 + SEAM), (0.050, 0.020), (0.050, 0.100)])
    # the outer face of the arm rises towards the drum; both covers follow it
    table = np.array([(-0.212, 0.016, 0.078), (-0.205, 0.025, 0.083), (-0.175, 0.036, 0.093), (-0.135, 0.0325, 0.103),
                      (-0.075, 0.0325, 0.113), (-0.045, 0.040, 0.120), (-0.020, 0.0495, 0.127), (0.000, 0.0515, 0.129),
                      (0.022, 0.0485, 0.129), (0.040, 0.037, 0.128), (0.050, 0.018, 0.126)])
    z, half, face = table.T
    cover = make_stack(np.column_stack([z, -half, half, face - 0.030, face, np.full(len(z), 4.0)]), 16)
    rows = np.linspace(-0.196, 0.042, 10)
    width = 0.66 * np.interp(rows, z, half) * np.maximum(compute_end_scale(rows, 0.016, 0.018), 0.6)
    top = np.interp(rows, z, face) + 0.002
    inlay = make_stack(np.column_stack([rows, -width, width, top - 0.008, top, np.full(len(rows), 4.0)]), 12)
    return {"forearm_arm": arm, "forearm_drum": drum, "forearm_cover": cover, "forearm_inlay": inlay}


def make_wrist() -> Parts:
    """Make link 6: drum and dark pilot ring about joint 6, neck, head about joint 7 and its dark display disc."""
    drum = revolve([(0.046, -0.016 + SEAM), (0.048, -0.012), (0.048, 0.032)], SEGMENTS)
    ring = make_stack([(0.026, -0.047, 0.062, -0.045, 0.045, 2.4), (0.046, -0.047, 0.064, -0.045, 0.045, 2.4),
                       (0.053, -0.043, 0.060, -0.041, 0.041, 2.4), (0.056, -0.036, 0.053, -0.034, 0.034, 2.4)])
    neck = make_stack([(0.000, -0.047, 0.014, -0.046, 0.048, 2.6), (0.022, -0.047, 0.016, -0.044, 0.055, 2.6),
                       (0.044, -0.046, 0.026, -0.045, 0.068, 2.6), (0.066, -0.040, 0.038, -0.046, 0.072, 2.6),
                       (0.088, -0.038, 0.038, -0.046, 0.070, 2.6)])
    turn(neck, np.pi / 2.0, [0.0, 1.0, 0.0])  # z of the stack becomes x, its x becomes -z
    side = [(-0.051 + SEAM, 0.0435), (-0.046, 0.044), (0.015, 0.044), (0.048, 0.042), (0.062, 0.0395), (0.071, 0.034)]
    disc = [(0.066, 0.034), (0.0755, 0.033), (0.078, 0.029)]
    head, display = (make_stack([(y, -r, r, -r, r, 2.0) for y, r in rows], tilt=0.14) for rows in (side, disc))
    for mesh in (head, display):
        turn(mesh, -np.pi / 2.0, [1.0, 0.0, 0.0])  # z of the stack becomes y
        mesh.apply_translation([0.088, 0.0, 0.0])
    return {"wrist_drum": drum, "wrist_ring": ring, "wrist_neck": neck, "wrist_head": head,
            "wrist_display": display}


def make_hub() -> Parts:
    """Make link 7: round hub, guiding grip along +x (the MJCF turns it by 45 deg) and steel flange."""
    hub = revolve([(0.043, 0.051 + SEAM), (0.044, 0.056), (0.044, 0.093), (0.042, 0.0975), (0.036, 0.098)], SEGMENTS)
    t = np.linspace(0.0, 1.0, 8)
    line = np.column_stack([0.020 + 0.095 * t, np.zeros(len(t)), 0.080 + 0.006 * t])
    half = interpolate([(0.036, 0.016), (0.036, 0.0155), (0.034, 0.015), (0.029, 0.0135), (0.023, 0.012),
                        (0.008, 0.006)], t)
    curves = [superellipse(a, b, 3.0, 16) for a, b in half]
    grip = sweep(line, curves, side=(0.0, 1.0, 0.0))
    flange = revolve([(0.0315, 0.096), (0.0315, 0.106), (0.0305, 0.107)], SEGMENTS)
    return {"hub": hub, "hub_grip": grip, "hub_flange": flange}


def main() -> None:
    """Write every mesh of the arm and print the total size."""
    parts = make_base() | {"shoulder": make_shoulder()} | make_elbow() | make_forearm() | make_wrist() | make_hub()
    total = write_solids(parts, ROOT / "assets")
    print(f"{total / 1e3:.0f} kB in {len(parts)} meshes")


if __name__ == "__main__":
    main()
