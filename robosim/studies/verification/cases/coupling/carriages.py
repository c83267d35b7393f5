"""A spoon on a carriage whose motion is prescribed."""

import numpy as np

import mpm
from robosim.config.materials import load_material
from robosim.coupling.plugin import Coupling
from robosim.scene.field import build_tool_sdf
from robosim.studies.verification.cases.case import Record, TimedSolver, case, grid
from robosim.studies.verification.cases.expectations import each_within
from robosim.studies.verification.cases.rigid_body import couple

SPOON_STEP, SPOON_MASS = 1e-3, 0.133
BOWL = np.array([0.035, 0.025, 0.030])
"""Half axes [m] of the spoon's cavity."""
GANTRY = """
<mujoco>
  <option timestep="{host_step}" integrator="implicitfast"/>
  <worldbody>
    <body name="carriage" pos="0.08 0.06 0.08">
      <joint type="slide" axis="1 0 0" armature="1e5"/>
      <geom type="sphere" size="0.001" mass="1" contype="0" conaffinity="0"/>
      <body name="spoon">
        <site name="wrist"/>
        <inertial pos="0 0 0" mass="{mass}" diaginertia="1e-4 1e-4 1e-4"/>
      </body>
    </body>
  </worldbody>
  <sensor><force site="wrist"/></sensor>
</mujoco>
"""


@case(
    source="Newton's second law: force at the wrist = (mass of spoon + mass of grains) (acceleration - gravity)",
    sweep=grid(material=("salt", "sugar", "flour"), acceleration=(2.0, 5.0)),
    quick=[{"material": "salt", "acceleration": 2.0}],
    # of the force that is left to the grains
    expectations=each_within({"at_rest": 0.02, "accelerated": 0.02}), main_error="accelerated")
def carried_load(*, material: str = "salt", acceleration: float = 2.0, cell: float = 0.005, thickness: float = 0.0025,
                 coupling: Coupling = "mobility") -> Record:
    """Full spoon, held still and then accelerated.

    Measured: relative error of the load on the wrist's force sensor, at rest and under acceleration [m/s^2]. thickness:
    of the spoon [m]."""
    lattice = mpm.sample_box(-BOWL, [BOWL[0], BOWL[1], 0.0], cell / 2)
    inside = lattice[(((lattice / (BOWL - 1e-3)) ** 2).sum(1) < 1.0) & (lattice[:, 2] < -0.008)]
    body = mpm.Body(load_material(material).make_law(), inside + [0.08, 0.06, 0.08], volume=(cell / 2) ** 3)
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.4, 0.12, 0.14), cell), bodies=[body],
                        colliders=[mpm.Collider(build_tool_sdf("spoon", thickness), friction=0.1)])
    plugin = couple(GANTRY.format(host_step=SPOON_STEP, mass=SPOON_MASS), solver, coupling, {"spoon": 0})
    data, mass, timed, errors = plugin.data, float(solver.masses().sum()), TimedSolver(solver), {}
    gravity = np.array([0.0, 0.0, -9.81])
    for name, a, duration in (("at_rest", 0.0, 0.3), ("accelerated", acceleration, 0.25)):
        data.qfrc_applied[0] = a * (1e5 + 1 + SPOON_MASS)
        forces = []
        for step in range(round(duration / SPOON_STEP)):
            timed.run(plugin.step)
            if step * SPOON_STEP >= duration - 0.1:
                forces.append(data.sensordata.copy())
        per_mass = np.array([a, 0.0, 0.0]) - gravity
        expected, measured = mass * per_mass, np.mean(forces, axis=0) - SPOON_MASS * per_mass
        errors[name] = np.linalg.norm(measured - expected) / np.linalg.norm(expected)
    local = solver.positions() - data.body("spoon").xpos
    return timed.record(errors, mass=mass, speed=data.qvel[0],
                        left=np.mean(((local / (BOWL + 0.004)) ** 2).sum(1) > 1.0))
