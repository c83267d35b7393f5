"""Plate pushed into sand, and pulled out of it from a depth of 2.5 plates: a strip in plane strain, or a square plate.

Measured: the stress per depth that resists the withdrawal, over that of vertical intrusion. Reference: resistive force
theory, fitted to square plates in media of single grains.
"""

from robosim.verification.cases.claims import Within
from robosim.verification.cases.comparison import Comparison
from robosim.verification.cases.forces.plate_bed import FRICTION_DEG, E, push
from robosim.verification.cases.forces.plate_map import path_of, stress_per_depth
from robosim.verification.cases.forces.resistive_force import plane_alpha, read_reference
from robosim.verification.cases.record import Record, record_of_several

NAME = "plate_pull"
SOURCE = ("resistive force theory, Li, Zhang & Goldman 2013, Science 339:1408: withdrawal takes 0.20 to 0.25 of "
          "intrusion; configs/references/resistive_force_2d.yaml")
BANDS = {"least ratio": 0.1, "most ratio": 0.4}
"""Force of withdrawal over that of intrusion, at equal depth."""
SWEEP = [*({"cell": c} for c in (0.008, 0.005, 0.004)), {"cell": 0.005, "friction_deg": 25.0},
         *({"cell": c, "square": True} for c in (0.01, 0.008))]
"""Choices of the runs in a whole report."""
QUICK_SWEEP = [{"cell": 0.01}]
MAIN_ERROR, RESOLUTION = "ratio", "cell"
CLAIMS = tuple(Within("ratio", BANDS["most ratio"], {"square": s}, BANDS["least ratio"]) for s in (True, False))


def measure(*, cell: float = 0.008, square: bool = False, friction_deg: float = FRICTION_DEG, stiffness: float = E,
            precision: str = "f32") -> Record:
    """Run the case; return the ratio of withdrawal to intrusion.

    cell [m]; square: a square plate; friction_deg: whose tangent the sand carries in simple shear; stiffness [Pa].
    """
    found, costs = {}, []
    for gamma in (90.0, -90.0):
        start, way = path_of(0.0, gamma)
        pushed = push(beta_deg=0.0, gamma_deg=gamma, start_depth=start, travel=way, cell=cell, square=square,
                      friction_deg=friction_deg, stiffness=stiffness, precision=precision)
        found[gamma] = stress_per_depth(pushed).z
        costs.append(pushed.cost)
    choices = {"cell": cell, "square": square, "friction_deg": friction_deg, "stiffness": stiffness,
               "precision": precision}
    return record_of_several(costs, NAME, choices, {"ratio": -found[-90.0] / found[90.0]},
                             {"intrusion": found[90.0], "withdrawal": -found[-90.0]})


def compare(records: list[Record]) -> list[Comparison]:
    """Return the measured ratio by cell, beside that of the published tables."""
    reference = read_reference("resistive_force_2d")
    cells = sorted({float(record.choices["cell"] or 0.0) for record in records})
    measured: dict[str, list] = {}
    for record in records:
        label = f"{'square' if record.choices['square'] else 'strip'}, {record.choices['friction_deg']:g} deg"
        measured.setdefault(label, []).append((record.choices["cell"], record.errors["ratio"], label))
    published = {medium: [(cell, -plane_alpha(0.0, -90.0, medium).z / plane_alpha(0.0, 90.0, medium).z, medium)
                          for cell in cells] for medium in reference["media"]}
    return [Comparison(title="withdrawal over intrusion", x="cell [m]", y="ratio", measured=measured,
                       published=published, uncertainty=0.05, source=reference["source"])]
