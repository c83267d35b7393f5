"""Impacts of rigid bodies on an elastic bar, and on a blob in empty space."""

import mujoco
import numpy as np

import mpm
from robosim.coupling.plugin import Coupling
from robosim.studies.verification.cases.beds import set_up
from robosim.studies.verification.cases.case import Record, TimedSolver, case, grid
from robosim.studies.verification.cases.expectations import Within
from robosim.studies.verification.cases.rigid_body import couple, one_body

E, DENSITY, SIDE, LENGTH, SPEED = 1e6, 1000.0, 0.05, 0.5, 0.1
"""Of the bar, and of the block."""
BLOB, BALL_SPEED, SPIN, HOST_STEP = 0.1, 1.0, 5.0, 0.002


@case(
    source="St. Venant 1867: v = v0 exp(-Z t / m), Z = rho c A, until the wave returns at 2 L / c",
    sweep=grid(mass=(0.5, 0.05), cell=(0.01, 0.005, 0.0025), offset_cells=(0.0, 0.5)),
    quick=grid(cell=(0.01, 0.005), mass=(0.5,), offset_cells=(0.0,)),
    expectations=[Within("speed", 0.03, {"cell": 0.005, "mass": 0.5})], main_error="speed", resolution="cell")
def bar_impact(*, cell: float = 0.005, mass: float = 0.5, offset_cells: float = 0.0, courant: float = 0.5,
               precision: str = "f32", host_step: float = 5e-4, coupling: Coupling = "mobility") -> Record:
    """Impact of a rigid block on the end of an elastic bar.

    Measured: largest error of the block's speed, relative to its start, until the wave returns that it starts and that
    slows it. offset_cells: of the bar's end from a plane of nodes."""
    c, end = np.sqrt(E / DENSITY), 0.1 + offset_cells * cell
    positions = mpm.sample_box((end, 0, 0), (end + LENGTH, SIDE, SIDE), cell / 2)
    bar = mpm.Body(mpm.Elastic(E=E, nu=0.0, density=DENSITY), positions, volume=LENGTH * SIDE**2 / len(positions))
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (end + LENGTH + 0.05, SIDE, SIDE), cell), bodies=[bar],
                        gravity=(0, 0, 0), walls=mpm.Walls.all("roller"), precision=precision,
                        dt=host_step / np.ceil(host_step / (cell / c * courant) - 1e-9))
    plugin = couple(one_body(f'type="box" size="0.05 0.05 0.05" mass="{mass}" friction="0"',
                             (end - 0.05, SIDE / 2, SIDE / 2), joint='<joint type="slide" axis="1 0 0"/>',
                             host_step=host_step, gravity=(0, 0, 0)), solver, coupling)
    data = plugin.data
    data.qvel[0] = SPEED
    timed, times, speeds = TimedSolver(solver), [], []
    while data.time < 1.8 * LENGTH / c:
        timed.run(plugin.step)
        times.append(data.time)
        speeds.append(data.qvel[0] / SPEED)
    difference = np.array(speeds) - np.exp(-DENSITY * c * SIDE**2 * np.array(times) / mass)
    return timed.record({"speed": np.abs(difference).max(), "rms": np.sqrt(np.mean(difference**2))},
                        speed_at_10_ms=np.interp(0.01, times, speeds), fastest=np.abs(speeds).max())


@case(
    source="conservation of momentum and of angular momentum in a closed system, through MuJoCo's step",
    sweep=grid(material=("elastic", "sand"), precision=("f32", "f64"), mass_ratio=(1e-3, 1.0, 1e3)),
    quick=grid(material=("sand",), precision=("f32", "f64"), mass_ratio=(1.0,)),
    # momenta relative to the sums of their parts; step by step, what the ball received against what the grains gave
    expectations=(*(Within(name, high, {"precision": p}) for p, high in (("f64", 1e-12), ("f32", 1e-5))
                    for name in ("linear", "angular")), Within("reaction", 1e-6)),
    main_error="angular")
def closed_system(*, material: str = "elastic", precision: str = "f64", mass_ratio: float = 1.0, cell: float = 0.01,
                  coupling: Coupling = "mobility", duration: float = 0.12) -> Record:
    """Impact of a free, spinning ball on a blob in empty space.

    Measured: change of the total linear and angular momentum, and in every step the difference between what the ball
    receives and what the particles give. mass_ratio: of ball to blob (1 kg)."""
    law = mpm.Elastic(E=1e5, nu=0.3, density=1000.0) if material == "elastic" else \
        mpm.DruckerPrager(E=1e5, nu=0.2, density=1000.0, friction_angle_deg=30.0)
    positions = mpm.sample_box((-BLOB / 2,) * 3, (BLOB / 2,) * 3, cell / 2)
    timed, solver = set_up(mpm.Body(law, positions, volume=BLOB**3 / len(positions)), (0.4,) * 3, cell,
                           lower=(-0.4,) * 3, gravity=(0, 0, 0), precision=precision, walls=mpm.Walls.all("slip"))
    plugin = couple(one_body(f'type="sphere" size="0.05" mass="{mass_ratio}" friction="0.3"', (0.115, 0.01, 0.005),
                             host_step=HOST_STEP, gravity=(0, 0, 0)), solver, coupling)
    model, data = plugin.model, plugin.data
    data.qvel[:] = [-BALL_SPEED, 0, 0, 0, 0, SPIN]
    mujoco.mj_forward(model, data)

    def momenta() -> np.ndarray:
        """Linear and angular momenta (2, 2, 3) of ball and blob about the origin."""
        p = model.body_mass[1] * data.qvel[:3]
        spin = data.xmat[1].reshape(3, 3) @ (model.body_inertia[1] * data.qvel[3:])
        return np.array([[p, spin + np.cross(data.qpos[:3], p)], solver.momentum()])

    first, worst, scale, reaction, exchanged = momenta().sum(0), np.zeros(2), np.zeros(2), 0.0, 0.0
    for _ in range(round(duration / HOST_STEP)):
        before = momenta()[0, 0]
        timed.run(plugin.step)
        parts, received = momenta(), plugin.ledger.bodies["body"].linear
        reaction = max(reaction, np.abs(parts[0, 0] - before + received).max())
        exchanged = max(exchanged, np.linalg.norm(received))
        scale = np.maximum(scale, np.linalg.norm(parts, axis=2).sum(0))
        worst = np.maximum(worst, np.linalg.norm(parts.sum(0) - first, axis=1))
    errors = {"linear": worst[0] / scale[0], "angular": worst[1] / scale[1], "reaction": reaction / exchanged}
    return timed.record(errors, exchanged=exchanged)
