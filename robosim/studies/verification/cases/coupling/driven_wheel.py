"""Wheel driven over sand at a prescribed slip.

Measured: excess of the drawbar pull over its limit, and whether the pull rises with slip. Reference: the pull is
negative at zero slip, rises with slip and stays below W tan(phi), the shear that sand can give under the load W.
"""

import numpy as np

import mpm
from robosim.studies.verification.cases.case import Record, TimedSolver, case, grid
from robosim.studies.verification.cases.expectations import Rising, Within
from robosim.studies.verification.cases.rigid_body import G, couple

RADIUS, WIDTH, LOAD, SPEED = 0.05, 0.04, 5.0, 0.1
"""[m], [m], [N], [m/s] at the rim."""
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
    source="Wong, Theory of Ground Vehicles, ch. 2: on dry sand a wheel's drawbar pull is negative at zero slip, rises "
           "with slip, and levels out below W tan(phi), the most that shear under the load W can give",
    sweep=grid(slip=(0.0, 0.15, 0.3, 0.5)),
    quick=[{"slip": 0.3, "duration": 1.0}],
    # in units of the limit
    expectations=(Within("above_limit", 0.0, low=0.0), Rising("pull", "slip")),
    main_error="above_limit")
def measure(*, slip: float = 0.3, cell: float = 0.008, duration: float = 2.0, precision: str = "f32") -> Record:
    """Run the case; return the excess of the pull over W tan(phi), over the second half.

    slip = 1 - (speed of the axle) / (speed of the rim); cell [m]; duration [s]. The reading `pull` is in W tan(phi).
    """
    positions = mpm.sample_box((0, 0, 0), BED, cell / 2)
    sand = mpm.DruckerPrager(E=5e5, nu=0.3, density=1600.0, friction_angle_deg=FRICTION_ANGLE)
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (BED[0], BED[1], BED[2] + 0.12), cell), precision=precision,
                        bodies=[mpm.Body(sand, positions, volume=np.prod(BED) / len(positions))],
                        walls=mpm.Walls.all("slip"))
    plugin = couple(WHEEL.format(host_step=HOST_STEP, y=BED[1] / 2, z=BED[2] + RADIUS, radius=RADIUS, half=WIDTH / 2,
                                 mass=LOAD / G - 0.01), solver, bodies={"wheel": None})
    data = plugin.data
    timed, pulls, sinkages = TimedSolver(solver), [], []
    for step in range(round(duration / HOST_STEP)):
        # the carriage is too heavy, the axle too stiffly driven, for the sand to change their speeds within a step
        data.qvel[0], data.qvel[2] = SPEED * (1 - slip), SPEED / RADIUS
        timed.run(plugin.step)
        if step * HOST_STEP > duration / 2:
            pulls.append(plugin.wrench("wheel").force[0])
            sinkages.append(BED[2] + RADIUS - data.xpos[2][2])
    limit = LOAD * np.tan(np.radians(FRICTION_ANGLE))
    pull = float(np.mean(pulls)) / limit
    return timed.record({"above_limit": max(pull - 1.0, 0.0)}, pull=pull, sinkage=np.mean(sinkages),
                        pull_over_load=float(np.mean(pulls)) / LOAD)
