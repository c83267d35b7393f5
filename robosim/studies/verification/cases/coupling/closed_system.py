"""Impact of a free, spinning ball on a blob in empty space.

Measured: change of the total linear and angular momentum, and in every step the difference between what the ball
receives and what the particles give. Reference: conservation of momentum in a closed system, through MuJoCo's step.
"""

import mujoco
import numpy as np

import mpm
from mpm.materials.elasticity import Hencky
from robosim.coupling.plugin import GranularPlugin
from robosim.studies.verification.cases.claims import Within
from robosim.studies.verification.cases.record import Record, TimedSolver

NAME = "closed_system"
SOURCE = "conservation of momentum and of angular momentum in a closed system"
BANDS = {"f64": 1e-12, "f32": 1e-5, "reaction": 1e-6}
"""Largest change of momentum and angular momentum relative to the sums of their parts; and, step by step, of what the
ball received against what the grains gave, relative to it."""
SWEEP = [{"material": m, "precision": p, "mass_ratio": r}
         for m in ("elastic", "sand") for p in ("f32", "f64") for r in (1e-3, 1.0, 1e3)]
"""Choices of the runs in a whole report."""
QUICK_SWEEP = [{"material": "sand", "precision": p, "mass_ratio": 1.0} for p in ("f32", "f64")]
MAIN_ERROR, RESOLUTION = "angular", None
CLAIMS = (*(Within(name, BANDS[p], {"precision": p}) for p in ("f64", "f32") for name in ("linear", "angular")),
          Within("reaction", BANDS["reaction"]))
SPEED, SPIN, SIDE = 1.0, 5.0, 0.1
HOST_STEP = 0.002

BALL = """
<mujoco>
  <option timestep="{host_step}" integrator="implicitfast" gravity="0 0 0"/>
  <worldbody>
    <body name="ball" pos="0.115 0.01 0.005">
      <freejoint/>
      <geom type="sphere" size="0.05" mass="{mass}" friction="0.3"/>
    </body>
  </worldbody>
</mujoco>
"""


def materials() -> dict[str, Hencky]:
    """Return the materials of the blob by name."""
    return {"elastic": mpm.Elastic(E=1e5, nu=0.3, density=1000.0),
            "sand": mpm.DruckerPrager(E=1e5, nu=0.2, density=1000.0, friction_angle_deg=30.0)}


def measure(*, material: str = "elastic", precision: str = "f64", mass_ratio: float = 1.0, cell: float = 0.01,
            coupling: str = "mobility", duration: float = 0.12) -> Record:
    """Run the case; return the errors of momentum, angular momentum and reaction.

    mass_ratio: of ball to blob (1 kg); cell [m]; duration [s].
    """
    positions = mpm.sample_box((-SIDE / 2,) * 3, (SIDE / 2,) * 3, cell / 2)
    solver = mpm.Solver(
        grid=mpm.Grid((-0.4, -0.4, -0.4), (0.4, 0.4, 0.4), cell), gravity=(0, 0, 0), precision=precision,
        bodies=[mpm.Body(materials()[material], positions, volume=SIDE**3 / len(positions))],
        walls=mpm.Walls.all("slip"))
    model = mujoco.MjModel.from_xml_string(BALL.format(mass=mass_ratio, host_step=HOST_STEP))
    data = mujoco.MjData(model)
    data.qvel[:] = [-SPEED, 0, 0, 0, 0, SPIN]
    mujoco.mj_forward(model, data)
    plugin = GranularPlugin(model, data, solver, bodies={"ball": None}, coupling=coupling)  # pyright: ignore[reportArgumentType]
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
        received = np.concatenate(plugin.ledger.bodies["ball"])
        reaction = max(reaction, np.abs(ball - before + received)[:3].max())
        exchanged = max(exchanged, np.linalg.norm(received[:3]))
        for part in (slice(0, 3), slice(3, 6)):
            i = part.start // 3
            scale[i] = max(scale[i], np.linalg.norm(ball[part]) + np.linalg.norm(blob[part]))
            worst[i] = max(worst[i], np.linalg.norm((ball + blob - first)[part]))
    errors = {"linear": worst[0] / scale[0], "angular": worst[1] / scale[1], "reaction": reaction / exchanged}
    choices = {"material": material, "precision": precision, "mass_ratio": mass_ratio, "cell": cell,
               "coupling": coupling}
    energy = solver.energy()
    return timed.record(NAME, choices, errors, final_speed=float(np.linalg.norm(data.qvel[:3])),
                        miss=float(np.abs(plugin.prediction_error).max(initial=0.0)), kinetic=energy.kinetic,
                        exchanged=float(exchanged))
