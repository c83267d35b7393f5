"""Slot between two rough walls, filled with sand whose floor sinks slowly.

Measured: relative error of the load on the floor, and rms difference of the vertical stress over the height. Reference:
Janssen's exponential, with the ratio of horizontal to vertical stress that the sand has in this run. A slice one cell
thick is computed.
"""


import numpy as np

import mpm
from robosim.studies.verification.cases.beds import UPRIGHT, carry, courant_step, resting_body
from robosim.studies.verification.cases.case import Comparison, Record, TimedSolver, case
from robosim.studies.verification.cases.expectations import each_within

WIDTH, DENSITY, NU, E, G, PHI_DEG = 0.1, 1500.0, 0.3, 1e6, 9.81, 30.0
SPEED, WAY, WINDOW = 0.01, 0.004, 5e-3
"""Of the floor [m/s], its way [m], and time between readings [s]; the second half of the way counts."""
LAYERS = 16
"""Of equal height, over which the profile is averaged."""


def janssen(depth: np.ndarray | float, width: float, friction: float, ratio: float) -> np.ndarray:
    """Return the mean vertical stress [Pa] at depths [m] in a slot of a width [m].

    friction: coefficient of the walls; ratio: horizontal over vertical stress.
    """
    length = width / (2 * friction * ratio)
    return DENSITY * G * length * -np.expm1(-np.asarray(depth) / length)


def compare(records: list[Record]) -> list[Comparison]:
    """Return the measured vertical stress by depth beside Janssen's, for every run."""
    measured, published = {}, {}
    for record in records:
        label = record.label("cells", "wall_friction", "slenderness")
        depths = [float(name.rpartition(" ")[2]) for name in record.readings if name.startswith("stress at ")]
        measured[label] = [(d, record.readings[f"stress at {d:.4f}"], label) for d in depths]
        friction = float(record.choices["wall_friction"] or 0.0)
        curve = janssen(np.array(depths), WIDTH, friction, record.readings["ratio"])
        published[f"Janssen, {label}"] = [(d, float(s), label) for d, s in zip(depths, curve)]
    return [Comparison(title="vertical stress in a slot", x="depth [m]", y="stress [Pa]", measured=measured,
                       published=published, uncertainty=0.10, is_relative=True)]


@case(
    source="Janssen 1895, Z. Ver. dt. Ing. 39:1045, for a slot: sigma = rho g W / (2 mu K) (1 - exp(-2 mu K z / W))",
    sweep=[*({"cells": n} for n in (10, 20)), {"cells": 20, "wall_friction": 0.2}, {"cells": 20, "slenderness": 2.0}],
    quick=[{"cells": 10}],
    # rms of the stress in its largest value; what load, walls and weight leave over, in weights
    expectations=each_within({"load": 0.08, "profile": 0.10, "balance": 0.005}),
    main_error="load", resolution="cells", compare=compare)
def measure(*, cells: int = 20, slenderness: float = 3.0, wall_friction: float = 0.3, phi_deg: float = PHI_DEG,
            stiffness: float = E, precision: str = "f32") -> Record:
    """Run the case; return the errors of load, profile and balance.

    cells: over the width; slenderness: height of the fill over the width; phi_deg: friction angle in plane strain;
    stiffness: Young's modulus [Pa].
    """
    cell, height = WIDTH / cells, slenderness * WIDTH
    sand = mpm.DruckerPrager(E=stiffness, nu=NU, density=DENSITY, friction_angle_deg=phi_deg, cone="plane_strain")
    base = 8 * cell
    positions = mpm.sample_box((0, 0, base), (WIDTH, cell, base + height), cell / 2)
    volume = WIDTH * cell * height / len(positions)
    half = np.array([WIDTH, 4 * cell, 4 * cell])
    start = mpm.Pose(np.array([WIDTH / 2, cell / 2, base - half[2]]), UPRIGHT)
    solver = mpm.Solver(
        grid=mpm.Grid((0, 0, 0), (WIDTH, cell, base + height + 4 * cell), cell), precision=precision,
        colliders=[mpm.Collider(mpm.Sdf.box(tuple(half)), friction=0.0, pose=start)], contact="touching",
        walls=mpm.Walls(friction=wall_friction, lower=("friction", "periodic", "slip"),
                        upper=("friction", "periodic", "slip")),
        bodies=[resting_body(sand, positions, volume)], gravity=(0, 0, -G), dt=courant_step(0.5, cell, sand))
    timed = TimedSolver(solver)
    timed.settle(0.2)
    weight, windows = DENSITY * G * WIDTH * height * cell, round(WAY / SPEED / WINDOW)
    loads, walls, normals = [], [], []
    for _ in carry(timed, lambda k: [0, 0, -(k / windows * WAY)], windows, WINDOW):
        sides = [solver.wall_impulse(side).force / WINDOW for side in ("x-", "x+")]
        loads.append(-solver.collider_impulse(0).force[2] / WINDOW)
        walls.append(-sum(side[2] for side in sides))
        normals.append(sides[1][0] - sides[0][0])
    load, friction, normal = (float(np.mean(values[windows // 2:])) for values in (loads, walls, normals))
    depth, vertical, ratio = stress_profile(solver, height)
    predicted = janssen(depth, WIDTH, wall_friction, ratio)
    expected = float(janssen(height, WIDTH, wall_friction, ratio)) * WIDTH * cell
    errors = {"load": load / expected - 1, "balance": (load + friction) / weight - 1,
              "profile": np.sqrt(np.mean((vertical - predicted) ** 2)) / predicted.max()}
    layers = {f"stress at {d:.4f}": s for d, s in zip(depth, vertical)}
    return timed.record(errors, ratio=ratio, load_share=load / weight,
                        mobilized=friction / (wall_friction * normal), **layers)


def stress_profile(solver: mpm.Solver, height: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Return depths [m] and mean vertical stresses [Pa] of LAYERS, and horizontal over vertical stress of them all."""
    z, stress = solver.positions()[:, 2], solver.stresses()
    above = np.empty(len(z))
    above[np.argsort(-z)] = np.arange(len(z)) / len(z)  # by mass: settling does not count
    layer = (above * LAYERS).astype(int)
    vertical = np.array([-stress[layer == k, 2, 2].mean() for k in range(LAYERS)])
    ratio = stress[:, 0, 0].sum() / stress[:, 2, 2].sum()
    return (np.arange(LAYERS) + 0.5) / LAYERS * height, vertical, float(ratio)
