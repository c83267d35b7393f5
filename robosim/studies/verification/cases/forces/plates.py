"""Plates driven through sand in many directions, and pulled out of it, against resistive force theory."""

import math
from itertools import product

import numpy as np

from robosim.studies.verification.cases.beds import plane_strain_angle
from robosim.studies.verification.cases.case import Comparison, Record, case, make_record
from robosim.studies.verification.cases.expectations import Power, Within
from robosim.studies.verification.cases.forces import plate_bed
from robosim.studies.verification.cases.forces import resistive_force as theory
from robosim.studies.verification.cases.forces.plate_bed import SIDE, UNIT_WEIGHT, Plate, Pushed, make_sand, push
from robosim.studies.verification.cases.references import read_reference

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
DEPTH, BELOW = 2.5, {False: 3.5, True: 2.5}
"""Lengths of the plate: depth from which it is pulled, and room below it for a strip and for a square plate."""
EARLY = (0.5, 1.0)
"""Way [lengths of the plate] between which the deep ratio is taken: the wave that a plate sends off at its start has
faded, and the sand above it is undisturbed."""


def path_of(beta_deg: float, gamma_deg: float, side: float = SIDE) -> tuple[float, float]:
    """Return depth of the centre [m] at the start and length of the way [m] of a plate of length side [m].
    Downwards from where the plate's upper edge is level with the surface, sideways at a depth of 1.5 plates, upwards
    from 2.5 plates; plates of 40 mm, and others to the same depths."""
    if gamma_deg > 0:
        start = side / 2 * abs(math.sin(math.radians(beta_deg)))
        return start, (DEEP * SIDE - start) / math.sin(math.radians(gamma_deg))
    return (1.5 * SIDE, 1.5 * SIDE) if gamma_deg == 0 else (2.5 * SIDE, 2.0 * SIDE)


def stress_per_depth(pushed: Pushed) -> theory.Alpha:
    """Return the stress per depth, in units of density times gravity: a straight line through the origin."""
    counts = pushed.travels > STEADY * pushed.travels[-1]
    z, stress = pushed.depths[counts], pushed.stresses[counts]
    x, _, up = z @ stress / (z @ z) / UNIT_WEIGHT
    return theory.Alpha(-float(x), float(up))


def expected(beta_deg: float, gamma_deg: float, square: bool) -> theory.Alpha:
    """Return the reference's stress per depth, in units of that of vertical intrusion."""
    if not square:
        unit = theory.plane_alpha(0.0, 90.0).z
        return theory.Alpha(*(part / unit for part in theory.plane_alpha(beta_deg, gamma_deg)))
    r, _, z = theory.space_alpha(beta_deg, gamma_deg) / theory.space_alpha(0.0, 90.0)[2]
    return theory.Alpha(-float(r), float(z))


def rms(found: dict[tuple[int, int], theory.Alpha], scale: float, square: bool) -> float:
    """Return the rms difference from a table, over components and directions, in units of vertical intrusion."""
    differences = [np.array(alpha) / scale - expected(beta, gamma, square) for (beta, gamma), alpha in found.items()]
    return float(np.sqrt(np.mean(np.square(differences))))


def name_of(component: str, beta_deg: float, gamma_deg: float) -> str:
    """Return the name of the reading of a direction."""
    return f"alpha_{component} {beta_deg:g} {gamma_deg:g}"


def compare_map(records: list[Record]) -> list[Comparison]:
    """Return measured against published stress, both in units of vertical intrusion, for every run."""
    comparisons = []
    for square, name, what in ((False, "resistive_force_2d", "strip against the theory in a plane"),
                               (True, "resistive_force_3d", "square plate against the theory in space")):
        reference = read_reference(name)
        series = {record.label("cell", "friction_deg", "stiffness", "side"): [
            (getattr(expected(beta, gamma, square), component),
             record.readings[name_of(component, beta, gamma)] / record.readings["scale"],
             f"alpha_{component}, beta {beta}, gamma {gamma}")
            for beta, gamma in DIRECTIONS[str(record.choices["directions"])] for component in ("x", "z")]
            for record in records if record.choices["square"] == square}
        if series:
            comparisons.append(Comparison(
                title=what, x="published, in vertical intrusions", y="measured, in vertical intrusions",
                measured=series, line=((-0.5, -0.5), (1.2, 1.2)), uncertainty=reference["uncertainty"],
                source=reference["source"]))
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
                  Within("scale", 99.9, {"square": False, "friction_deg": plate_bed.FRICTION_DEG}, 40.6),
                  Within("scale", 99.9, {"square": True}, 40.6), Within("drag", 0.5, {"square": False}, 0.2),
                  *(Within("straight", 1.0, {"square": s}, 0.97) for s in (False, True)),
                  *(Power("force", "area", 0.9, 1.1, {"square": False, "directions": "down", "cell": c})
                    for c in AREA_CELLS)),
    main_error="rms", resolution="cell", compare=compare_map)
def plate_map(*, cell: float = 0.008, directions: str = "map", square: bool = False,
              friction_deg: float = plate_bed.FRICTION_DEG, stiffness: float = plate_bed.E, side: float = SIDE,
              precision: str = "f32") -> Record:
    """Plate driven through sand in many directions: a strip in plane strain, or a square plate.

    Measured: rms difference of the stress per depth from resistive force theory over the directions, except for "down"
    alone, both in units of vertical intrusion; vertical intrusion itself in units of density times gravity; the drag of
    an upright plate over it; how straight its force is in depth; and the power of the plate's area in its force, at
    equal depths. Reference: the generic table of the theory in a plane for a strip (the theory is fitted to plates in
    space), and the theory in space for a square plate. The readings hold the stress of every direction (beta, gamma).
    directions: "down", "few" or "map"; square: a square plate; side: length of the plate [m]."""
    length, half, height = (part * max(side, SIDE) for part in plate_bed.BEDS[square])
    sand, found, costs, straight = make_sand(friction_deg, stiffness), {}, [], math.nan
    for beta, gamma in DIRECTIONS[directions]:
        start, way = path_of(beta, gamma, side)
        pushed = push(sand, Plate(beta_deg=beta, gamma_deg=gamma, start_depth=start, travel=way, cell=cell,
                                  square=square, side=side, bed=(length, half, height), precision=precision))
        found[beta, gamma] = stress_per_depth(pushed)
        if (beta, gamma) == (0, 90):
            counts = pushed.depths > TOUCH * cell
            straight = np.corrcoef(pushed.depths[counts], pushed.stresses[counts, 2])[0, 1] ** 2
        costs.append(pushed.cost)
    scale, area = found[0, 90].z, side * (side if square else 1.0)
    readings = {"scale": scale, "straight": straight, "area": area, "force": scale * area, "published_scale":
                theory.space_scale(math.tan(math.radians(friction_deg))) * float(theory.space_alpha(0.0, 90.0)[2])}
    for (beta, gamma), alpha in found.items():
        readings |= {name_of("x", beta, gamma): alpha.x, name_of("z", beta, gamma): alpha.z}
    errors = {}
    if (90, 0) in found:
        readings["drag"] = found[90, 0].x / scale
        errors["rms"] = rms(found, scale, square)
    return make_record(costs, errors, **readings)


def compare_pull(records: list[Record]) -> list[Comparison]:
    """Return the measured ratio by cell, beside that of the published tables."""
    reference = read_reference("resistive_force_2d")
    cells = sorted({float(record.choices["cell"] or 0.0) for record in records})
    measured: dict[str, list] = {}
    for record in records:
        label = f"{'square' if record.choices['square'] else 'strip'}, {record.choices['friction_deg']:g} deg, " \
                f"{record.choices['law']}, {record.choices['cohesion']:g} Pa"
        measured.setdefault(label, []).append((record.choices["cell"], record.errors["ratio"], label))
    ratios = {medium: -theory.plane_alpha(0.0, -90.0, medium).z / theory.plane_alpha(0.0, 90.0, medium).z
              for medium in reference["media"]}
    published = {medium: [(cell, ratio, medium) for cell in cells] for medium, ratio in ratios.items()}
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
    main_error="ratio", resolution="cell", compare=compare_pull)
def plate_pull(*, cell: float = 0.008, square: bool = False, depth: float = DEPTH,
               friction_deg: float = plate_bed.FRICTION_DEG, law: str = plate_bed.LAWS[0],
               cohesion: float = 0.0) -> Record:
    """Plate pushed into sand, and pulled out of it: a strip in plane strain, or a square plate.

    Measured: the stress per depth that resists the withdrawal, over that of vertical intrusion, in the upper half of
    the way; and the same soon after the start of the withdrawal, at equal depths, the deep ratio. The theory is fitted
    to plates in media of single grains.

    Readings compare with limit analysis: the bound is the weight of the block above the plate whose sides lean outward
    by the friction angle, which no dry sand exceeds that dilates by less, until a heap forms on the surface. It grows
    with the depth over the plate's length; in the theory the stress per depth does not. square: a square plate; depth:
    from which it is pulled [lengths of the plate]; friction_deg, law, cohesion: of the sand, see `plate_bed.make_sand`.
    """
    sand, room = make_sand(friction_deg, law=law, cohesion=cohesion), plate_bed.BEDS[square]
    bed = (room[0] * SIDE, room[1] * SIDE, (depth + BELOW[square]) * SIDE)
    way = (depth - 0.5) * SIDE
    down, up = (push(sand, Plate(beta_deg=0.0, gamma_deg=gamma, start_depth=start, travel=way, cell=cell,
                                 square=square, bed=bed)) for gamma, start in ((90.0, 0.0), (-90.0, depth * SIDE)))
    intrusion, withdrawal = stress_per_depth(down).z, -stress_per_depth(up).z
    late = up.depths[up.travels > STEADY * way]
    bound = late @ (late * lifting_bound(late / SIDE, friction_deg, square)) / (late @ late)
    deep = [_mean_at(pushed, depth) for pushed in (down, up)]
    return make_record([down.cost, up.cost], {"ratio": withdrawal / intrusion, "deep ratio": -deep[1] / deep[0]}, **{
        "intrusion": intrusion, "withdrawal": withdrawal, "bound": bound, "deep intrusion": deep[0],
        "deep withdrawal": -deep[1],
        "deep bound": lifting_bound(np.array(depth - np.mean(EARLY)), friction_deg, square)})


def _mean_at(pushed: Pushed, depth: float) -> float:
    """Return the mean upward stress over density, gravity and depth, where a plate begins its way from a depth."""
    below = depth - pushed.depths / SIDE
    counts = (below > EARLY[0]) & (below < EARLY[1])
    return float(np.mean(pushed.stresses[counts, 2] / pushed.depths[counts])) / UNIT_WEIGHT


def lifting_bound(depth: np.ndarray, friction_deg: float, square: bool) -> np.ndarray:
    """Return the upper bound of limit analysis for a lifted plate, per density, gravity and depth.
    depth: (n,) in lengths of the plate; friction_deg: whose tangent the sand carries in simple shear, which in plane
    strain is the sine of the angle by which the sides lean. Around the corners of a square plate they are cones."""
    spread = depth * math.tan(math.radians(plane_strain_angle(friction_deg)))
    return 1.0 + 2.0 * spread + math.pi / 3.0 * spread**2 if square else 1.0 + spread
