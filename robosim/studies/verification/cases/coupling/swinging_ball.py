"""Ball in a closed box of water: a pendulum, or held at rest."""

from typing import Literal

import numpy as np
import trimesh

import mpm
from mpm.geometry.shell import SHELL_FACE
from robosim.scene.settle import settle
from robosim.studies.verification.cases.beds import UPRIGHT, hydrostatic_stress, set_up
from robosim.studies.verification.cases.case import Record, TimedSolver, case, grid
from robosim.studies.verification.cases.expectations import Within
from robosim.studies.verification.cases.rigid_body import G, couple, one_body

HOST_STEP = 1e-3
RADIUS, LENGTH, WIDTH = 0.02, 0.1, 0.1
"""Of the ball, from its middle to the pendulum's axis, and of the box [m]."""
DENSITY, DENSITY_RATIO, SOUND = 1000.0, 2.5, 12.0
RELEASE = 0.04
"""Angle [rad] from which the pendulum starts: 4 mm, a fifth of the radius."""
THICKNESS = 1e-3
"""Of the shell [m]."""
SETTLING = 0.1
"""Time [s] for which the water comes to rest."""


def image_velocity(radius: float, width: float, reach: int = 100) -> float:
    """Return the velocity that a moving sphere's images give to its place, relative to its own.
    The sphere is in the middle of a cube [m]; its images are dipoles, of turned sign behind the walls that it moves
    towards. reach: of the images that are summed one by one along the planes."""
    along = np.arange(-9, 10)  # planes of images farther away cancel
    signs = (-1.0) ** np.abs(along)
    x, y, z = np.meshgrid(along, *2 * [np.arange(-reach, reach + 1)], indexing="ij")
    square = (x**2 + y**2 + z**2).astype(float)
    square[9, reach, reach] = np.inf  # the sphere itself
    dipoles = ((3 * x**2 / square - 1) / square**1.5).sum((1, 2))
    # beyond a square of half-width R, 1 / r^3 over a plane sums to 4 sqrt(2) / R
    return 0.5 * (radius / width) ** 3 * float(signs @ (dipoles - 4 * np.sqrt(2) / (reach + 0.5)))


def added_mass(radius: float, width: float) -> float:
    """Return the added mass of a sphere in the middle of a cube of water, relative to the water that it displaces."""
    return 1.5 / (1 + image_velocity(radius, width)) - 1


@case(
    source="added mass of a sphere between walls by its image dipoles: 1/2 in unbounded water (Lamb, Hydrodynamics); "
           "thrust of the displaced water (Archimedes)",
    sweep=[{"ball": "pendulum"}, {"ball": "pendulum", "volume_rate": "cell"},
           {"ball": "pendulum", "volume_rate": "cell", "transfer_interval": HOST_STEP},
           {"ball": "pendulum", "volume_rate": "cell", "transfer_interval": 4 * HOST_STEP, "host_step": 4 * HOST_STEP},
           *grid(ball=("solid", "shell"), volume_rate=("particle", "cell")),
           *grid(ball=("shell",), volume_rate=("particle", "cell"), face_cells=(0.51,))],
    quick=[{"ball": "solid"}],
    # the viscosity of real water would damp this ball by 0.01 (Landau and Lifshitz, Fluid Mechanics, section 24); the
    # simulated one is inviscid and slides along ball and walls: 0
    expectations=(Within("damping", 0.08, {"ball": "pendulum"}), Within("frequency", 0.03, {"ball": "pendulum"}),
                  *(Within("thrust", 0.03, {"ball": ball}) for ball in ("solid", "shell"))),
    main_error="thrust")
def swinging_ball(*, ball: Literal["pendulum", "solid", "shell"] = "pendulum", cell: float = 0.005,
                  volume_rate: Literal["particle", "cell"] = "particle", transfer_interval: float | None = None,
                  face_cells: float = SHELL_FACE, host_step: float = HOST_STEP, precision: str = "f32") -> Record:
    """Ball of 8 cells across in a closed box of water: a pendulum, or held at rest, solid or an empty shell.

    Measured: damping ratio and relative error of the frequency of the pendulum; relative error of the thrust on a ball
    that is held. Reference: a sphere of radius a that moves in still water carries C = 3 / (2 (1 + s)) - 1 of the mass
    that it displaces, with s the velocity that its images in the walls give to its place, relative to its own (Lamb
    1932, section 99: 1/2 in unbounded water). host_step: of the pendulum's MuJoCo model [s]; a stride is not longer, as
    it ends with an advance."""
    middle = np.full(3, WIDTH / 2)
    if ball == "pendulum":
        middle[0] -= LENGTH * np.sin(RELEASE)
        middle[2] += LENGTH * (1 - np.cos(RELEASE))
    positions = mpm.sample_box((0, 0, 0), (WIDTH,) * 3, cell / 2)
    positions = positions[np.linalg.norm(positions - middle, axis=1) > RADIUS]
    displaced = 4 / 3 * np.pi * RADIUS**3
    volume = (WIDTH**3 - displaced) / len(positions)
    water = mpm.NewtonianFluid(bulk_modulus=DENSITY * SOUND**2, density=DENSITY, volume_rate=volume_rate)
    held = []
    if ball != "pendulum":
        shape = mpm.Sdf.sphere(RADIUS) if ball == "solid" else mpm.Shell.from_mesh(
            trimesh.creation.icosphere(4, RADIUS - THICKNESS / 2), THICKNESS, face_cells=face_cells)
        held = [mpm.Collider(shape, friction=0.0, pose=mpm.Pose(middle, UPRIGHT))]
    stress = hydrostatic_stress(water, WIDTH - positions[:, 2])
    timed, solver = set_up(mpm.Body(water, positions, volume=volume, stress=stress), (WIDTH, WIDTH, WIDTH), cell,
                           walls=mpm.Walls.all("roller"), precision=precision, colliders=held,
                           transfer_interval=transfer_interval)
    if ball == "pendulum":
        return _swing(timed, displaced, host_step)
    timed.settle(SETTLING)
    impulses, weight = [], DENSITY * G * displaced
    for _ in range(100):
        timed.advance(HOST_STEP)
        impulses.append(solver.collider_impulse(0).force[2])
    return timed.record({"thrust": np.mean(impulses) / HOST_STEP / weight - 1},
                        ripple=np.std(impulses) / HOST_STEP / weight)


def _swing(timed: TimedSolver, displaced: float, host_step: float) -> Record:
    """Release a pendulum that displaces so much water [m^3], until it has swung to the other side.
    host_step: of MuJoCo [s]."""
    mass = DENSITY_RATIO * DENSITY * displaced
    scene = one_body(f'type="sphere" pos="0 0 -{LENGTH}" size="{RADIUS}" mass="{mass}" friction="0"',
                     (WIDTH / 2, WIDTH / 2, WIDTH / 2 + LENGTH), joint='<joint type="hinge" axis="0 1 0"/>',
                     host_step=host_step)
    plugin = couple(scene, timed.solver)
    model, data = plugin.model, plugin.data
    data.qpos[0] = RELEASE
    carried = mass + added_mass(RADIUS, WIDTH) * DENSITY * displaced
    inertia = carried * LENGTH**2 + 0.4 * mass * RADIUS**2
    stiffness = (mass - DENSITY * displaced) * G * LENGTH
    expected = np.sqrt(stiffness / inertia)
    model.dof_armature[0] = 1e9  # held while the water comes to rest
    settle(timed.solver, lambda window: [timed.run(plugin.step) for _ in range(round(window / host_step))],
           SETTLING, max(2e-3, host_step))
    model.dof_armature[0] = 0.0
    data.qvel[0] = 0.0
    angles = [float(data.qpos[0])]
    for _ in range(round(0.75 * 2 * np.pi / expected / host_step)):
        timed.run(plugin.step)
        angles.append(float(data.qpos[0]))
    frequency, damping = half_swing(np.array(angles), host_step)
    found = (stiffness / frequency**2 - 0.4 * mass * RADIUS**2) / LENGTH**2 - mass
    return timed.record({"damping": damping, "frequency": frequency / expected - 1}, expected=expected,
                        added_mass=added_mass(RADIUS, WIDTH), added_mass_found=found / (DENSITY * displaced))


def half_swing(x: np.ndarray, step: float) -> tuple[float, float]:
    """Return the undamped frequency [rad/s] and the damping ratio of a swing x(t) that starts at rest, from a peak.
    They follow from its next peak, on the other side; not a number where it does not get there."""
    low = int(np.argmin(x))
    if not (2 < low < len(x) - 3 and x[low] < 0 < x[0]):
        return np.nan, np.nan
    near = np.arange(low - 3, low + 4)
    a, b, c = np.polyfit(near - low, x[near], 2)
    time, peak = (low - b / (2 * a)) * step, c - b**2 / (4 * a)
    decay = -np.log(-peak / x[0]) / np.pi
    damping = decay / np.hypot(1.0, decay)
    return float(np.pi / time / np.sqrt(1 - damping**2)), float(damping)
