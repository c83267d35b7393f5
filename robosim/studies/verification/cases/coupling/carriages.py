"""A spoon and a wheel on carriages whose motion is prescribed."""

import numpy as np

import mpm
from robosim.config.materials import load_material
from robosim.coupling.plugin import Coupling
from robosim.scene.field import build_tool_sdf
from robosim.studies.verification.cases.beds import set_up
from robosim.studies.verification.cases.case import Record, TimedSolver, case, grid
from robosim.studies.verification.cases.expectations import Rising, Within, each_within
from robosim.studies.verification.cases.rigid_body import G, couple

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
RADIUS, WIDTH, LOAD, SPEED = 0.05, 0.04, 5.0, 0.1
"""Of the wheel: [m], [m], [N], [m/s] at the rim."""
BED = (0.40, 0.14, 0.05)
FRICTION_ANGLE, HOST_STEP = 35.0, 0.002
WHEEL = """
<mujoco>
  <option timestep="{host_step}" integrator="implicitfast"/>
  <worldbody>
    <body name="carriage" pos="0.08 {y} {z}">
      <joint name="along" type="slide" axis="1 0 0" armature="100"/>
      <joint type="slide" axis="0 0 1"/>
      <inertial mass="0.01" pos="0 0 0" diaginertia="1e-4 1e-4 1e-4"/>
      <body name="wheel">
        <joint name="axle" axis="0 1 0" armature="1"/>
        <geom type="cylinder" size="{radius} {half}" euler="90 0 0" mass="{mass}"/>
      </body>
    </body>
  </worldbody>
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


@case(
    source="Wong, Theory of Ground Vehicles, ch. 2: on dry sand a wheel's drawbar pull is negative at zero slip, rises "
           "with slip, and levels out below W tan(phi), the most that shear under the load W can give",
    sweep=grid(slip=(0.0, 0.15, 0.3, 0.5)), quick=[{"slip": 0.3, "duration": 1.0}],
    # in units of the limit
    expectations=(Within("above_limit", 0.0, low=0.0), Rising("pull", "slip")), main_error="above_limit")
def driven_wheel(*, slip: float = 0.3, cell: float = 0.008, duration: float = 2.0, precision: str = "f32") -> Record:
    """Wheel driven over sand at a prescribed slip.

    Measured: excess of the drawbar pull over W tan(phi), in which the reading `pull` is, over the second half; and
    whether the pull rises with slip. slip = 1 - (speed of the axle) / (speed of the rim)."""
    positions = mpm.sample_box((0, 0, 0), BED, cell / 2)
    sand = mpm.DruckerPrager(E=5e5, nu=0.3, density=1600.0, friction_angle_deg=FRICTION_ANGLE)
    timed, solver = set_up(mpm.Body(sand, positions, volume=np.prod(BED) / len(positions)),
                           (BED[0], BED[1], BED[2] + 0.12), cell, precision=precision, walls=mpm.Walls.all("slip"))
    plugin = couple(WHEEL.format(host_step=HOST_STEP, y=BED[1] / 2, z=BED[2] + RADIUS, radius=RADIUS, half=WIDTH / 2,
                                 mass=LOAD / G - 0.01), solver, bodies={"wheel": None})
    data, pulls = plugin.data, []
    for step in range(round(duration / HOST_STEP)):
        # the carriage is too heavy, the axle too stiffly driven, for the sand to change their speeds within a step
        data.qvel[0], data.qvel[2] = SPEED * (1 - slip), SPEED / RADIUS
        timed.run(plugin.step)
        if step * HOST_STEP > duration / 2:
            pulls.append(plugin.wrench("wheel").force[0])
    pull = float(np.mean(pulls)) / (LOAD * np.tan(np.radians(FRICTION_ANGLE)))
    return timed.record({"above_limit": max(pull - 1.0, 0.0)}, pull=pull)
