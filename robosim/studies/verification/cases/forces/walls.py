"""Forces of sand on a blade, on a retaining wall, and on the floor of a slot."""

import math

import numpy as np

import mpm
from robosim.studies.verification.cases.beds import (
    SLICE,
    UPRIGHT,
    carry,
    courant_step,
    plane_strain_angle,
    resting_body,
    set_up,
)
from robosim.studies.verification.cases.case import Comparison, Record, case, grid, make_record
from robosim.studies.verification.cases.expectations import Power, Ratio, Within, each_within
from robosim.studies.verification.cases.forces.plate_bed import DENSITY, FRICTION_DEG, NU, E, G, Plate, make_sand, push

BEGIN, END = 0.15, 0.30
"""Way of the blade [depths] over which the force is averaged: one that starts at once sends off a wave of some 2 kPa,
density times both speeds, which has to fade."""
HEIGHT, LENGTH, PHI_DEG = 0.2, 0.6, 30.0
"""Of the sand at the wall [m]; friction angle in plane strain."""
WALL_WINDOW = 2e-3
"""Time between readings [s]; FLOOR_WINDOW likewise."""
MOTIONS = {"active": (-0.02, 0.01, 0.3), "passive": (0.05, 0.05, 0.5)}
"""Way of the wall [heights], positive into the sand; its speed [m/s]; share of the way after which the force counts."""
WIDTH, SPEED, WAY, FLOOR_WINDOW = 0.1, 0.01, 0.004, 5e-3
"""Of the slot [m]; speed [m/s] and way [m] of its floor; the second half of the way counts."""
LAYERS = 16
"""Of equal height, over which the profile is averaged."""


def rankine(phi_deg: float, passive: bool) -> float:
    """Return the horizontal stress on a smooth vertical wall over the vertical stress, below a level surface.
    Angles are those of Mohr and Coulomb, here and below. In plane strain a Drucker-Prager cone that carries m in simple
    shear at constant volume acts with the angle asin(m)."""
    sine = math.sin(math.radians(phi_deg))
    return (1 + sine) / (1 - sine) if passive else (1 - sine) / (1 + sine)


def coulomb_passive(phi_deg: float, wall_deg: float) -> float:
    """Return Coulomb's passive coefficient, of the force on a wall with a friction angle of wall_deg.
    The force is 0.5 density gravity depth^2 times it, inclined by wall_deg to the wall's normal."""
    phi, delta = math.radians(phi_deg), math.radians(wall_deg)
    root = math.sqrt(math.sin(phi + delta) * math.sin(phi) / math.cos(delta))
    return math.cos(phi) ** 2 / (math.cos(delta) * (1 - root) ** 2)


def wedge(depth: float, friction: float, friction_deg: float = FRICTION_DEG) -> float:
    """Return the force per width [N/m] of Coulomb's wedge in front of a blade of a depth [m]."""
    wall = math.degrees(math.atan(friction))
    phi = plane_strain_angle(friction_deg)
    return 0.5 * DENSITY * G * depth**2 * coulomb_passive(phi, wall) * math.cos(math.radians(wall))


def compare_drag(records: list[Record]) -> list[Comparison]:
    """Return the measured force by depth beside that of the wedge."""
    depths = np.linspace(0.02, 0.07, 21)
    measured: dict[str, list] = {}
    for record in records:
        label = record.label("friction", "cell", "speed")
        measured.setdefault(label, []).append((record.choices["depth"], record.readings["drag"], label))
    published = {f"wedge, friction {mu:g}": [(float(d), wedge(float(d), mu), "") for d in depths] for mu in
                 sorted({float(record.choices["friction"] or 0.0) for record in records})}
    return [Comparison(title="drag of a blade", x="depth [m]", y="force [N/m]", measured=measured, published=published,
                       uncertainty=0.2, is_relative=True, is_logarithmic=True)]


@case(
    source="Coulomb's wedge (1776): 0.5 rho g d^2 K_p cos(delta), with a plane slip surface; speed: friction does not "
           "depend on it",
    sweep=[*grid(depth=(0.03, 0.045, 0.06)), *grid(depth=(0.06,), cell=(0.01, 0.0075)),
           *grid(depth=(0.06,), cell=(0.0075,), speed=(0.01, 0.1)), {"depth": 0.06, "friction": 0.0}],
    quick=grid(depth=(0.04, 0.06), cell=(0.01,)),
    expectations=(Within("force", 0.35),
                  Power("drag", "depth", 1.8, 2.2, {"cell": 0.005, "friction": 0.4, "speed": 0.05}),
                  Ratio("drag", "speed", (0.01, 0.1), 0.9, 1.1, {"cell": 0.0075, "depth": 0.06})),
    main_error="force", resolution="cell", compare=compare_drag)
def plate_drag(*, depth: float = 0.06, cell: float = 0.005, friction: float = 0.4, speed: float = 0.05,
               friction_deg: float = FRICTION_DEG, stiffness: float = E, precision: str = "f32") -> Record:
    """Upright blade drawn through sand at constant depth, with its upper edge above the surface, in plane strain.

    Measured: relative error of the horizontal force where it begins to slip, its power of the depth, and its ratio
    between two speeds. A reading, the immersion, is the depth at which a shell still acts, a cell below its edge. depth
    [m]; friction: on the blade; speed [m/s]."""
    pushed = push(make_sand(friction_deg, stiffness), Plate(
        beta_deg=90.0, gamma_deg=0.0, start_depth=0.0, travel=END * depth, cell=cell, side=2 * depth,
        bed=(0.6, 0.0, 0.2), friction=friction, speed=speed, precision=precision))
    slips = pushed.travels > BEGIN * depth
    drag = -float(np.mean(pushed.stresses[slips, 0])) * 2 * depth
    expected = wedge(depth, friction, friction_deg)
    return make_record([pushed.cost], {"force": drag / expected - 1}, drag=drag, expected=expected, depth=depth,
                       immersion=depth + cell)  # a shell acts within a cell of its edge


def compare_wall(records: list[Record]) -> list[Comparison]:
    """Return the measured force over Rankine's, by cells over the height."""
    measured: dict[str, list] = {}
    for record in records:
        state = str(record.choices["state"])
        measured.setdefault(state, []).append((record.choices["cells"], record.errors["force"] + 1, state))
    return [Comparison(title="force on a wall over Rankine's", x="cells over the height", y="measured over Rankine's",
                       measured=measured, line=((15.0, 1.0), (65.0, 1.0)), uncertainty=0.08)]


@case(
    source="Rankine 1857, Phil. Trans. 147:9: 0.5 rho g h^2 (1 -+ sin phi) / (1 +- sin phi) on a smooth wall",
    sweep=grid(state=("active", "passive"), cells=(20, 40, 60)), quick=grid(state=("active", "passive"), cells=(20,)),
    expectations=[Within("force", 0.08, {"state": s}) for s in ("active", "passive")],
    main_error="force", resolution="cells", compare=compare_wall)
def retaining_wall(*, state: str = "active", cells: int = 20, phi_deg: float = PHI_DEG, stiffness: float = E,
                   precision: str = "f32") -> Record:
    """Smooth wall that holds sand: it gives way, or is pushed into it.

    Measured: relative error of the force on the wall, once it no longer changes. In plane strain the cone acts with the
    friction angle asin(m3) (see `slope`). A slice one cell thick is computed. state: "active" or "passive"; cells: over
    the height."""
    cell = HEIGHT / cells
    sand = mpm.DruckerPrager(E=stiffness, nu=NU, density=DENSITY, friction_angle_deg=phi_deg, cone="plane_strain")
    face, length = 8 * cell, math.ceil(LENGTH / cell) * cell
    positions = mpm.sample_box((face, 0, 0), (face + length, cell, HEIGHT), cell / 2)
    volume, half = length * cell * HEIGHT / len(positions), np.array([4 * cell, 4 * cell, HEIGHT])
    start = mpm.Pose(np.array([face - half[0], cell / 2, half[2] - 4 * cell]), UPRIGHT)
    timed, solver = set_up(resting_body(sand, positions, volume), (face + length, cell, 1.25 * HEIGHT), cell,
                           precision=precision,
                           colliders=[mpm.Collider(mpm.Sdf.box(tuple(half)), friction=0.0, pose=start)], walls=SLICE,
                           gravity=(0, 0, -G), dt=courant_step(0.5, cell, sand))
    timed.settle(0.05)
    way, speed, counted = MOTIONS[state]
    windows = round(abs(way) * HEIGHT / speed / WALL_WINDOW)
    forces = [-solver.collider_impulse(0).force[0] / WALL_WINDOW / cell
              for _ in carry(timed, lambda k: [k / windows * way * HEIGHT, 0, 0], windows, WALL_WINDOW)]
    force = float(np.mean(forces[round(counted * windows):]))
    expected = 0.5 * DENSITY * G * HEIGHT**2 * rankine(phi_deg, state == "passive")
    return timed.record({"force": force / expected - 1}, force_per_width=force, expected=expected,
                        first=forces[0], most=max(forces), least=min(forces))


def janssen(depth: np.ndarray | float, width: float, friction: float, ratio: float) -> np.ndarray:
    """Return the mean vertical stress [Pa] at depths [m] in a slot of a width [m].
    friction: coefficient of the walls; ratio: horizontal over vertical stress."""
    length = width / (2 * friction * ratio)
    return DENSITY * G * length * -np.expm1(-np.asarray(depth) / length)


def compare_silo(records: list[Record]) -> list[Comparison]:
    """Return the measured vertical stress by depth beside Janssen's, for every run."""
    measured, published = {}, {}
    for record in records:
        label = record.label("cells", "wall_friction", "slenderness")
        measured[label] = record.curve("stress at", label)
        friction = float(record.choices["wall_friction"] or 0.0)
        published[f"Janssen, {label}"] = [
            (d, float(janssen(d, WIDTH, friction, record.readings["ratio"])), label) for d, _, _ in measured[label]]
    return [Comparison(title="vertical stress in a slot", x="depth [m]", y="stress [Pa]", measured=measured,
                       published=published, uncertainty=0.10, is_relative=True)]


@case(
    source="Janssen 1895, Z. Ver. dt. Ing. 39:1045, for a slot: sigma = rho g W / (2 mu K) (1 - exp(-2 mu K z / W))",
    sweep=[*({"cells": n} for n in (10, 20)), {"cells": 20, "wall_friction": 0.2}, {"cells": 20, "slenderness": 2.0}],
    quick=[{"cells": 10}],
    # rms of the stress in its largest value; what load, walls and weight leave over, in weights
    expectations=each_within({"load": 0.08, "profile": 0.10, "balance": 0.005}),
    main_error="load", resolution="cells", compare=compare_silo)
def silo_load(*, cells: int = 20, slenderness: float = 3.0, wall_friction: float = 0.3, phi_deg: float = PHI_DEG,
              stiffness: float = E, precision: str = "f32") -> Record:
    """Slot between two rough walls, filled with sand whose floor sinks slowly.

    Measured: relative error of the load on the floor, and rms difference of the vertical stress over the height. The
    reference is taken with the ratio K of horizontal to vertical stress that the sand has in this run. A slice one cell
    thick is computed. cells: over the width; slenderness: height of the fill over the width."""
    cell, height = WIDTH / cells, slenderness * WIDTH
    sand = mpm.DruckerPrager(E=stiffness, nu=NU, density=DENSITY, friction_angle_deg=phi_deg, cone="plane_strain")
    base, half = 8 * cell, np.array([WIDTH, 4 * cell, 4 * cell])
    positions = mpm.sample_box((0, 0, base), (WIDTH, cell, base + height), cell / 2)
    start = mpm.Pose(np.array([WIDTH / 2, cell / 2, base - half[2]]), UPRIGHT)
    sides = ("friction", "periodic", "slip")
    timed, solver = set_up(resting_body(sand, positions, WIDTH * cell * height / len(positions)),
                           (WIDTH, cell, base + height + 4 * cell), cell, precision=precision,
                           colliders=[mpm.Collider(mpm.Sdf.box(tuple(half)), friction=0.0, pose=start)],
                           walls=mpm.Walls(friction=wall_friction, lower=sides, upper=sides),
                           gravity=(0, 0, -G), dt=courant_step(0.5, cell, sand))
    timed.settle(0.2)
    weight, windows, pushes = DENSITY * G * WIDTH * height * cell, round(WAY / SPEED / FLOOR_WINDOW), []
    for _ in carry(timed, lambda k: [0, 0, -(k / windows * WAY)], windows, FLOOR_WINDOW):
        low, high = (solver.wall_impulse(side).force / FLOOR_WINDOW for side in ("x-", "x+"))
        pushes.append((-solver.collider_impulse(0).force[2] / FLOOR_WINDOW, -(low[2] + high[2]), high[0] - low[0]))
    load, friction, normal = np.mean(pushes[windows // 2:], axis=0)
    depth, vertical, ratio = stress_profile(solver, height)
    predicted = janssen(depth, WIDTH, wall_friction, ratio)
    expected = float(janssen(height, WIDTH, wall_friction, ratio)) * WIDTH * cell
    errors = {"load": load / expected - 1, "balance": (load + friction) / weight - 1,
              "profile": np.sqrt(np.mean((vertical - predicted) ** 2)) / predicted.max()}
    return timed.record(errors, ratio=ratio, load_share=load / weight, mobilized=friction / (wall_friction * normal),
                        **{f"stress at {d:.4f}": s for d, s in zip(depth, vertical)})


def stress_profile(solver: mpm.Solver, height: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Return depths [m] and mean vertical stresses [Pa] of LAYERS, and horizontal over vertical stress of them all."""
    z, stress = solver.positions()[:, 2], solver.stresses()
    above = np.empty(len(z))
    above[np.argsort(-z)] = np.arange(len(z)) / len(z)  # by mass: settling does not count
    layer = (above * LAYERS).astype(int)
    vertical = np.array([-stress[layer == k, 2, 2].mean() for k in range(LAYERS)])
    ratio = stress[:, 0, 0].sum() / stress[:, 2, 2].sum()
    return (np.arange(LAYERS) + 0.5) / LAYERS * height, vertical, float(ratio)
