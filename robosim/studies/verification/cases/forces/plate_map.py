"""Plate driven through sand in many directions: a strip in plane strain, or a square plate.

Measured: rms difference of the stress per depth from resistive force theory over the directions, both in units of
vertical intrusion; vertical intrusion itself in units of density times gravity; the drag of an upright plate over it;
how straight its force is in depth; and the power of the plate's area in its force, at equal depths. Reference: the
generic table of the theory in a plane for a strip (the theory is fitted to plates in space), and the theory in space
for a square plate.
The readings hold the stress of every direction (beta, gamma).
"""

import math
from itertools import product

import numpy as np

from robosim.studies.verification.cases.case import Comparison, Record, case, make_record
from robosim.studies.verification.cases.expectations import Power, Within
from robosim.studies.verification.cases.forces.plate_bed import (
    DENSITY,
    FRICTION_DEG,
    SIDE,
    SQUARE_BED,
    STRIP_BED,
    E,
    G,
    Plate,
    Pushed,
    make_sand,
    push,
)
from robosim.studies.verification.cases.forces.resistive_force import (
    Alpha,
    plane_alpha,
    read_reference,
    space_alpha,
    space_scale,
)

DIRECTIONS = {
    "down": ((0, 90),),
    "few": ((0, 90), (30, 90), (90, 0), (30, 45), (-30, 0)),
    "map": tuple((beta, gamma) for gamma, beta in product((90, 45, 0, -45), (0, 30, 60, 90, -30, -60))
                 if gamma < 90 or beta >= 0),
}
"""(beta, gamma) [deg]; the first is vertical intrusion. At gamma = 90, beta and -beta mirror each other."""
SIDES, AREA_CELLS = (0.02, 0.04, 0.06), (0.008, 0.005)
"""Lengths of the plate, and cells, for the power of the plate's area [m]."""
DEEP, STEADY, TOUCH = 2.0, 0.5, 3.0
"""Depth [lengths of the plate] to which it is pushed, share of its way after which the stress counts, and depth [cells]
below which the force is compared with a straight line."""


def path_of(beta_deg: float, gamma_deg: float, side: float = SIDE) -> tuple[float, float]:
    """Return depth of the centre [m] at the start and length of the way [m] of a plate of length side [m].

    Downwards from where the plate's upper edge is level with the surface, sideways at a depth of 1.5 plates, upwards
    from 2.5 plates; plates of 40 mm, and others to the same depths.
    """
    if gamma_deg > 0:
        start = side / 2 * abs(math.sin(math.radians(beta_deg)))
        return start, (DEEP * SIDE - start) / math.sin(math.radians(gamma_deg))
    return (1.5 * SIDE, 1.5 * SIDE) if gamma_deg == 0 else (2.5 * SIDE, 2.0 * SIDE)


def stress_per_depth(pushed: Pushed) -> Alpha:
    """Return the stress per depth, in units of density times gravity: a straight line through the origin."""
    counts = pushed.travels > STEADY * pushed.travels[-1]
    z, stress = pushed.depths[counts], pushed.stresses[counts]
    x, _, up = z @ stress / (z @ z) / (DENSITY * G)
    return Alpha(-float(x), float(up))


def straightness(pushed: Pushed, start: float) -> float:
    """Return R^2 of a straight line through the vertical stress in depth, below a depth [m]."""
    counts = pushed.depths > start
    return float(np.corrcoef(pushed.depths[counts], pushed.stresses[counts, 2])[0, 1] ** 2)


def expected(beta_deg: float, gamma_deg: float, square: bool, doubtful: bool = False) -> Alpha:
    """Return the reference's stress per depth, in units of that of vertical intrusion."""
    if not square:
        unit = plane_alpha(0.0, 90.0).z
        return Alpha(*(part / unit for part in plane_alpha(beta_deg, gamma_deg)))
    unit = space_alpha(0.0, 90.0, doubtful=doubtful)[2]
    r, _, z = space_alpha(beta_deg, gamma_deg, doubtful=doubtful) / unit
    return Alpha(-float(r), float(z))


def compare(records: list[Record]) -> list[Comparison]:
    """Return measured against published stress, both in units of vertical intrusion, for every run."""
    comparisons = []
    for square, name in ((False, "resistive_force_2d"), (True, "resistive_force_3d")):
        reference = read_reference(name)
        series = {}
        for record in (r for r in records if r.choices["square"] == square):
            series[record.label("cell", "friction_deg", "stiffness", "side")] = [
                (getattr(expected(direction[0], direction[1], square), component),
                 record.readings[name_of(component, *direction)] / record.readings["scale"],
                 f"alpha_{component}, beta {direction[0]}, gamma {direction[1]}")
                for direction in DIRECTIONS[str(record.choices["directions"])] for component in ("x", "z")]
        if series:
            comparisons.append(Comparison(
                title="square plate against the theory in space" if square else "strip against the theory in a plane",
                x="published, in vertical intrusions", y="measured, in vertical intrusions", measured=series,
                line=((-0.5, -0.5), (1.2, 1.2)), uncertainty=reference["uncertainty"], source=reference["source"]))
    return comparisons


@case(
    source="resistive force theory: Li, Zhang & Goldman 2013, Science 339:1408, in a plane; Agarwal, Goldman & Kamrin "
           "2023, PNAS 120:e2214017120, in space; configs/references/resistive_force_2d.yaml, resistive_force_3d.yaml",
    sweep=[{"cell": 0.008}, {"cell": 0.01, "square": True}, {"cell": 0.005}, {"cell": 0.008, "friction_deg": 25.0},
           {"cell": 0.008, "stiffness": 4e6}, {"cell": 0.004},
           *({"cell": c, "directions": "down", "side": s} for c in AREA_CELLS for s in SIDES)],
    quick=[{"cell": 0.01, "directions": "few"}],
    # rms in vertical intrusions; vertical stress over density, gravity and depth: from that of loose poppy seeds to
    # that of the theory in space for a friction coefficient of tan 30 deg; drag over vertical intrusion; R^2 of a
    # straight line through the force of vertical intrusion in depth; power of the area in that force
    expectations=(*(Within("rms", 0.20, {"square": s}) for s in (False, True)),
                  Within("scale", 99.9, {"square": False, "friction_deg": FRICTION_DEG}, 40.6),
                  Within("scale", 99.9, {"square": True}, 40.6), Within("drag", 0.5, {"square": False}, 0.2),
                  *(Within("straight", 1.0, {"square": s}, 0.97) for s in (False, True)),
                  *(Power("force", "area", 0.9, 1.1, {"square": False, "directions": "down", "cell": c})
                    for c in AREA_CELLS)),
    main_error="rms", resolution="cell", compare=compare)
def measure(*, cell: float = 0.008, directions: str = "map", square: bool = False, friction_deg: float = FRICTION_DEG,
            stiffness: float = E, side: float = SIDE, precision: str = "f32") -> Record:
    """Run the case; return the rms difference from the theory, except for the direction "down" alone.

    cell [m]; directions: "down", "few" or "map"; square: a square plate; friction_deg: whose tangent the sand carries
    in simple shear; stiffness: Young's modulus [Pa]; side: length of the plate [m].
    """
    room = [part * max(side, SIDE) for part in (SQUARE_BED if square else STRIP_BED)]
    sand, found, costs, straight = make_sand(friction_deg, stiffness), {}, [], math.nan
    for beta, gamma in DIRECTIONS[directions]:
        start, way = path_of(beta, gamma, side)
        pushed = push(sand, Plate(beta_deg=beta, gamma_deg=gamma, start_depth=start, travel=way, cell=cell,
                                  square=square, side=side, bed=(room[0], room[1], room[2]), precision=precision))
        found[beta, gamma] = stress_per_depth(pushed)
        if (beta, gamma) == (0, 90):
            straight = straightness(pushed, TOUCH * cell)
        costs.append(pushed.cost)
    scale = found[0, 90].z
    area = side * (side if square else 1.0)
    readings = {"scale": scale, "straight": straight, "area": area, "force": scale * area,
                "published_scale": space_scale(math.tan(math.radians(friction_deg)))
                * float(space_alpha(0.0, 90.0)[2])}
    for (beta, gamma), alpha in found.items():
        readings |= {name_of("x", beta, gamma): alpha.x, name_of("z", beta, gamma): alpha.z}
    errors = {}
    if (90, 0) in found:
        readings["drag"] = found[90, 0].x / scale
        errors["rms"] = rms(found, scale, square)
        readings["rms_doubtful" if square else "rms_in_space"] = rms(found, scale, True, square)
    return make_record(costs, errors, readings)


def rms(found: dict[tuple[int, int], Alpha], scale: float, square: bool, doubtful: bool = False) -> float:
    """Return the rms difference from a table, over components and directions, in units of vertical intrusion."""
    differences = [np.array(alpha) / scale - expected(beta, gamma, square, doubtful)
                   for (beta, gamma), alpha in found.items()]
    return float(np.sqrt(np.mean(np.square(differences))))


def name_of(component: str, beta_deg: float, gamma_deg: float) -> str:
    """Return the name of the reading of a direction."""
    return f"alpha_{component} {beta_deg:g} {gamma_deg:g}"
