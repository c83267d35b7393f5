"""What grains and rigid bodies do together in extreme cases: mass ratios, host steps, tool speeds.

Stable means: finite; speeds below twice the tool's plus a tenth of the sound speed; energy of grains and body never
more than 1 % above the start's; momentum accounted for to 1e-5 of what was exchanged; every stretch within 0.05 .. 20.
"""

import warnings
from collections.abc import Callable
from functools import lru_cache

import mujoco
import numpy as np

import mpm
from robosim.coupling.plugin import Coupling, GranularPlugin
from robosim.errors import BodyLeftGrid, RobotDiverged
from robosim.verification.stability.cell import G, Verdict, sand, sound, stretches, verdict_of

CELL, SIDE, E = 0.008, 0.04, 1e5
TOUCHED = 1500.0 * SIDE**2 * 1.75 * CELL
"""Mass [kg] of the grains that a face of the box feels at once: what its mass is compared with."""
HEIGHT_TOLERANCE = 3e-4
"""[m] within which a body rests at the same height at every host step."""

BOX = """
<mujoco>
  <option timestep="{host_step}" integrator="implicitfast"/>
  <worldbody>
    <body name="box" pos="{x} {y} {z}" quat="{quat}" gravcomp="{gravcomp}">
      <freejoint/>
      <geom type="box" size="{half} {half} {half}" mass="{mass}" friction="0.3"/>
    </body>
  </worldbody>
</mujoco>
"""


def scene(mass: float, host_step: float, coupling: Coupling, *, half: float, lift: float,
          bed: tuple[float, float, float], quat: str = "1 0 0 0", floats: bool = False,
          dt: float = 2e-4) -> GranularPlugin:
    """A box of mass [kg] and half size [m], its lower face `lift` [m] above a bed of sand (3,) [m]; floats: without
    weight of its own."""
    positions = mpm.sample_box((0, 0, 0), bed, CELL / 2)
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (bed[0], bed[1], bed[2] + 0.12), CELL), walls=mpm.Walls(friction=0.5),
                        bodies=[mpm.Body(sand(E), positions, volume=float(np.prod(bed)) / len(positions))], dt=dt)
    x = bed[0] / 2 if not floats else 0.3 * bed[0]
    model = mujoco.MjModel.from_xml_string(BOX.format(
        host_step=host_step, half=half, mass=mass, x=x, y=bed[1] / 2, z=bed[2] + lift + half, quat=quat,
        gravcomp=int(floats)))
    return GranularPlugin(model, mujoco.MjData(model), solver, bodies={"box": None}, coupling=coupling)


def watch(plugin: GranularPlugin, duration: float, speed: float) -> tuple[str, dict[str, float]]:
    """Step and judge: ("", readings) when stable, or what failed first and when.

    duration [s]; speed [m/s] of the tool.
    """
    model, data, solver = plugin.model, plugin.data, plugin.solver
    mass, inertia = model.body_mass[1], model.body_inertia[1]
    weight = mass * G * (1 - model.body_gravcomp[1])

    def energy() -> float:
        own = 0.5 * mass * data.qvel[:3] @ data.qvel[:3] + 0.5 * data.qvel[3:] @ (inertia * data.qvel[3:])
        return float(sum(solver.energy()) + own + weight * data.qpos[2])

    mujoco.mj_forward(model, data)
    start, limit = energy(), 2 * speed + 0.1 * sound(E)
    scale = 0.5 * mass * speed**2 + weight * SIDE + solver.masses().sum() * G * SIDE
    seen = {"fastest": 0.0, "fastest_box": 0.0, "energy_gain": -np.inf, "momentum": 0.0, "miss": 0.0, "repeats": 0.0}
    residual, exchanged = np.zeros(3), 0.0
    while data.time < duration - 1e-9:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", BodyLeftGrid)
                plugin.step()
        except (mpm.SimulationDiverged, RobotDiverged) as error:
            return str(error), seen
        residual += plugin.ledger.residual.linear
        exchanged += plugin.ledger.exchanged[0]
        seen["momentum"] = float(np.linalg.norm(residual) / max(exchanged, 1e-12))
        seen["fastest"] = max(seen["fastest"], float(np.linalg.norm(solver.velocities(), axis=1).max()))
        seen["fastest_box"] = max(seen["fastest_box"], float(np.linalg.norm(data.qvel[:3])))
        seen["energy_gain"] = max(seen["energy_gain"], (energy() - start) / scale)
        seen["miss"] = max(seen["miss"], float(np.abs(plugin.prediction_error[:, :3]).max(initial=0.0)))
        seen["repeats"] += plugin.repeats
        at = f" at t = {data.time:.4g} s"
        if max(seen["fastest"], seen["fastest_box"]) > limit:
            return f"speed {max(seen['fastest'], seen['fastest_box']):.3g} m/s above {limit:.3g}" + at, seen
        if seen["energy_gain"] > 0.01:
            return f"energy {seen['energy_gain']:.2%} above the start's" + at, seen
        if seen["momentum"] > 1e-5:
            return f"momentum off by {seen['momentum']:.2g}" + at, seen
    stretch = stretches(solver)
    if stretch.min() < 0.05 or stretch.max() > 20:
        return f"stretch {stretch.min():.3g} .. {stretch.max():.3g}", seen
    return "", seen


def ploughing(ratio: float, coupling: Coupling = "mobility", speed: float = 0.3, axis: str = "mass_ratio",
              value: float | None = None) -> Verdict:
    """A box, half sunk and without weight, is pushed through sand at `speed` [m/s]; ratio: of its mass and that of the
    grains it touches."""
    plugin = scene(ratio * TOUCHED, 2e-3, coupling, half=SIDE / 2, lift=-SIDE / 2, bed=(0.2, 0.112, 0.048), floats=True)
    _clear(plugin)
    plugin.data.qvel[0] = speed
    result = watch(plugin, min(0.1, 0.06 / speed), speed)
    return verdict_of(axis, ratio if value is None else value, *result)


def _clear(plugin: GranularPlugin) -> None:
    """Take the grains that begin inside the box's place off it: they lie on top of the bed's far end instead."""
    state, solver = plugin.solver.state(), plugin.solver
    places = solver.positions()
    inside = np.all(np.abs(places - plugin.data.qpos[:3]) < SIDE / 2 + CELL / 4, axis=1)
    spots = mpm.sample_box((0.13, 0, 0.048), (0.2, 0.112, 0.08), CELL / 2)
    state["x"][inside] = spots[: inside.sum()] - solver.grid.origin
    solver.load(state)


def mass_ratio(ratio: float) -> Verdict:
    """The default coupling."""
    return ploughing(ratio)


def lagged_mass_ratio(ratio: float) -> Verdict:
    """The peers' coupling, for comparison."""
    return ploughing(ratio, "lagged", axis="lagged_mass_ratio")


def tool_speed(speed: float) -> Verdict:
    """A heavy tool at any speed."""
    return ploughing(1e3, speed=speed, axis="tool_speed", value=speed)


def rest_height(host_step: float, coupling: Coupling = "mobility") -> tuple[str, dict[str, float]]:
    """A box of 10 g falls, tilted, on 200 g of sand; readings with the height at which it comes to rest [m]."""
    plugin = scene(0.01, host_step, coupling, half=0.01, lift=0.02, bed=(0.08, 0.08, 0.0208), quat="0.98 0.15 0.1 0",
                   dt=1e-4)
    failed, seen = watch(plugin, 0.8, np.sqrt(2 * G * 0.03))
    return failed, seen | {"height": float(plugin.data.qpos[2])}


@lru_cache
def _mild_height() -> float:
    return rest_height(2e-4)[1]["height"]


def host_step(step: float) -> Verdict:
    """The same rest, whatever MuJoCo's step: within 0.3 mm of that at 0.2 ms."""
    failed, seen = rest_height(step)
    return _judged_height("host_step", step, failed, seen)


def lagged_host_step(step: float) -> Verdict:
    """The peers' coupling, for comparison."""
    failed, seen = rest_height(step, "lagged")
    return _judged_height("lagged_host_step", step, failed, seen)


def _judged_height(axis: str, step: float, failed: str, seen: dict[str, float]) -> Verdict:
    if not failed and abs(seen["height"] - _mild_height()) > HEIGHT_TOLERANCE:
        failed = f"rests at {1e3 * seen['height']:.2f} mm, at {1e3 * _mild_height():.2f} mm with steps of 0.2 ms"
    return verdict_of(axis, step, failed, seen)


RATIOS = (1e-3, 1e-2, 0.1, 1.0, 10.0, 1e3)
COUPLED_AXES: dict[str, tuple[Callable[..., Verdict], tuple]] = {
    "mass_ratio": (mass_ratio, RATIOS),
    "host_step": (host_step, (5e-4, 2e-3, 1e-2)),
    "tool_speed": (tool_speed, (0.01, 0.1, 0.5, 1.0, 2.0, 5.0)),
}
"""Name -> (judge, values)."""
COMPARISONS: dict[str, tuple[Callable[..., Verdict], tuple]] = {
    "lagged_mass_ratio": (lagged_mass_ratio, RATIOS),
    "lagged_host_step": (lagged_host_step, (5e-4, 2e-3, 1e-2)),
}
"""Axes that show what other schemes do; run when they are asked for by name."""
