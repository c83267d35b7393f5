"""Impact of a free, spinning ball on a blob in empty space.

Measured: change of the total linear and angular momentum, and in every step the difference between what the ball
receives and what the particles give. Reference: conservation of momentum in a closed system, through MuJoCo's step.
"""

import mujoco
import numpy as np

import mpm
from robosim.coupling.plugin import Coupling
from robosim.studies.verification.cases.case import Record, TimedSolver, case, grid
from robosim.studies.verification.cases.expectations import Within
from robosim.studies.verification.cases.rigid_body import couple, one_body

SPEED, SPIN, SIDE = 1.0, 5.0, 0.1
HOST_STEP = 0.002


@case(
    source="conservation of momentum and of angular momentum in a closed system",
    sweep=grid(material=("elastic", "sand"), precision=("f32", "f64"), mass_ratio=(1e-3, 1.0, 1e3)),
    quick=grid(material=("sand",), precision=("f32", "f64"), mass_ratio=(1.0,)),
    # momenta relative to the sums of their parts; step by step, what the ball received against what the grains gave
    expectations=(*(Within(name, high, {"precision": p}) for p, high in (("f64", 1e-12), ("f32", 1e-5))
                    for name in ("linear", "angular")), Within("reaction", 1e-6)),
    main_error="angular")
def measure(*, material: str = "elastic", precision: str = "f64", mass_ratio: float = 1.0, cell: float = 0.01,
            coupling: Coupling = "mobility", duration: float = 0.12) -> Record:
    """Run the case; return the errors of momentum, angular momentum and reaction.

    mass_ratio: of ball to blob (1 kg); cell [m]; duration [s].
    """
    law = mpm.Elastic(E=1e5, nu=0.3, density=1000.0) if material == "elastic" else \
        mpm.DruckerPrager(E=1e5, nu=0.2, density=1000.0, friction_angle_deg=30.0)
    positions = mpm.sample_box((-SIDE / 2,) * 3, (SIDE / 2,) * 3, cell / 2)
    solver = mpm.Solver(
        grid=mpm.Grid((-0.4, -0.4, -0.4), (0.4, 0.4, 0.4), cell), gravity=(0, 0, 0), precision=precision,
        bodies=[mpm.Body(law, positions, volume=SIDE**3 / len(positions))],
        walls=mpm.Walls.all("slip"))
    plugin = couple(one_body(f'type="sphere" size="0.05" mass="{mass_ratio}" friction="0.3"', (0.115, 0.01, 0.005),
                             host_step=HOST_STEP, gravity=(0, 0, 0)), solver, coupling)
    model, data = plugin.model, plugin.data
    data.qvel[:] = [-SPEED, 0, 0, 0, 0, SPIN]
    mujoco.mj_forward(model, data)
    timed = TimedSolver(solver)

    def parts() -> tuple[np.ndarray, np.ndarray]:
        """Momenta (6,) of ball and blob about the origin."""
        p = model.body_mass[1] * data.qvel[:3]
        spin = data.xmat[1].reshape(3, 3) @ (model.body_inertia[1] * data.qvel[3:])
        blob = np.concatenate(solver.momentum())
        return np.concatenate([p, spin + np.cross(data.qpos[:3], p)]), blob

    first, scale, reaction, exchanged = sum(parts()), np.zeros(2), 0.0, 0.0
    worst = np.zeros(2)
    for _ in range(round(duration / HOST_STEP)):
        before = parts()[0]
        timed.run(plugin.step)
        ball, blob = parts()
        received = np.concatenate(plugin.ledger.bodies["body"])
        reaction = max(reaction, np.abs(ball - before + received)[:3].max())
        exchanged = max(exchanged, np.linalg.norm(received[:3]))
        for part in (slice(0, 3), slice(3, 6)):
            i = part.start // 3
            scale[i] = max(scale[i], np.linalg.norm(ball[part]) + np.linalg.norm(blob[part]))
            worst[i] = max(worst[i], np.linalg.norm((ball + blob - first)[part]))
    errors = {"linear": worst[0] / scale[0], "angular": worst[1] / scale[1], "reaction": reaction / exchanged}
    return timed.record(errors, final_speed=np.linalg.norm(data.qvel[:3]),
                        miss=np.abs(plugin.prediction_error).max(initial=0.0),
                        kinetic=solver.energy().kinetic, exchanged=exchanged)
