"""The field in stiff and extreme cases: stable, refused with a reason, or unstable with what failed first."""

import warnings
from collections.abc import Callable
from functools import lru_cache, partial

import numpy as np

import mpm
from robosim.base.errors import ConfigError, UnknownName, UnreachableWaypoint
from robosim.studies.verification.cases.beds import fill_box
from robosim.studies.verification.cases.expectations import judge
from robosim.studies.verification.cases.fluid.water import lock_gate
from robosim.studies.verification.stability import SLEEPING_AXES, SLEEPING_PREFIX, cell
from robosim.studies.verification.stability.arm import ROBOT_AXES
from robosim.studies.verification.stability.cell import DENSITY, NU, CellResult, G, Outcome, make_sand, sound_speed
from robosim.studies.verification.stability.coupled import COMPARISONS, COUPLED_AXES
from robosim.studies.verification.stability.rest import REST_AXES

CELL = 0.005
REFERENCE_COURANT = 0.2
"""Courant number with whose result the others are compared."""


def advance_and_check(solver: mpm.Solver, duration: float, drop: float, wave: float) -> Outcome:
    """Advance and check; return what failed first and when, "" if nothing did, and readings.
    duration [s]; drop: largest fall of a particle [m]; wave: sound speed [m/s]."""
    lower = np.asarray(solver.grid.lower)
    upper = lower + solver.grid.cells * solver.grid.cell
    start, energy = solver.momentum().linear, solver.energy()
    total, mass, fall = sum(energy), solver.masses().sum(), max(drop, solver.grid.cell)
    scale = energy.kinetic + mass * G * fall
    impulse, exchanged = np.zeros(3), 0.0
    readings = {"fastest_m_s": 0.0, "energy_gain": -np.inf, "smallest_stretch": np.inf, "momentum": 0.0, "rebound": 0.0,
                "least_awake": 1.0}
    while solver.time < duration - 1e-9:
        try:
            solver.advance(5e-3)
        except mpm.SimulationDiverged as error:
            return str(error), readings
        rows = solver.ledger[:, :3]
        impulse += rows.sum(0) + solver.sleepers_impulse.force
        exchanged += np.abs(rows).sum()
        x, momentum = solver.positions(), solver.momentum().linear
        least, stretched = cell.check_stretches(solver)
        cell.raise_to(readings, fastest_m_s=np.linalg.norm(solver.velocities(), axis=1).max(),
                      energy_gain=(sum(solver.energy()) - total) / scale,
                      rebound=0.5 * max(0.0, float(momentum[2] / mass)) ** 2 / (G * fall))
        readings["smallest_stretch"] = min(readings["smallest_stretch"], least)
        readings["momentum"] = float(np.abs(momentum - start - impulse).max() / max(exchanged, 1e-12))
        readings["least_awake"] = min(readings["least_awake"], float(solver.awake.mean()))
        is_outside = np.any(x < lower - 1e-6) or np.any(x > upper + 1e-6)
        failure = "a particle outside the walls" if is_outside else \
            stretched or cell.find_failure(readings, 2 * np.sqrt(2 * G * drop) + 0.1 * wave)
        if failure:
            return f"{failure} at t = {solver.time:.4g} s", readings
    return "", readings


def build_block(material: mpm.DruckerPrager, drop: float = 0.0, dt: float | None = None,
                sleep: bool = False) -> mpm.Solver:
    """Build a cube of 4 cm that has fallen by `drop` [m] onto the floor of a box, where it spreads."""
    positions = mpm.sample_box((0.06, 0.06, 0), (0.1, 0.1, 0.04), CELL / 2, np.random.default_rng(0))
    speed = np.tile([0.0, 0.0, -np.sqrt(2 * G * drop)], (len(positions), 1))
    return mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.16, 0.16, 0.12), CELL),
                      bodies=[mpm.Body(material, positions, velocities=speed, volume=(CELL / 2) ** 3)], dt=dt,
                      sleep=sleep)


def stiffness(E: float) -> Outcome:
    """Load a bed 0.1 m deep of Young's modulus E [Pa] by its weight: from 0.1 MPa on its height stays within 1 %."""
    side, sides = 4 * CELL, ("periodic", "periodic", "friction")
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (side, side, 0.15), CELL), walls=mpm.Walls(lower=sides, upper=sides),
                        bodies=[fill_box(make_sand(E), (0, 0, 0), (side, side, 0.1), CELL)])
    failure, readings = advance_and_check(solver, 0.25, 0.1, sound_speed(E))
    top = solver.positions()[:, 2].max() + CELL / 4 if not failure else np.nan
    if not failure and E >= 1e5 and abs(top / 0.1 - 1) > 0.01:
        failure = f"settled height {top:.4g} m of 0.1 m"
    return failure, readings | {"height_m": float(top)}


def friction_angle(phi: float, sleep: bool = False) -> Outcome:
    """Spread a block of friction angle phi [deg]: a fluid at 0, outside Mohr-Coulomb's range at 60."""
    return advance_and_check(build_block(make_sand(phi=phi), sleep=sleep), 0.3, 0.04, sound_speed(1e5))


def courant(number: float, sleep: bool = False) -> Outcome:
    """Spread a block at a Courant number: its mean height stays within 3 % of the reference's.
    The number is the substep in units of cell over sound speed; the bound is 1.2 at nu = 0.3, of which
    0.83 is accepted."""
    solver = build_block(make_sand(), dt=number * CELL / sound_speed(1e5), sleep=sleep)
    failure, readings = advance_and_check(solver, 0.3, 0.04, sound_speed(1e5))
    height = float(solver.positions()[:, 2].mean())
    if not failure and number != REFERENCE_COURANT and abs(height / _reference_height() - 1) > 0.03:
        failure = f"settled height {height:.4g} m, {_reference_height():.4g} m at Courant number {REFERENCE_COURANT}"
    return failure, readings | {"height_m": height}


@lru_cache
def _reference_height() -> float:
    """Return the settled mean height [m] of the particles at the reference Courant number."""
    return courant(REFERENCE_COURANT)[1]["height_m"]


def drop_height(height: float, sleep: bool = False) -> Outcome:
    """Drop a block from a height [m]: it rebounds with at most 5 % of its energy.
    E = 1 MPa, because at 0.1 MPa the fall from 5 m reaches the sound speed and compresses the block to half its height.
    """
    solver = build_block(make_sand(1e6), drop=height, sleep=sleep)
    failure, readings = advance_and_check(solver, 0.3, height + 0.04, sound_speed(1e6))
    if not failure and readings["rebound"] > 0.05:
        failure = f"rebound {readings['rebound']:.2%} of the energy"
    return failure, readings


def shell_thickness(cells: float) -> Outcome:
    """Separate deep from shallow water by a plate of a thickness in cells: no leak, thrust within 3 %."""
    record = lock_gate(thickness_cells=cells, duration=0.5)
    wrong = [f"{finding.claim} off by {finding.found:.2%}" for finding in judge(lock_gate, [record])
             if finding.verdict == "fail"]
    return ", ".join(wrong), record.errors


def lone_grains(place: str) -> Outcome:
    """Let one particle, strained by 1e-3, fall free, at a wall or in a corner, for 20 000 substeps."""
    where = {"free": (0.05, 0.05, 0.08), "wall": (0.0012, 0.05, 0.02), "corner": (0.0012, 0.0012, 0.0012)}[place]
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.1, 0.1, 0.1), CELL), precision="f64", bodies=[
        mpm.Body(mpm.Elastic(E=1e5, nu=NU, density=DENSITY), np.array([where]), volume=(CELL / 2) ** 3)])
    state = solver.state()
    state["e"][:, :3] = 2e-3
    solver.load(state)
    return advance_and_check(solver, 20_000 * solver.dt, 0.1, sound_speed(1e5))


def degenerate(kind: str) -> Outcome:
    """Start from rest, equal stretches, strong compression, or a velocity gradient that would invert F."""
    solver = build_block(make_sand())
    if kind == "rest":
        solver.set_gravity(np.zeros(3))
    else:
        state = solver.state()
        rate = {"equal stretches": -0.1, "squeezed": -0.6, "inverted": -1.05}[kind] / solver.dt
        state["C"][:, [0, 4, 8]] = [rate, rate, rate] if kind == "equal stretches" else [0.0, 0.0, rate]
        solver.load(state)
    # the prescribed strain is part of the start's energy
    solver.advance(solver.dt)
    return advance_and_check(solver, 0.1, 0.04, 20 * sound_speed(1e5))


AXES: dict[str, tuple[Callable[..., Outcome], tuple]] = {
    "E": (stiffness, (1e3, 1e4, 1e5, 1e6, 1e7, 1e8)),
    "friction_angle_deg": (friction_angle, (0.0, 1.0, 15.0, 30.0, 42.0, 45.0, 60.0)),
    "courant": (courant, (0.1, 0.2, 0.4, 0.6, 0.8, 1.0, 1.1, 1.5)),
    "drop_height": (drop_height, (0.01, 0.1, 1.0, 5.0)),
    "shell_thickness": (shell_thickness, (0.1, 0.25, 0.5, 1.0, 2.0)),
    "lone_grain": (lone_grains, ("free", "wall", "corner")),
    "degenerate": (degenerate, ("rest", "equal stretches", "squeezed", "inverted")),
    **COUPLED_AXES, **ROBOT_AXES, **REST_AXES,
}
"""Axis -> (function that runs a cell, values)."""
SLEEPING = {SLEEPING_PREFIX + name: (partial(AXES[name][0], sleep=True), AXES[name][1])
            for name in (axis.removeprefix(SLEEPING_PREFIX) for axis in SLEEPING_AXES)}
"""The same with particles that sleep; run only when they are named."""


def find_axis(name: str) -> tuple[Callable[..., Outcome], tuple]:
    """Return the function that runs a cell, and the values of an axis.
    Raises UnknownName for an axis that does not exist."""
    axes = AXES | COMPARISONS | SLEEPING
    if name not in axes:
        raise UnknownName("axis", name, axes)
    return axes[name]


def run_cell(axis: str, value: float | str) -> CellResult:
    """Run one cell. Raises UnknownName for an axis that does not exist."""
    run = find_axis(axis)[0]
    with warnings.catch_warnings():  # some cells are compressed by their own weight on purpose
        warnings.simplefilter("ignore", mpm.StrongCompression)
        try:
            failure, readings = run(value)
        except mpm.SimulationDiverged as error:
            return CellResult(axis, value, "unstable", str(error))
        except (mpm.MpmError, ConfigError, UnreachableWaypoint) as error:
            return CellResult(axis, value, "refused", str(error))
    return CellResult(axis, value, "unstable" if failure else "stable", failure, readings)
