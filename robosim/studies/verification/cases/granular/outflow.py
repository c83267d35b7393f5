"""Sand that gates, slots and cans of others let go."""

import math
from typing import Any

import numpy as np

import mpm
from robosim.config.materials import load_material
from robosim.studies.calibration.flows import heights_of, let_go, make_column
from robosim.studies.calibration.measurements import HeapExperiment
from robosim.studies.verification.cases.beds import SLICE, UPRIGHT, Beads, carry, courant_step, resting_body, set_up
from robosim.studies.verification.cases.case import Comparison, Record, TimedSolver, case, grid
from robosim.studies.verification.cases.expectations import Within, each_within
from robosim.studies.verification.cases.forces.plate_bed import make_sand
from robosim.studies.verification.cases.references import read_reference, stated

DENSITY, NU, G = 1500.0, 0.3, 9.81
GATE_FRICTION, FLOOR_FRICTION, GATE_ROOM, REST = 0.3, 0.6, (1.3, 0.26), 1.6
"""Friction coefficients, assumed; length and height of the channel [m]; time after the gate has gone [s]."""
SPHERES = Beads(packing=0.6, slow_deg=17.0, fast_deg=30.0, inertial_number=0.3)
"""With a contact friction of 0.2: from memory of published shear cells of such spheres, to be checked."""
K = 1.4
"""Grains that an opening loses of its width (Beverloo et al. 1961)."""
CAN = {"radius": 0.035, "height": 0.08, "lift_speed": 0.05, "floor_friction": 0.6}
"""Of the can [m, m/s]: the source has no sizes."""


def surface_heights(positions: np.ndarray, cell: float, places: np.ndarray) -> np.ndarray:
    """Return the surface's heights [m] (n,) at places along x [m] (n,): the mean volume of columns as wide as a cell.
    positions: of grains two of which fill a cell in each direction, in a slice."""
    counts = np.bincount((positions[:, 0] / cell).astype(int), minlength=int(places.max() / cell) + 2)
    return np.interp(places, (np.arange(len(counts)) + 0.5) * cell, counts * cell / 8)


def compare_gate(records: list[Record]) -> list[Comparison]:
    """Return the final surface, beside the measured points."""
    reference = read_reference("gate")
    measured = {record.label("cell", "friction_deg"): record.curve("height") for record in records}
    return [Comparison(title="behind a lifted gate", x="distance [m]", y="height [m]", measured=measured,
                       published={"measured": [(x, z, "") for x, z in reference["rows"]]},
                       uncertainty=reference["uncertainty"], is_joined=True)]


@case(
    source=stated("gate"),
    sweep=[*grid(cell=(0.01, 0.0075, 0.005)), {"friction_deg": 30.0}, {"law": "dense", "friction_deg": 30.0}],
    quick=[{}],
    expectations=[one for cell in (0.0075, 0.005) for one in each_within(
        {"height at 0.4 m": 0.015, "height at 0.8 m": 0.015}, {"friction_deg": 34.0, "cell": cell})],
    main_error="height at 0.8 m", resolution="cell", compare=compare_gate,
    units={"height at 0.4 m": "m", "height at 0.8 m": "m"})
def lifted_gate(*, cell: float = 0.0075, friction_deg: float = 34.0, stiffness: float = 1e6,
                law: str = "drucker_prager", precision: str = "f32") -> Record:
    """Sand behind a gate that is lifted, in a slice.

    Measured: differences of the final heights [m] from those of the experiment. The gate is a solid that leaves the
    sand it holds back. Friction of sand, floor and gate are assumed; friction_deg: whose tangent the sand carries in
    simple shear; law: see `plate_bed.make_sand`."""
    reference = read_reference("gate")
    length, height = (math.ceil(reference[key] / cell) * cell for key in ("length", "height"))
    sand = make_sand(friction_deg, stiffness, law)
    half = np.array([cell, 4 * cell, 0.6 * height])
    gate = mpm.Collider(mpm.Sdf.box(tuple(half)), friction=GATE_FRICTION,
                        pose=mpm.Pose(np.array([length + half[0], cell / 2, half[2]]), UPRIGHT))
    places = mpm.sample_box((0, 0, 0), (length, cell, height), cell / 2, np.random.default_rng(0))
    upper = [math.ceil(part / cell) * cell for part in GATE_ROOM]
    solver = mpm.Solver(
        grid=mpm.Grid((0, 0, 0), (upper[0], cell, upper[1]), cell), colliders=[gate], precision=precision,
        walls=mpm.Walls(lower=SLICE.lower, upper=SLICE.upper, friction=FLOOR_FRICTION), gravity=(0, 0, -G),
        bodies=[resting_body(sand, places, (cell / 2) ** 3)], dt=courant_step(0.5, cell, sand))
    timed, speed = TimedSolver(solver), reference["lift_speed"]
    timed.settle(0.1)
    for _ in carry(timed, lambda k: [0.0, 0.0, 5e-3 * k * speed], math.ceil(1.3 * height / speed / 5e-3), 5e-3):
        pass
    timed.advance(REST)
    found = surface_heights(solver.positions(), cell, along := np.arange(0.0, 1.2, 0.05) + 0.5 * cell)
    errors = {f"height at {x:g} m": float(np.interp(x, along, found)) - z for x, z in reference["rows"]}
    return timed.record(errors, rms_speed=float(np.sqrt((solver.velocities() ** 2).sum(1).mean())),
                        **{f"height {x:g} m": z for x, z in zip(along, found)})


def compare_slot(records: list[Record]) -> list[Comparison]:
    """Return the mass that has left over time, beside that of single spheres."""
    reference = read_reference("slot_of_beads")
    measured = {record.label("cells"): record.curve("mass") for record in records}
    return [Comparison(title="spheres that leave a slot", x="time [s]", y="mass [kg]", measured=measured,
                       published={"single spheres": [(t, m, "") for t, m in reference["rows"]]},
                       uncertainty=reference["uncertainty"], is_relative=True, is_joined=True)]


@case(
    source=stated("slot_of_beads"), sweep=[{"cells": 9}, {"cells": 13}, {"cells": 13, "E": 4e5}],
    quick=[{"cells": 9}], expectations=each_within({"rate": 0.1, "left at the end": 0.1}), main_error="rate",
    resolution="cells", compare=compare_slot)
def slot_of_beads(*, cells: int = 13, E: float = 1e5, precision: str = "f32") -> Record:
    """Spheres of known contact friction that leave a silo with a flat floor through a slot; half of it is computed.

    Measured: relative error of the rate between 10 and 63 g, and of the mass that has left after 1.5 s, when the rest
    stays on the floor. Reference: simulations of single spheres. The slot is narrower than theirs by 1.4 grains, as
    much as grains lose of an opening. cells: of the grid over the slot and half a cell beyond each edge; E [Pa]."""
    reference = read_reference("slot_of_beads")
    cell = (reference["slot"] - K * reference["grain_diameter"]) / (cells - 1)
    law = SPHERES.make_law(E, NU, reference)
    half = round(reference["silo"] / 2 / cell) * cell
    per_depth = reference["mass"] / reference["depth"] / 2  # of one half [kg/m]
    fill, fall, thick = per_depth / law.density / half, 0.15, 4 * cell
    fall = math.ceil(fall / cell) * cell
    places = mpm.sample_box((0, 0, fall), (half, cell, fall + fill), cell / 2, np.random.default_rng(0))
    edge = 0.5 * cells * cell
    friction = reference["contact_friction"]
    floor = mpm.Collider(mpm.Sdf.box(((2 * half - edge) / 2, 4 * cell, thick / 2)), static=True, friction=friction,
                         pose=mpm.Pose(np.array([(2 * half + edge) / 2, cell / 2, fall - thick / 2]), UPRIGHT))
    timed, solver = set_up(
        mpm.Body(law, places, volume=half * cell * fill / len(places)),
        (half, cell, math.ceil((fall + fill) / cell + 2) * cell), cell, colliders=[floor], precision=precision,
        walls=mpm.Walls(friction=friction, lower=("roller", "periodic", "friction"),
                        upper=("friction", "periodic", "slip")),
        dt=courant_step(0.5, cell, law))
    times, left = [0.0], [0.0]
    while times[-1] < reference["rows"][-1][0]:
        timed.advance(5e-3)
        times.append(solver.time)
        left.append(float(np.mean(solver.positions()[:, 2] < fall - thick)) * reference["mass"])
    t, m = np.array(reference["rows"]).T
    found = np.interp(t, times, left)
    steady = (m > 0.01) & (m < 0.065)
    rate, expected = (np.polyfit(t[steady], mass[steady], 1)[0] for mass in (found, m))
    return timed.record({"rate": rate / expected - 1, "left at the end": found[-1] / m[-1] - 1}, rate=rate,
                        **{f"mass {when:g} s": mass for when, mass in zip(t, found)})


@case(
    source=stated("lifted_can"), sweep=grid(goods=("dry rice", "mung beans"), cells=(8, 12, 16)),
    quick=grid(goods=("dry rice", "mung beans"), cells=(8,)),
    expectations=(Within("slope", read_reference("lifted_can")["uncertainty"]),), main_error="slope",
    resolution="cells", units={"slope": "deg"})
def lifted_can(*, goods: str = "dry rice", cells: int = 12) -> Record:
    """Heap of rice, or of beans, that an open can leaves as it is lifted: the heap of `robosim calibrate`.

    Measured: difference of the slope [deg] from that of the experiment, between a fifth and four fifths of the heap's
    height. The friction carries the tangent of the measured slope in simple shear, as a calibration from a tilted tray
    gives it. cells: over the can's radius."""
    wanted = read_reference("lifted_can")["slopes_deg"][goods]
    ratio = math.tan(math.radians(wanted))
    sine = 3.0 * ratio / (2.0 * math.sqrt(3.0) + ratio)
    card: Any = load_material("sand")
    angle = card.friction_angle.model_copy(update={"value": math.degrees(math.asin(sine))})
    card = card.model_copy(update={"friction_angle": angle})
    heap = HeapExperiment.model_construct(None, cells=cells, **CAN)
    distances = np.arange(0.25, 60.0) * heap.radius / cells
    solver = make_column(heap, card.make_law(), CAN["floor_friction"], 0)
    timed = TimedSolver(solver)
    timed.run(lambda: let_go(heap, solver))
    heights = heights_of(heap, solver, distances)
    flank = (heights > 0.2 * heights.max()) & (heights < 0.8 * heights.max())
    slope = -math.degrees(math.atan(np.polyfit(distances[flank], heights[flank], 1)[0]))
    return timed.record({"slope": slope - wanted}, inclination=slope, height=heights.max())
