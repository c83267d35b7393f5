"""What the field does in stiff and extreme cases: stable, refused with a reason, or unstable and what failed first.

Stable means all of: finite; every principal stretch between 0.05 and 20; no grain outside the walls; speeds below
twice what the drop gives plus a tenth of the sound speed; mechanical energy never more than 1 % above the start's;
momentum accounted for to 1e-5 of what was exchanged.
"""

import warnings
from collections.abc import Callable
from functools import lru_cache

import numpy as np

import mpm
from robosim.errors import UnknownName
from robosim.verification.cases.fluid import lock_gate
from robosim.verification.stability.arm import ROBOT_AXES
from robosim.verification.stability.cell import DENSITY, NU, G, Verdict, sand, sound, stretches, verdict_of
from robosim.verification.stability.coupled import COMPARISONS, COUPLED_AXES

CELL = 0.005
MILD = 0.2
"""Courant number whose result the others must agree with."""
WINDOW = 5e-3
"""Time [s] between two looks at the state."""


def watch(solver: mpm.Solver, duration: float, drop: float, wave: float) -> tuple[str, dict[str, float]]:
    """Advance and judge: ("", readings) when stable, or what failed first and when.

    duration [s]; drop [m] that the grains fall at most; wave: sound speed [m/s].
    """
    lower = np.asarray(solver.grid.lower)
    upper = lower + solver.grid.cells * solver.grid.cell
    start, energy = solver.momentum().linear, solver.energy()
    total = sum(energy)
    scale = energy.kinetic + solver.masses().sum() * G * max(drop, solver.grid.cell)
    given, exchanged = np.zeros(3), 0.0
    limit = 2 * np.sqrt(2 * G * drop) + 0.1 * wave
    seen = {"fastest": 0.0, "energy_gain": -np.inf, "smallest_stretch": np.inf, "momentum": 0.0, "rebound": 0.0}
    while solver.time < duration - 1e-9:
        try:
            solver.advance(WINDOW)
        except mpm.SimulationDiverged as error:
            return str(error), seen
        rows = solver.ledger[:, :3]
        given += rows.sum(0)
        exchanged += np.abs(rows).sum()
        x, v, energy = solver.positions(), solver.velocities(), solver.energy()
        stretch = stretches(solver)
        rise = max(0.0, float(solver.momentum().linear[2] / solver.masses().sum()))
        seen["fastest"] = max(seen["fastest"], float(np.linalg.norm(v, axis=1).max()))
        seen["energy_gain"] = max(seen["energy_gain"], (sum(energy) - total) / scale)
        seen["smallest_stretch"] = min(seen["smallest_stretch"], float(stretch.min()))
        seen["momentum"] = float(np.abs(solver.momentum().linear - start - given).max() / max(exchanged, 1e-12))
        seen["rebound"] = max(seen["rebound"], 0.5 * rise**2 / (G * max(drop, solver.grid.cell)))
        at = f" at t = {solver.time:.4g} s"
        if np.any(x < lower - 1e-6) or np.any(x > upper + 1e-6):
            return "a grain outside the walls" + at, seen
        if stretch.min() < 0.05 or stretch.max() > 20:
            return f"stretch {stretch.min():.3g} .. {stretch.max():.3g}" + at, seen
        if seen["fastest"] > limit:
            return f"speed {seen['fastest']:.3g} m/s above {limit:.3g}" + at, seen
        if seen["energy_gain"] > 0.01:
            return f"energy {seen['energy_gain']:.2%} above the start's" + at, seen
        if seen["momentum"] > 1e-5:
            return f"momentum off by {seen['momentum']:.2g}" + at, seen
    return "", seen


def bed(material: mpm.DruckerPrager) -> mpm.Solver:
    """A bed 0.1 m deep, gravity switched on at once; periodic sides."""
    side = 4 * CELL
    positions = mpm.sample_box((0, 0, 0), (side, side, 0.1), CELL / 2)
    sides = ("periodic", "periodic", "friction")
    return mpm.Solver(grid=mpm.Grid((0, 0, 0), (side, side, 0.15), CELL), walls=mpm.Walls(lower=sides, upper=sides),
                      bodies=[mpm.Body(material, positions, volume=(CELL / 2) ** 3)])


def block(material: mpm.DruckerPrager, drop: float = 0.0, dt: float | None = None) -> mpm.Solver:
    """A cube of 4 cm that falls from `drop` [m] onto the floor of a box and spreads."""
    positions = mpm.sample_box((0.06, 0.06, 0), (0.1, 0.1, 0.04), CELL / 2, np.random.default_rng(0))
    speed = np.tile([0.0, 0.0, -np.sqrt(2 * G * drop)], (len(positions), 1))
    return mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.16, 0.16, 0.12), CELL),
                      bodies=[mpm.Body(material, positions, velocities=speed, volume=(CELL / 2) ** 3)], dt=dt)


def stiffness(E: float) -> Verdict:
    """A bed that nothing but its stiffness holds: from 0.1 MPa on it keeps its height to 1 %."""
    solver = bed(sand(E))
    failed, seen = watch(solver, 0.25, 0.1, sound(E))
    top = solver.positions()[:, 2].max() + CELL / 4 if not failed else np.nan
    if not failed and E >= 1e5 and abs(top / 0.1 - 1) > 0.01:
        failed = f"settled height {top:.4g} m of 0.1 m"
    return verdict_of("E", E, failed, seen | {"height": float(top)})


def friction_angle(phi: float) -> Verdict:
    """Fluid at 0 degrees, beyond Mohr-Coulomb's reach at 60."""
    return verdict_of("friction_angle_deg", phi, *watch(block(sand(phi=phi)), 0.3, 0.04, sound(1e5)))


def courant(number: float) -> Verdict:
    """Steps in units of cell over sound speed; the isolated particle's bound is 0.734 at nu = 0.3. A block spreads to
    the same mean height as at a mild Courant number, to 3 %."""
    try:
        solver = block(sand(), dt=number * CELL / sound(1e5))
    except mpm.MpmError as error:
        return Verdict("courant", number, "refused", str(error))
    failed, seen = watch(solver, 0.3, 0.04, sound(1e5))
    height = float(solver.positions()[:, 2].mean())
    if not failed and number != MILD and abs(height / _mild_height() - 1) > 0.03:
        failed = f"settled height {height:.4g} m, {_mild_height():.4g} m at Courant number {MILD}"
    return verdict_of("courant", number, failed, seen | {"height": height})


@lru_cache
def _mild_height() -> float:
    """Settled mean height [m] of the grains at the mild Courant number."""
    return courant(MILD).readings["height"]


def drop_height(height: float) -> Verdict:
    """A block hits the floor; what comes back up is at most 5 % of its energy.

    E = 1 MPa: at 0.1 MPa the sound speed is that of the fall from 5 m, and what is squeezed to half its height springs.
    """
    failed, seen = watch(block(sand(1e6), drop=height), 0.3, height + 0.04, sound(1e6))
    if not failed and seen["rebound"] > 0.05:
        failed = f"rebound {seen['rebound']:.2%} of the energy"
    return verdict_of("drop_height", height, failed, seen)


def shell_thickness(cells: float) -> Verdict:
    """A plate so many cells thick between deep and shallow water: no grain passes, and the thrust is right to 3 %."""
    try:
        errors = lock_gate.measure(thickness_cells=cells, duration=0.5).errors
    except mpm.MpmError as error:
        refused = not isinstance(error, mpm.SimulationDiverged)
        return Verdict("shell_thickness", cells, "refused" if refused else "unstable", str(error))
    wrong = [f"{name} off by {error:.2%}" for name, error in errors.items() if not abs(error) <= lock_gate.BANDS[name]]
    return verdict_of("shell_thickness", cells, ", ".join(wrong), {name: float(v) for name, v in errors.items()})


def lone_grains(place: str) -> Verdict:
    """One grain, strained by 1e-3, falls free, beside a wall or in a corner, for 20 000 substeps."""
    where = {"free": (0.05, 0.05, 0.08), "wall": (0.0012, 0.05, 0.02), "corner": (0.0012, 0.0012, 0.0012)}[place]
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.1, 0.1, 0.1), CELL), precision="f64", bodies=[
        mpm.Body(mpm.Elastic(E=1e5, nu=NU, density=DENSITY), np.array([where]), volume=(CELL / 2) ** 3)])
    state = solver.state()
    state["e"][:, :3] = 2e-3
    solver.load(state)
    return verdict_of("lone_grain", place, *watch(solver, 20_000 * solver.dt, 0.1, sound(1e5)))


def degenerate(kind: str) -> Verdict:
    """Rest, equal stretches, a piston that squeezes to a tenth, and a velocity field that would turn F inside out."""
    solver = block(sand())
    if kind == "rest":
        solver.set_gravity(np.zeros(3))
    else:
        state = solver.state()
        rate = {"equal stretches": -0.1, "squeezed": -0.6, "inverted": -1.5}[kind] / solver.dt
        state["C"][:, [0, 4, 8]] = [rate, rate, rate] if kind == "equal stretches" else [0.0, 0.0, rate]
        solver.load(state)
    # the strain is put in by hand: its energy is the start's
    solver.advance(solver.dt)
    return verdict_of("degenerate", kind, *watch(solver, 0.1, 0.04, 20 * sound(1e5)))


AXES: dict[str, tuple[Callable[..., Verdict], tuple]] = {
    "E": (stiffness, (1e3, 1e4, 1e5, 1e6, 1e7, 1e8)),
    "friction_angle_deg": (friction_angle, (0.0, 1.0, 15.0, 30.0, 42.0, 45.0, 60.0)),
    "courant": (courant, (0.1, 0.2, 0.4, 0.6, 0.7, 0.8, 0.9, 1.0)),
    "drop_height": (drop_height, (0.01, 0.1, 1.0, 5.0)),
    "shell_thickness": (shell_thickness, (0.1, 0.25, 0.5, 1.0, 2.0)),
    "lone_grain": (lone_grains, ("free", "wall", "corner")),
    "degenerate": (degenerate, ("rest", "equal stretches", "squeezed", "inverted")),
    **COUPLED_AXES,
    **ROBOT_AXES,
}
"""Name -> (judge, values)."""


def axis_named(name: str) -> tuple[Callable[..., Verdict], tuple]:
    """Judge and values of an axis; raises UnknownName."""
    every = AXES | COMPARISONS
    if name not in every:
        raise UnknownName("axis", name, every)
    return every[name]


def judged(axis: str, value: float | str) -> Verdict:
    """One cell."""
    with warnings.catch_warnings():  # a heap squeezed by its own weight is one of the cells
        warnings.simplefilter("ignore", mpm.StrongCompression)
        return axis_named(axis)[0](value)
