"""Particles coupled to rigid bodies in extreme cases: mass ratios, host steps, tool speeds."""

import warnings
from collections.abc import Callable
from functools import lru_cache, partial

import mujoco
import numpy as np

import mpm
from robosim.base.errors import BodyLeftGrid, RobotDiverged
from robosim.coupling.plugin import Coupling, GranularPlugin
from robosim.studies.verification.cases.rigid_body import couple, one_body
from robosim.studies.verification.stability import cell
from robosim.studies.verification.stability.cell import G, Outcome, make_sand, sound_speed

CELL, SIDE, E = 0.008, 0.04, 1e5
TOUCHED = 1500.0 * SIDE**2 * 1.75 * CELL
"""Mass [kg] of the particles in contact with a face of the box, the unit of mass ratios."""


def build_scene(mass: float, host_step: float, coupling: Coupling, *, half: float, lift: float,
                bed: tuple[float, float, float], quat: str = "1 0 0 0", floats: bool = False) -> GranularPlugin:
    """Build a box above a bed of sand.
    mass [kg]; half: of its side [m]; lift: of its lower face above the bed [m]; bed: size [m]; floats: without weight.
    """
    positions = mpm.sample_box((0, 0, 0), bed, CELL / 2)
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (bed[0], bed[1], bed[2] + 0.12), CELL), walls=mpm.Walls(friction=0.5),
                        bodies=[mpm.Body(make_sand(E), positions, volume=float(np.prod(bed)) / len(positions))],
                        dt=2e-4 if floats else 1e-4)
    x = bed[0] / 2 if not floats else 0.3 * bed[0]
    scene = one_body(f'type="box" size="{half} {half} {half}" mass="{mass}" friction="0.3"',
                     (x, bed[1] / 2, bed[2] + lift + half), host_step=host_step,
                     body=f'quat="{quat}" gravcomp="{int(floats)}"')
    return couple(scene, solver, coupling)


def advance_and_check(plugin: GranularPlugin, duration: float, speed: float) -> Outcome:
    """Advance and check every step; return what failed first and when, "" if nothing did, and readings.
    duration [s]; speed [m/s] of the tool."""
    model, data, solver = plugin.model, plugin.data, plugin.solver
    mass, inertia = model.body_mass[1], model.body_inertia[1]
    weight = mass * G * (1 - model.body_gravcomp[1])

    def energy() -> float:
        own = 0.5 * mass * data.qvel[:3] @ data.qvel[:3] + 0.5 * data.qvel[3:] @ (inertia * data.qvel[3:])
        return float(sum(solver.energy()) + own + weight * data.qpos[2])

    mujoco.mj_forward(model, data)
    start = energy()
    scale = 0.5 * mass * speed**2 + weight * SIDE + solver.masses().sum() * G * SIDE
    readings = {"fastest_m_s": 0.0, "fastest_box_m_s": 0.0, "energy_gain": -np.inf, "momentum": 0.0, "miss_m_s": 0.0,
                "repeats": 0.0, "contact_residual": 0.0}
    residual, exchanged = np.zeros(3), 0.0
    while data.time < duration - 1e-9:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", BodyLeftGrid)
                warnings.simplefilter("ignore", mpm.ContactNotConverged)  # a reading
                plugin.step()
        except (mpm.SimulationDiverged, RobotDiverged) as error:
            return str(error), readings
        residual += plugin.ledger.residual.linear
        exchanged += plugin.ledger.exchanged[0]
        readings["momentum"] = float(np.linalg.norm(residual) / max(exchanged, 1e-12))
        readings["repeats"] += plugin.repeats
        cell.raise_to(readings, fastest_m_s=np.linalg.norm(solver.velocities(), axis=1).max(),
                      fastest_box_m_s=np.linalg.norm(data.qvel[:3]), energy_gain=(energy() - start) / scale,
                      miss_m_s=np.abs(plugin.prediction_error[:, :3]).max(initial=0.0),
                      contact_residual=solver.contact_residual)
        if failure := cell.find_failure(readings, 2 * speed + 0.1 * sound_speed(E)):
            return f"{failure} at t = {data.time:.4g} s", readings
    return cell.check_stretches(solver)[1], readings


def plough(ratio: float, coupling: Coupling = "mobility", speed: float = 0.3) -> Outcome:
    """Push a box, half sunk and without weight, through sand.
    ratio: of its mass to that of the particles in contact with it; speed [m/s]."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mpm.GrainsInSolid)  # the box is emptied below
        plugin = build_scene(ratio * TOUCHED, 2e-3, coupling, half=SIDE / 2, lift=-SIDE / 2, bed=(0.2, 0.112, 0.048),
                             floats=True)
    state, solver = plugin.solver.state(), plugin.solver
    inside = np.all(np.abs(solver.positions() - plugin.data.qpos[:3]) < SIDE / 2 + CELL / 4, axis=1)
    sites = mpm.sample_box((0.13, 0, 0.048), (0.2, 0.112, 0.08), CELL / 2)  # on top of the bed's far end
    state["x"][inside] = sites[: inside.sum()] - solver.grid.origin
    solver.load(state)
    plugin.data.qvel[0] = speed
    return advance_and_check(plugin, min(0.1, 0.06 / speed), speed)


def rest_height(host_step: float, coupling: Coupling) -> Outcome:
    """Drop a tilted box of 10 g on 200 g of sand; the readings include its rest height [m]."""
    plugin = build_scene(0.01, host_step, coupling, half=0.01, lift=0.02, bed=(0.08, 0.08, 0.0208),
                         quat="0.98 0.15 0.1 0")
    failure, readings = advance_and_check(plugin, 0.8, np.sqrt(2 * G * 0.03))
    return failure, readings | {"height_m": float(plugin.data.qpos[2])}


@lru_cache
def _reference_height() -> float:
    """Return the rest height [m] at MuJoCo steps of 0.2 ms."""
    return rest_height(2e-4, "mobility")[1]["height_m"]


def compare_rest_heights(step: float, coupling: Coupling = "mobility") -> Outcome:
    """Compare the rest height at MuJoCo steps [s] with that at 0.2 ms: within 0.3 mm."""
    failure, readings = rest_height(step, coupling)
    if not failure and abs(readings["height_m"] - _reference_height()) > 3e-4:
        failure = (f"rests at {1e3 * readings['height_m']:.2f} mm; with steps of 0.2 ms at "
                   f"{1e3 * _reference_height():.2f} mm")
    return failure, readings


RATIOS, STEPS = (1e-3, 1e-2, 0.1, 1.0, 10.0, 1e3), (5e-4, 2e-3, 1e-2)
COUPLED_AXES: dict[str, tuple[Callable[..., Outcome], tuple]] = {
    "mass_ratio": (plough, RATIOS), "host_step": (compare_rest_heights, STEPS),
    "tool_speed": (lambda speed: plough(1e3, speed=speed), (0.01, 0.1, 0.5, 1.0, 2.0, 5.0)),
}
"""Axis -> (function that runs a cell, values)."""
COMPARISONS: dict[str, tuple[Callable[..., Outcome], tuple]] = {
    "lagged_mass_ratio": (partial(plough, coupling="lagged"), RATIOS),
    "lagged_host_step": (partial(compare_rest_heights, coupling="lagged"), STEPS),
}
"""Axes of the lagged coupling, for comparison; run only when they are named."""
