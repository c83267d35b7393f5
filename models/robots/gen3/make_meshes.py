"""Write the visual meshes of the Gen3 as binary STL: `python models/robots/gen3/make_meshes.py`.

Lengths in m. The six links between base and bracelet are one shape in four sizes, a drum about one joint and a cover
with a waist that leads to a tube about the other; gen3.xml has the poses. The other meshes are in the frame of their
MJCF body.
"""

import sys
from pathlib import Path

import numpy as np
import trimesh

ROOT = Path(__file__).resolve().parent
sys.path[:0] = map(str, ROOT.parents[1:3])  # the script also runs from a plain checkout

from curves import loft, make_stack, revolve, smoothstep, superellipse, write_solids  # noqa: E402

Parts = dict[str, trimesh.Trimesh]

LARGE, SMALL, BRACELET = 0.046, 0.035, 0.0375
"""Radii of the links at joints 1 to 4, at joints 5 to 7, and of the bracelet at its end."""
SEAM = 0.0008
"""Half of the dark gap at every joint."""


def make_link(length: float, head: float, tube: float, waist: float, back: float, middle: float) -> trimesh.Trimesh:
    """Make a link whose drum turns about z, from the gap at z = 0 upwards, and whose tube lies along +y.

    length: distance of the two joints; head, tube: radii of drum and tube; waist: half width between them; back: z of
    the drum's outer face; middle: z of the tube's axis.
    """
    edge = 0.25 * head
    rim = [(head - edge * (1.0 - np.cos(a)), back - edge * (1.0 - np.sin(a))) for a in np.radians([0, 30, 60, 90])]
    drum = revolve([(head, SEAM), *rim, (0.4 * head, back + 0.001)], 24)
    bent = length - 0.3 * tube
    y = np.concatenate([np.linspace(0.0, bent, 12), [length - SEAM]])
    t = np.clip(y / bent, 0.0, 1.0)
    low = 0.004 + (middle - tube - 0.004) * smoothstep((t - 0.35) / 0.65)
    high = back - 0.004 + (middle + tube - back + 0.004) * smoothstep(t)
    half = waist + (0.92 * head - waist) * (1.0 - smoothstep(t / 0.45)) + (tube - waist) * smoothstep((t - 0.4) / 0.6)
    curve = superellipse(1.0, 1.0, 2.0, 24)
    rings = np.empty((len(y), 24, 3))
    for ring, place, lower, upper, width in zip(rings, y, low, high, half, strict=True):
        ring[:, 0], ring[:, 1] = width * curve[:, 0], place
        ring[:, 2] = 0.5 * (lower + upper) + 0.5 * (upper - lower) * curve[:, 1]
    return trimesh.util.concatenate([drum, loft(rings)])


def make_arm() -> Parts:
    """Make all meshes of the arm."""
    panel = make_stack([(0.022, 0.006, 0.028, 8.0), (0.092, 0.006, 0.028, 8.0)], 16)
    panel.apply_translation([-0.0425, 0.0, 0.0])
    vision = make_stack([(-0.0605, 0.0435, 0.0235, 5.0), (-0.0585, 0.0455, 0.0255, 5.0),
                         (-0.048, 0.0455, 0.0255, 5.0), (-0.043, 0.040, 0.020, 4.0)], 24)
    vision.apply_translation([0.0, -0.0492, 0.0])
    return {
        "base": revolve([(LARGE, 0.010), (LARGE, 0.15643 - SEAM)], 32),
        "base_panel": panel,
        "shoulder": make_link(0.12838, LARGE, LARGE, 0.043, 0.0541, 0.005375),
        "half_arm": make_link(0.21038, LARGE, LARGE, 0.0366, 0.0554, 0.006375),
        "forearm": make_link(0.20843, LARGE, SMALL, 0.0308, 0.0559, 0.006375),
        "wrist": make_link(0.10593, SMALL, SMALL, 0.0322, 0.0532, 0.00017505),
        "bracelet": revolve([(0.0332, -SEAM), (0.0332, -0.011), (0.0353, -0.020), (0.0367, -0.030),
                             (BRACELET, -0.040), (BRACELET, -0.0595), (0.0365, -0.0605)], 28),
        "interface": revolve([(0.0315, -0.058), (0.0315, -0.061525), (0.016, -0.061525), (0.015, -0.059)], 24),
        "vision": vision,
    }


if __name__ == "__main__":
    print(f"{write_solids(make_arm(), ROOT / 'assets') / 1e3:.0f} kB of meshes")
