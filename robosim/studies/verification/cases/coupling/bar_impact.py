"""Impact of a rigid block on the end of an elastic bar.

Measured: largest error of the block's speed, relative to its start, until the wave returns. Reference: the block is
slowed by the wave that it starts, v = v0 exp(-Z t / m) with Z = rho c A.
"""

import numpy as np

import mpm
from mpm.scene.scene import Contact
from robosim.coupling.plugin import Coupling
from robosim.studies.verification.cases.case import Record, TimedSolver, case, grid
from robosim.studies.verification.cases.expectations import Within
from robosim.studies.verification.cases.rigid_body import couple, one_body

E, DENSITY, SIDE, LENGTH = 1e6, 1000.0, 0.05, 0.5
SPEED = 0.1


@case(
    source="St. Venant 1867: v = v0 exp(-Z t / m), Z = rho c A, until the wave returns at 2 L / c",
    sweep=grid(mass=(0.5, 0.05), cell=(0.01, 0.005, 0.0025), offset_cells=(0.0, 0.5)),
    quick=grid(cell=(0.01, 0.005), mass=(0.5,), offset_cells=(0.0,)),
    expectations=[Within("speed", 0.03, {"cell": 0.005, "mass": 0.5})],
    main_error="speed", resolution="cell")
def measure(*, cell: float = 0.005, mass: float = 0.5, offset_cells: float = 0.0, courant: float = 0.5,
            precision: str = "f32", host_step: float = 5e-4, coupling: Coupling = "mobility",
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
                        dt=host_step / np.ceil(host_step / (cell / c * courant) - 1e-9))
    plugin = couple(one_body(f'type="box" size="0.05 0.05 0.05" mass="{mass}" friction="0"',
                             (end - 0.05, SIDE / 2, SIDE / 2), joint='<joint type="slide" axis="1 0 0"/>',
                             host_step=host_step, gravity=(0, 0, 0)), solver, coupling)
    data = plugin.data
    data.qvel[0] = SPEED
    timed = TimedSolver(solver)
    Z, times, speeds = DENSITY * c * SIDE**2, [], []
    while data.time < 1.8 * LENGTH / c:
        timed.run(plugin.step)
        times.append(data.time)
        speeds.append(data.qvel[0] / SPEED)
    difference = np.array(speeds) - np.exp(-Z * np.array(times) / mass)
    return timed.record({"speed": np.abs(difference).max(), "rms": np.sqrt(np.mean(difference**2))},
                        speed_at_10_ms=np.interp(0.01, times, speeds), fastest=np.abs(speeds).max())
