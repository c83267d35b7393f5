"""Round plates pressed into loose sand."""

import math
from dataclasses import replace

import numpy as np

import mpm
from robosim.studies.verification.cases.beds import UPRIGHT, carry, courant_step, resting_body
from robosim.studies.verification.cases.case import Comparison, Record, TimedSolver, case, grid
from robosim.studies.verification.cases.expectations import Ratio, Within, each_within
from robosim.studies.verification.cases.forces.plate_bed import PLATE_FRICTION, E, G, make_sand
from robosim.studies.verification.cases.references import read_reference, stated

DIAMETERS, CELLS = (0.06, 0.08, 0.1), (0.01, 0.0075, 0.005)
DEPTHS = (0.01, 0.02)
"""Depths [m] at which every plate was measured."""
DEEPEST, WINDOW, SPEED = 0.032, 1e-2, 0.1
"""Depth to which a plate is pressed [m]; time over which forces are averaged [s];
speed [m/s]."""
REPOSE_DEG = read_reference("round_plates")["repose_deg"]
ROOM = 2.0
"""Half width and depth of the bed, in diameters of the plate."""


def measured_force(diameter: float) -> dict[float, float]:
    """Return the measured mean force [N] at depths [m] of a plate of a diameter [m]."""
    return {depth: mean for size, depth, mean, *_ in read_reference("round_plates")["rows"] if size == diameter}


def compare(records: list[Record]) -> list[Comparison]:
    """Return force over depth by diameter, beside that measured."""
    reference, measured = read_reference("round_plates"), {}
    for record in records:
        label = f"{1e3 * float(record.choices['diameter'] or 0):g} mm, {record.label('cell', 'friction_deg')}"
        measured[label] = record.curve("force", label)
    published = {f"{1e3 * d:g} mm, measured": [(z, force, "") for z, force in measured_force(d).items()]
                 for d in DIAMETERS}
    return [Comparison(title="round plates", x="depth [m]", y="force [N]", measured=measured, published=published,
                       uncertainty=reference["uncertainty"], is_relative=True, is_joined=True)]


@case(
    source=stated("round_plates"), sweep=[*grid(cell=CELLS, diameter=DIAMETERS), {"friction_deg": 32.0}],
    quick=grid(cell=(0.01,), diameter=(0.06, 0.1)),
    # with the angle of repose as the only number of the sand; by the plate's area alone the ratio would be 2.8
    expectations=(*each_within({f"force at {depth:g} m": 0.3 for depth in DEPTHS}, {"friction_deg": REPOSE_DEG}),
                  *(Ratio("force 0.01 m", "diameter", (0.06, 0.1), 4.3, 5.5, {"cell": c, "friction_deg": REPOSE_DEG})
                    for c in CELLS),
                  Within("depth power", 1.45, {"friction_deg": REPOSE_DEG}, 1.16)),
    main_error="force at 0.02 m", resolution="cell", compare=compare)
def round_plate(*, diameter: float = 0.08, cell: float = 0.005, friction_deg: float = REPOSE_DEG, stiffness: float = E,
                precision: str = "f32") -> Record:
    """Round plate pressed into loose sand; a quarter of it is computed.

    Measured: relative error of the force at depths of 10 and 20 mm, the ratio of the forces on two plates at the same
    depth, and the power of the depth in the force from 5 mm to the deepest. Reference: tests with plates of 60, 80 and
    100 mm in sand with an angle of repose of 29 deg, the only number of the sand that the case takes; the tests follow
    F = pi/4 rho g D^3 f(z), and single ones a power of the depth of 1.16 to 1.45. The plate is a solid cylinder, so
    that no sand flows over it. diameter: of the plate [m]."""
    sand = replace(make_sand(friction_deg, stiffness), density=read_reference("round_plates")["density"])
    side = math.ceil(ROOM * diameter / cell) * cell
    positions = mpm.sample_box((0, 0, 0), (side, side, side), cell / 2)
    plate = mpm.Collider(mpm.Sdf.cylinder(diameter / 2, DEEPEST), friction=PLATE_FRICTION,
                         pose=mpm.Pose(np.array([0.0, 0.0, side + DEEPEST]), UPRIGHT))
    solver = mpm.Solver(
        grid=mpm.Grid((0, 0, 0), (side, side, side + 4 * cell), cell), precision=precision, colliders=[plate],
        walls=mpm.Walls(lower=("roller", "roller", "friction"), upper=("slip", "slip", "slip")), gravity=(0, 0, -G),
        bodies=[resting_body(sand, positions, (cell / 2) ** 3)], dt=courant_step(0.5, cell, sand))
    timed = TimedSolver(solver)
    timed.settle(0.04)
    depths, forces = [0.0], [0.0]
    for k in carry(timed, lambda k: [0.0, 0.0, -k * WINDOW * SPEED], round(DEEPEST / SPEED / WINDOW), WINDOW):
        depths.append((k + 0.5) * WINDOW * SPEED)
        forces.append(4.0 * solver.collider_impulse(0).force[2] / WINDOW)
    found, reference = lambda depth: float(np.interp(depth, depths, forces)), measured_force(diameter)
    errors = {f"force at {depth:g} m": found(depth) / reference[depth] - 1 for depth in DEPTHS} if reference else {}
    grid_of_depths = np.linspace(0.005, 0.03, 26)
    power = np.polyfit(np.log(grid_of_depths), np.log([max(found(z), 1e-12) for z in grid_of_depths]), 1)[0]
    return timed.record(errors, **{f"force {z:g} m": found(z) for z in (0.005, 0.01, 0.015, 0.02, 0.03)},
                        **{"depth power": power})
