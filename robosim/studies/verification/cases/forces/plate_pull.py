"""Plate pushed into sand, and pulled out of it: a strip in plane strain, or a square plate.

Measured: the stress per depth that resists the withdrawal, over that of vertical intrusion, in the upper half of the
way; and the same soon after the start of the withdrawal, at equal depths, the deep ratio. Reference: resistive force
theory, fitted to plates in media of single grains.

Readings compare with limit analysis: the bound is the weight of the block above the plate whose sides lean outward by
the friction angle, which no dry sand exceeds that dilates by less, until a heap forms on the surface. It grows with the
depth over the plate's length; in the theory the stress per depth does not.
"""

import math

import numpy as np

from robosim.studies.verification.cases.case import Comparison, Record, case, make_record
from robosim.studies.verification.cases.expectations import Within
from robosim.studies.verification.cases.forces.plate_bed import (
    DENSITY,
    FRICTION_DEG,
    LAWS,
    SIDE,
    SQUARE_BED,
    STRIP_BED,
    G,
    Plate,
    Pushed,
    make_sand,
    push,
)
from robosim.studies.verification.cases.forces.plate_map import STEADY, stress_per_depth
from robosim.studies.verification.cases.forces.resistive_force import plane_alpha, read_reference

DEPTH, BELOW = 2.5, {False: 3.5, True: 2.5}
"""Lengths of the plate: depth from which it is pulled, and room below it for a strip and for a square plate."""
EARLY = (0.5, 1.0)
"""Way [lengths of the plate] between which the deep ratio is taken: the wave that a plate sends off at its start has
faded, and the sand above it is undisturbed."""


def compare(records: list[Record]) -> list[Comparison]:
    """Return the measured ratio by cell, beside that of the published tables."""
    reference = read_reference("resistive_force_2d")
    cells = sorted({float(record.choices["cell"] or 0.0) for record in records})
    measured: dict[str, list] = {}
    for record in records:
        label = f"{'square' if record.choices['square'] else 'strip'}, {record.choices['friction_deg']:g} deg, "
        label += f"{record.choices['law']}, {record.choices['cohesion']:g} Pa"
        measured.setdefault(label, []).append((record.choices["cell"], record.errors["ratio"], label))
    published = {medium: [(cell, -plane_alpha(0.0, -90.0, medium).z / plane_alpha(0.0, 90.0, medium).z, medium)
                          for cell in cells] for medium in reference["media"]}
    return [Comparison(title="withdrawal over intrusion", x="cell [m]", y="ratio", measured=measured,
                       published=published, uncertainty=0.05, source=reference["source"])]


@case(
    source="resistive force theory, Li, Zhang & Goldman 2013, Science 339:1408: withdrawal takes 0.20 to 0.25 of "
           "intrusion; configs/references/resistive_force_2d.yaml",
    sweep=[*({"cell": c} for c in (0.008, 0.005, 0.004)), {"cell": 0.005, "friction_deg": 25.0},
           {"law": "dense"}, *({"cohesion": c} for c in (50.0, 200.0)),
           *({"cell": c, "square": True} for c in (0.01, 0.008)), {"cell": 0.01, "square": True, "depth": 5.0}],
    quick=[{"cell": 0.01}],
    expectations=(*(Within("ratio", 0.4, {"square": s}, 0.1) for s in (True, False)),
                  Within("deep ratio", 0.4, {"square": True, "depth": 5.0}, 0.1)),
    main_error="ratio", resolution="cell", compare=compare)
def measure(*, cell: float = 0.008, square: bool = False, depth: float = DEPTH, friction_deg: float = FRICTION_DEG,
            law: str = LAWS[0], cohesion: float = 0.0) -> Record:
    """Run the case; return the ratio of withdrawal to intrusion.

    cell [m]; square: a square plate; depth: from which it is pulled [lengths of the plate]; friction_deg, law,
    cohesion: of the sand, see `plate_bed.make_sand`.
    """
    sand = make_sand(friction_deg, law=law, cohesion=cohesion)
    room = SQUARE_BED if square else STRIP_BED
    bed = (room[0] * SIDE, room[1] * SIDE, (depth + BELOW[square]) * SIDE)
    way = (depth - 0.5) * SIDE
    down, up = (push(sand, Plate(beta_deg=0.0, gamma_deg=gamma, start_depth=start, travel=way, cell=cell,
                                 square=square, bed=bed)) for gamma, start in ((90.0, 0.0), (-90.0, depth * SIDE)))
    intrusion, withdrawal = stress_per_depth(down).z, -stress_per_depth(up).z
    late = up.depths[up.travels > STEADY * way]
    bound = float(late @ (late * lifting_bound(late / SIDE, friction_deg, square)) / (late @ late))
    deep = [_mean_at(pushed, depth) for pushed in (down, up)]
    deep_bound = float(lifting_bound(np.array(depth - np.mean(EARLY)), friction_deg, square))
    return make_record([down.cost, up.cost], {"ratio": withdrawal / intrusion, "deep ratio": -deep[1] / deep[0]},
                             {"intrusion": intrusion, "withdrawal": withdrawal, "bound": bound,
                              "deep intrusion": deep[0], "deep withdrawal": -deep[1], "deep bound": deep_bound})


def _mean_at(pushed: Pushed, depth: float) -> float:
    """Return the mean upward stress over density, gravity and depth, where a plate begins its way from a depth."""
    below = depth - pushed.depths / SIDE
    counts = (below > EARLY[0]) & (below < EARLY[1])
    return float(np.mean(pushed.stresses[counts, 2] / pushed.depths[counts])) / (DENSITY * G)


def lifting_bound(depth: np.ndarray, friction_deg: float, square: bool) -> np.ndarray:
    """Return the upper bound of limit analysis for a lifted plate, per density, gravity and depth.

    depth: (n,) in lengths of the plate; friction_deg: whose tangent the sand carries in simple shear, which in plane
    strain is the sine of the angle by which the sides lean. Around the corners of a square plate they are cones.
    """
    spread = depth * math.tan(math.asin(math.tan(math.radians(friction_deg))))
    return 1.0 + 2.0 * spread + math.pi / 3.0 * spread**2 if square else 1.0 + spread
