"""Write the visual meshes of the parallel-jaw hand: `python models/grippers/parallel_jaw/make_meshes.py`.

Lengths in m; every mesh is in the frame of its MJCF body, the pad in its own.
"""

import sys
from pathlib import Path

import numpy as np
import trimesh

ROOT = Path(__file__).resolve().parent
sys.path[:0] = map(str, ROOT.parents[1:3])  # the script also runs from a plain checkout

from curves import (  # noqa: E402
    bezier,
    compute_end_scale,
    make_stack,
    revolve,
    smoothstep,
    space_stations,
    superellipse,
    sweep,
    write_solids,
)

Parts = dict[str, trimesh.Trimesh]

COUNT = 56
"""Points of a section of the housing."""
SEAM = 0.036
"""Height [m] of the dark gap between the two covers."""
GAP = 0.0005
"""Half of that gap [m]."""
FRONT = 0.066
"""Height [m] of the front face."""
HALF_WIDTH = 0.102
"""Half width [m] of the housing along the fingers' travel."""
HALF_DEPTH = 0.0316
"""Half depth [m] of the housing."""


def make_back_cover() -> trimesh.Trimesh:
    """Make the back cover: round at the flange, then sloping shoulders up to the full width."""
    t = np.linspace(0.0, 1.0, 14)
    edge = bezier([(0.0310, 0.0055), (0.0330, 0.0110), (0.0450, 0.0110), (0.0850, 0.0250),
                   (HALF_WIDTH, 0.0285), (HALF_WIDTH, SEAM - GAP)], t)
    depth = bezier([(0.0310,), (0.0310,), (HALF_DEPTH,)], t)[:, 0]
    return make_stack(np.column_stack([edge[:, 1], depth, edge[:, 0], 2.0 + 2.4 * smoothstep(1.4 * t)]), COUNT)


def make_front_cover() -> trimesh.Trimesh:
    """Make the front cover: a rounded bar with a flat front face."""
    angle = np.linspace(0.0, np.pi / 2.0, 6)
    inset = 0.005 * (1.0 - np.cos(angle))
    rim = np.column_stack([FRONT - 0.006 + 0.006 * np.sin(angle), HALF_DEPTH - inset, HALF_WIDTH - inset,
                           np.full(6, 4.4)])
    return make_stack([(SEAM + GAP, HALF_DEPTH, HALF_WIDTH, 4.4), *rim], COUNT)


def make_housing() -> Parts:
    """Make the flange ring, the two covers, the dark core in their gap and the finger guide."""
    ring = revolve([(0.0305, 0.0), (0.0315, 0.001), (0.0315, 0.006)])
    shrunk = 0.97 * HALF_DEPTH, 0.985 * HALF_WIDTH, 4.4
    core = make_stack([(SEAM - 0.0015, *shrunk), (SEAM + 0.0015, *shrunk)], COUNT)
    guide = make_stack([(0.060, 0.0135, 0.092, 12.0), (FRONT + 0.0003, 0.0135, 0.092, 12.0)], COUNT)
    return {"ring": ring, "cover_back": make_back_cover(), "cover_front": make_front_cover(), "core": core,
            "guide": guide}


def make_finger_bar() -> trimesh.Trimesh:
    """Make the bar from the carriage's block inward and down to the tip; it widens towards the pad."""
    points = [(0.0190, 0.010), (0.0190, 0.024), (0.0170, 0.029), (0.0095, 0.032), (0.0100, 0.044), (0.0100, 0.0570)]
    fine = bezier(points, np.linspace(0.0, 1.0, 200))
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(fine, axis=0), axis=1))])
    s = space_stations(arc[-1], 0.0, 0.004, inner=12, cap=4)
    t = np.interp(s, arc, np.linspace(0.0, 1.0, 200))
    scale = compute_end_scale(s, 0.0, 0.004)
    half = bezier([(0.0060,), (0.0062,), (0.0050,), (0.0042,)], t)[:, 0] * scale
    wide = bezier([(0.0095,), (0.0095,), (0.0100,), (0.0145,), (0.0130,)], t)[:, 0] * (0.8 + 0.2 * scale)
    curves = [superellipse(w, h, 5.0, 28) for w, h in zip(wide, half, strict=True)]
    line = np.column_stack([np.zeros(len(t)), bezier(points, t)])
    return sweep(line, curves, side=(1.0, 0.0, 0.0))


def make_finger() -> Parts:
    """Make the carriage, its mounting block, the finger bar and the rubber pad of a left finger."""
    carriage = make_stack([(0.0003, 0.0110, 0.0088, 9.0), (0.0095, 0.0110, 0.0088, 9.0)], 32)
    carriage.apply_translation([0.0, 0.0088, 0.0])
    block = make_stack([(0.004, 0.0110, 0.0075, 7.0), (0.0195, 0.0110, 0.0075, 7.0), (0.021, 0.0098, 0.0063, 7.0)], 32)
    block.apply_translation([0.0, 0.0185, 0.0])
    pad = make_stack([(-0.0035, 0.0130, 0.0110, 8.0), (0.0022, 0.0130, 0.0110, 8.0), (0.0030, 0.0124, 0.0104, 8.0)], 32)
    # contact face towards the pad's -y, its height along z
    pad.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2.0, [1.0, 0.0, 0.0]))
    return {"carriage": carriage, "block": block, "finger": make_finger_bar(), "pad": pad}


def main() -> None:
    """Write every mesh of the hand and print the total size."""
    total = write_solids(make_housing() | make_finger(), ROOT / "assets")
    print(f"{total / 1e3:.0f} kB of meshes")


if __name__ == "__main__":
    main()
