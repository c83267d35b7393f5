"""Impact of a rigid block on the end of an elastic bar.

Measured: largest error of the block's speed, relative to its start, until the wave returns. Reference: the block is
slowed by the wave that it starts, v = v0 exp(-Z t / m) with Z = rho c A.
"""

import mujoco
import numpy as np

import mpm
from mpm.scene.features import Contact
from robosim.coupling.plugin import GranularPlugin
from robosim.studies.verification.cases.claims import Within
from robosim.studies.verification.cases.record import Record, TimedSolver

NAME = "bar_impact"
SOURCE = "St. Venant 1867: v = v0 exp(-Z t / m), Z = rho c A, until the wave returns at 2 L / c"
BANDS = {"speed": 0.03}
"""Largest error of the block's speed until 1.8 L / c, relative to v0, at cells of 5 mm and m = 0.5 kg."""
SWEEP = [{"cell": c, "mass": m, "offset_cells": o} for m in (0.5, 0.05) for c in (0.01, 0.005, 0.0025)
         for o in (0.0, 0.5)]
"""Choices of the runs in a whole report."""
QUICK_SWEEP = [{"cell": c, "mass": 0.5, "offset_cells": 0.0} for c in (0.01, 0.005)]
MAIN_ERROR, RESOLUTION = "speed", "cell"
CLAIMS = (Within("speed", BANDS["speed"], {"cell": 0.005, "mass": 0.5}),)
E, DENSITY, SIDE, LENGTH = 1e6, 1000.0, 0.05, 0.5
SPEED = 0.1

BLOCK = """
<mujoco>
  <option timestep="{host_step}" integrator="implicitfast" gravity="0 0 0"/>
  <worldbody>
    <body name="block" pos="{x} {y} {y}">
      <joint type="slide" axis="1 0 0"/>
      <geom type="box" size="0.05 0.05 0.05" mass="{mass}" friction="0"/>
    </body>
  </worldbody>
</mujoco>
"""


def measure(*, cell: float = 0.005, mass: float = 0.5, offset_cells: float = 0.0, courant: float = 0.5,
            precision: str = "f32", host_step: float = 5e-4, coupling: str = "mobility",
            contact: Contact = "near") -> Record:
    """Run the case; return the errors of the block's speed.

    cell [m]; mass [kg]; offset_cells: of the bar's end from a plane of nodes; host_step [s]. contact: see `mpm.Solver`.
    """
    c = np.sqrt(E / DENSITY)
    end = 0.1 + offset_cells * cell
    positions = mpm.sample_box((end, 0, 0), (end + LENGTH, SIDE, SIDE), cell / 2)
    bar = mpm.Body(mpm.Elastic(E=E, nu=0.0, density=DENSITY), positions, volume=LENGTH * SIDE**2 / len(positions))
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (end + LENGTH + 0.05, SIDE, SIDE), cell), bodies=[bar],
                        gravity=(0, 0, 0), walls=mpm.Walls.all("roller"), precision=precision, contact=contact,
                        dt=_dividing_step(cell / c * courant, host_step))
    model = mujoco.MjModel.from_xml_string(BLOCK.format(mass=mass, host_step=host_step, x=end - 0.05, y=SIDE / 2))
    data = mujoco.MjData(model)
    data.qvel[0] = SPEED
    plugin = GranularPlugin(model, data, solver, bodies={"block": None}, coupling=coupling)  # pyright: ignore[reportArgumentType]
    timed = TimedSolver(solver)
    Z, times, speeds = DENSITY * c * SIDE**2, [], []
    while data.time < 1.8 * LENGTH / c:
        timed.run(plugin.step)
        times.append(data.time)
        speeds.append(data.qvel[0] / SPEED)
    difference = np.array(speeds) - np.exp(-Z * np.array(times) / mass)
    choices = {"cell": cell, "mass": mass, "offset_cells": offset_cells, "courant": courant, "precision": precision,
               "host_step": host_step, "coupling": coupling, "contact": contact}
    return timed.record(NAME, choices, {"speed": np.abs(difference).max(), "rms": np.sqrt(np.mean(difference**2))},
                        speed_at_10_ms=float(np.interp(0.01, times, speeds)), fastest=float(np.abs(speeds).max()))


def _dividing_step(longest: float, host_step: float) -> float:
    """Return the largest step [s] up to `longest` that divides the host step."""
    return host_step / np.ceil(host_step / longest - 1e-9)
