"""Columns of fluid whose cylinder is lifted."""

import math

import numpy as np
import trimesh

import mpm
from robosim.studies.verification.cases.beds import UPRIGHT, carry
from robosim.studies.verification.cases.case import Comparison, Record, TimedSolver, case, grid
from robosim.studies.verification.cases.expectations import Within
from robosim.studies.verification.cases.references import read_reference, stated

ROOM, STEP, UNTIL, COURANT = 0.27, 4e-3, 0.2, 0.4
"""Half width of the floor [m]; time between looks; time up to which the front is compared [s]; Courant number."""
BEYOND = 0.0025
"""Share of the mass beyond the front, so that it does not depend on the outermost particle."""


def filmed(fluid: str) -> np.ndarray:
    """Return times [s], mean radii [m] of the two cameras and half their difference: (3, n)."""
    t, first, second = np.array(read_reference("lifted_columns")[fluid]).T
    return np.array([t, 0.5 * (first + second), 0.5 * np.abs(first - second)])


def compare(records: list[Record]) -> list[Comparison]:
    """Return the front over time by fluid, beside both cameras."""
    reference, plots = read_reference("lifted_columns"), []
    for fluid in reference["fluids"]:
        measured = {record.label("cell"): record.curve("front") for record in records
                    if record.choices["fluid"] == fluid}
        if measured:
            published = {f"camera {k}": [(row[0], row[k], "") for row in reference[fluid]] for k in (1, 2)}
            plots.append(Comparison(title=f"column of {fluid}", x="time [s]", y="front [m]", measured=measured,
                                    published=published, uncertainty=reference["uncertainty"], is_relative=True,
                                    is_joined=True))
    return plots


@case(
    source=stated("lifted_columns"), sweep=[*grid(fluid=("water", "glycerol"), cell=(0.004, 0.003, 0.002)),
           *grid(fluid=("water", "glycerol"), lift_speed=(1.0,)), {"floor": "slip"}],
    quick=grid(fluid=("water", "glycerol")),
    expectations=[Within("front", 0.1, {"lift_speed": 0.5, "floor": "stick", "cell": cell}) for cell in (0.003, 0.002)],
    main_error="front", resolution="cell", compare=compare)
def lifted_column(*, fluid: str = "water", cell: float = 0.003, lift_speed: float = 0.5,
                  floor: str = "stick") -> Record:
    """Round column of water, or of glycerol at 4.6 g, whose cylinder is lifted; a quarter of it is computed.

    Measured: the largest relative error of the front's radius up to 0.2 s. Reference: films by two cameras, of which
    the mean counts; the clock begins where the front is as far as at the film's begin. fluid: "water" or "glycerol";
    lift_speed: of the cylinder [m/s], which the source does not give: one number for both fluids; floor:
    "stick", or "slip" without friction. A layer of water along the floor is thinner than a cell, and so too thick."""
    reference = read_reference("lifted_columns")
    numbers, radius, height = reference["fluids"][fluid], reference["radius"], reference["height"]
    gravity = numbers["gravity"]
    sound = 10.0 * math.sqrt(2.0 * gravity * height)
    law = mpm.NewtonianFluid(bulk_modulus=numbers["density"] * sound**2, density=numbers["density"],
                             viscosity=numbers["viscosity"])
    side = math.ceil(ROOM / cell) * cell
    places = mpm.sample_box((0, 0, 0), (radius, radius, height), cell / 2)
    places = places[np.hypot(places[:, 0], places[:, 1]) < radius]
    tube = trimesh.creation.annulus(radius, radius + 2.5 * cell, height + 2 * cell)
    wall = mpm.Collider(mpm.Sdf.from_mesh(tube, spacing=cell / 3, margin=2 * cell), friction=0.0,
                        pose=mpm.Pose(np.array([0.0, 0.0, height / 2 + cell]), UPRIGHT))
    solver = mpm.Solver(
        grid=mpm.Grid((0, 0, 0), (side, side, math.ceil(1.3 * height / cell) * cell), cell), precision="f32",
        walls=mpm.Walls(lower=("roller", "roller", floor), upper=("slip", "slip", "slip")),
        bodies=[mpm.Body(law, places, volume=math.pi / 4 * radius**2 * height / len(places))],
        colliders=[wall], gravity=(0, 0, -gravity), dt=COURANT * cell / sound)
    timed, times, fronts = TimedSolver(solver), [0.0], [radius]
    film = filmed(fluid)
    timed.settle(0.05)
    begin = solver.time
    for _ in carry(timed, lambda k: [0.0, 0.0, k * STEP * lift_speed], round((UNTIL + 0.1) / STEP), STEP):
        times.append(solver.time - begin)
        fronts.append(float(np.quantile(np.hypot(*solver.positions()[:, :2].T), 1.0 - BEYOND)))
    late = film[0] <= UNTIL
    clock = np.array(times) - np.interp(film[1, 0], fronts, times)
    found = np.interp(film[0], clock, fronts)
    error = found[late] / film[1, late] - 1
    return timed.record({"front": error[np.argmax(np.abs(error))]},
                        **{f"front {t:g} s": r for t, r in zip(film[0], found)})
