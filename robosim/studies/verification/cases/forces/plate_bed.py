"""A bed of sand and a plate that is driven through it on a straight line: shared by the cases of plates.
Directions as in resistive force theory: the plate rises by the attack angle beta towards +x, and moves along
(cos gamma, 0, -sin gamma). The force on it is (-alpha_x, alpha_z) times depth and area."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import trimesh

import mpm
from robosim.base.errors import UnknownName
from robosim.studies.verification.cases.beds import carry, courant_step, resting_body
from robosim.studies.verification.cases.case import Cost, TimedSolver
from robosim.studies.verification.cases.dense_sand import DenseSand, critical_angle, dense_sand

SIDE = 0.04
"""Length of the plate [m], and its width where it is square."""
DENSITY, NU, G, E = 1500.0, 0.3, 9.81, 1e6
FRICTION_DEG, PLATE_FRICTION = 30.0, 0.4
"""Friction angle [deg] whose tangent the sand carries in simple shear, and friction coefficient on the plate."""
LAWS = ("drucker_prager", "dense")
"""Sand that flows at constant volume, and sand that is denser than critical and dilates (`cases.dense_sand`)."""
SPEED = 0.2
"""[m/s]: the pressure of inertia, density * speed^2, is some 0.1 % of the pressure on the plate."""
WINDOW = 5e-3
"""Time [s] over which forces are averaged."""
UNIT_WEIGHT = DENSITY * G
"""[N/m^3]"""
BEDS = {False: (12.0, 0.0, 6.0), True: (8.0, 3.0, 5.0)}
"""Length, half width and height of the bed in lengths of a strip, and of a square plate; one bed for all directions
compiles once."""


class Pushed(NamedTuple):
    """What a plate met on its way, at the middle of every window."""

    cost: Cost
    depths: np.ndarray
    """(n,) depth of the plate's centre [m] below the undisturbed surface."""
    travels: np.ndarray
    """(n,) way [m] from the start."""
    stresses: np.ndarray
    """(n, 3) force on the plate per area [Pa]."""


def make_sand(friction_deg: float = FRICTION_DEG, stiffness: float = E, law: str = "drucker_prager",
              cohesion: float = 0.0) -> mpm.DruckerPrager | DenseSand:
    """Make sand that carries tan(friction_deg) in simple shear, dense sand once it has dilated.
    stiffness: Young's modulus [Pa]; law: one of LAWS; cohesion [Pa]: of drucker_prager alone. Raises UnknownName for
    another law, InvalidValue for dense sand with cohesion."""
    ratio = math.tan(math.radians(friction_deg))
    if law not in LAWS:
        raise UnknownName("law", law, LAWS)
    if law == "dense":
        if cohesion > 0:
            raise mpm.InvalidValue(f"make_sand: cohesion = {cohesion:g} Pa of law 'dense'; accepted: 0, or the law "
                                   f"'drucker_prager'")
        return dense_sand(0.7, E=stiffness, nu=NU, density=DENSITY, critical_angle_deg=critical_angle(ratio))
    return mpm.DruckerPrager(E=stiffness, nu=NU, density=DENSITY, cohesion=cohesion, cone="plane_strain",
                             friction_angle_deg=math.degrees(math.asin(ratio)))


@dataclass(frozen=True, kw_only=True)
class Plate:
    """A plate, and the straight way on which it is driven through a bed."""

    beta_deg: float
    gamma_deg: float
    start_depth: float
    """Of the plate's centre [m]; negative above the surface."""
    travel: float
    """Length of the way [m]."""
    cell: float
    square: bool = False
    """As wide as it is long, of which one half is computed; otherwise a strip in plane strain, of which one cell is."""
    side: float = SIDE
    """Length of the plate [m]."""
    friction: float = PLATE_FRICTION
    speed: float = SPEED
    bed: tuple[float, float, float] | None = None
    """Length, half width and height [m]; None: in proportion to the plate."""
    precision: str = "f32"


def push(sand: mpm.DruckerPrager | DenseSand, plate: Plate) -> Pushed:
    """Drive a plate through a bed of sand (`make_sand`); return the stresses that it met."""
    cell, side, square, travel, speed = plate.cell, plate.side, plate.square, plate.travel, plate.speed
    gamma, tilt = math.radians(plate.gamma_deg), -0.5 * math.radians(plate.beta_deg)
    course = np.array([math.cos(gamma), 0.0, -math.sin(gamma)])
    room = plate.bed or [part * side for part in BEDS[square]]
    length, half, height = (_whole(part, cell) for part in room)
    width = half if square else cell
    positions = mpm.sample_box((0, 0, 0), (length, width, height), cell / 2)
    volume = length * width * height / len(positions)
    begin = np.array([0.5 * (length - travel * course[0]), 0.0 if square else width / 2, height - plate.start_depth])
    x, y = side / 2, (side if square else 4 * width) / 2
    mesh = trimesh.Trimesh([[-x, -y, 0], [x, -y, 0], [x, y, 0], [-x, y, 0]], [[0, 1, 2], [0, 2, 3]], process=False)
    attitude = np.array([math.cos(tilt), 0.0, math.sin(tilt), 0.0])
    shell = mpm.Collider(mpm.Shell.from_mesh(mesh, 0.5 * cell), friction=plate.friction, pose=mpm.Pose(begin, attitude))
    sides = "slip" if square else "periodic"
    solver = mpm.Solver(
        grid=mpm.Grid((0, 0, 0), (length, width, height + _whole(side, cell)), cell), precision=plate.precision,
        colliders=[shell], bodies=[resting_body(sand, positions, volume)], gravity=(0, 0, -G),
        walls=mpm.Walls(lower=("slip", "roller" if square else sides, "friction"), upper=("slip", sides, "slip")),
        dt=courant_step(0.5, cell, sand))
    timed = TimedSolver(solver)
    timed.settle(0.04)
    area = side * (side / 2 if square else width)
    depths, travels, stresses = [], [], []
    for k in carry(timed, lambda k: k * WINDOW * speed * course, round(travel / speed / WINDOW), WINDOW):
        travels.append((k + 0.5) * WINDOW * speed)
        depths.append(plate.start_depth + travels[-1] * math.sin(gamma))
        stresses.append(solver.collider_impulse(0).force / (WINDOW * area))
    cost = timed.cost
    solver.close()
    return Pushed(cost, np.array(depths), np.array(travels), np.array(stresses))


def _whole(length: float, cell: float) -> float:
    """Round a length [m] up to whole cells."""
    return math.ceil(length / cell - 1e-9) * cell
