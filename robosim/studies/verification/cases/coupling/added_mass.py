"""Ball on a spring in a hollow sphere full of water.

Measured: relative error of the frequency, which the water's added mass lowers. Reference: Stokes (1843), a ball of
radius a in a hollow sphere of radius b carries C = (b^3 + 2 a^3) / (2 (b^3 - a^3)) of the displaced mass.
"""

from typing import Literal

import numpy as np
import trimesh

import mpm
from robosim.studies.verification.cases.case import Record, TimedSolver, case, grid
from robosim.studies.verification.cases.expectations import Within
from robosim.studies.verification.cases.rigid_body import couple, one_body

RADIUS, STIFFNESS, DENSITY, SOUND = 0.03, 200.0, 1000.0, 30.0
KICK = 0.1
"""[m/s] with which the ball starts: it swings by a tenth of its radius."""
HOST_STEP = 0.001


def hollow(radius: float, wall: float) -> trimesh.Trimesh:
    """Build a wall of a thickness [m] around a hollow of a radius [m] about the origin."""
    inner = trimesh.creation.icosphere(4, radius)
    inner.invert()
    outer = trimesh.creation.icosphere(4, radius + wall)
    return trimesh.Trimesh(np.concatenate([outer.vertices, inner.vertices]),
                           np.concatenate([outer.faces, inner.faces + len(outer.vertices)]), process=False)


def swing(x: np.ndarray, step: float) -> tuple[float, float]:
    """Return the undamped frequency [rad/s] and the damping ratio of a swing x(t) that starts through zero.

    They follow from its first peak to either side, step [s] apart per sample; not a number where it does not swing.
    """
    high = int(np.argmax(x))
    low = high + int(np.argmin(x[high:]))
    if not (0 < high < low < len(x) - 1 and x[low] < 0):
        return np.nan, np.nan
    decay = -np.log(-x[low] / x[high]) / np.pi
    damping = decay / np.hypot(1.0, decay)
    return float(np.pi / ((low - high) * step) / np.sqrt(1 - damping**2)), float(damping)


@case(
    source="Stokes (1843): a ball of radius a in the middle of a hollow sphere of radius b carries "
           "C = (b^3 + 2 a^3) / (2 (b^3 - a^3)) of the mass of the fluid that it displaces",
    sweep=grid(cell=(0.006, 0.004, 0.003), mass_ratio=(2.0, 0.1)),
    quick=[{"cell": 0.006, "mass_ratio": 2.0, "swings": 1.2}],
    # the water is compressible, which has to be far quicker than the spring
    expectations=[Within("frequency", 0.03, {"cell": 0.003, "mass_ratio": 2.0})],
    main_error="frequency", resolution="cell")
def measure(*, cell: float = 0.006, mass_ratio: float = 2.0, radii: float = 2.0, swings: float = 2.0,
            precision: str = "f32", volume_rate: Literal["particle", "cell"] = "particle",
            transfer_interval: float | None = None) -> Record:
    """Run the case; return the error of the frequency.

    cell [m]; mass_ratio: of ball to displaced water; radii: radius of the hollow over the ball's; swings: periods that
    are computed; volume_rate, transfer_interval: see `mpm.NewtonianFluid` and `mpm.Solver`.
    """
    outer = radii * RADIUS
    reach = np.ceil(outer / cell + 3) * cell
    positions = mpm.sample_box((-outer,) * 3, (outer,) * 3, cell / 2)
    distance = np.linalg.norm(positions, axis=1)
    # grains stay half their size off a face; placed nearer, they would put the water under pressure from the start
    positions = positions[(distance < outer - cell / 4) & (distance > RADIUS + cell / 4)]
    volume = 4 / 3 * np.pi * (outer**3 - RADIUS**3) / len(positions)
    water = mpm.NewtonianFluid(bulk_modulus=DENSITY * SOUND**2, density=DENSITY, volume_rate=volume_rate)
    vessel = mpm.Collider(mpm.Sdf.from_mesh(hollow(outer, 2.5 * cell), spacing=cell / 4), friction=0.0, static=True)
    solver = mpm.Solver(grid=mpm.Grid((-reach,) * 3, (reach,) * 3, cell), precision=precision, colliders=[vessel],
                        bodies=[mpm.Body(water, positions, volume=volume)], gravity=(0, 0, 0),
                        transfer_interval=transfer_interval)
    displaced = DENSITY * 4 / 3 * np.pi * RADIUS**3
    plugin = couple(one_body(f'type="sphere" size="{RADIUS}" mass="{mass_ratio * displaced}" friction="0"', (0, 0, 0),
                             joint=f'<joint type="slide" axis="1 0 0" stiffness="{STIFFNESS}"/>', host_step=HOST_STEP,
                             gravity=(0, 0, 0)), solver)
    plugin.data.qvel[0] = KICK
    ratio = (radii**3 + 2) / (2 * (radii**3 - 1))
    expected = np.sqrt(STIFFNESS / ((mass_ratio + ratio) * displaced))
    timed, places = TimedSolver(solver), [0.0]
    for _ in range(round(swings * 2 * np.pi / expected / HOST_STEP)):
        timed.run(plugin.step)
        places.append(float(plugin.data.qpos[0]))
    frequency, damping = swing(np.array(places), HOST_STEP)
    return timed.record({"frequency": frequency / expected - 1}, damping_ratio=damping,
                        frequency_in_vacuum=np.sqrt(STIFFNESS / (mass_ratio * displaced)) / expected)
