"""Sphere dropped into a bed of sand."""

import math

import numpy as np

import mpm
from robosim.studies.verification.cases.beds import resting_body
from robosim.studies.verification.cases.case import Comparison, Record, TimedSolver, case, grid
from robosim.studies.verification.cases.expectations import Power, Within
from robosim.studies.verification.cases.forces.plate_bed import DENSITY, E, G, make_sand
from robosim.studies.verification.cases.references import read_reference
from robosim.studies.verification.cases.rigid_body import couple, one_body

USUAL = {"cell": 0.004, "friction_deg": 24.0, "stiffness": E}
DIAMETER, BALL_FRICTION = 0.0254, 0.3
HOST_STEP, LONGEST = 5e-4, 0.6
"""[s]: of MuJoCo, and time after which a ball that still moves is given up."""


def predict(drop: float, density_ratio: float, mu: float) -> float:
    """Return the final depth [m] by Uehara's law for a free drop [m], to which the depth itself is added."""
    law = read_reference("impact")
    powers, depth = law["exponents"], drop
    for _ in range(60):  # contracts: the power of the whole drop is below 1
        depth = law["prefactor"] / mu * density_ratio ** powers["density"] * DIAMETER ** powers["diameter"] \
            * (drop + depth) ** powers["drop"]
    return depth


def compare(records: list[Record]) -> list[Comparison]:
    """Return the measured depth beside that of Uehara's law, for every run."""
    measured: dict[str, list] = {}
    for record in records:
        label = record.label("friction_deg", "cell", "stiffness")
        measured.setdefault(label, []).append((record.readings["expected"], record.readings["stopped"],
                                               f"{label}, {record.label('drop', 'density_ratio')}"))
    law = read_reference("impact")
    return [Comparison(title="depth of dropped spheres", x="Uehara's law [m]", y="measured [m]", measured=measured,
                       line=((0.01, 0.01), (0.1, 0.1)), uncertainty=law["uncertainty"], is_relative=True,
                       is_logarithmic=True, source=law["source"])]


@case(
    source="Uehara et al. 2003, Phys. Rev. Lett. 90:194301; configs/references/impact.yaml",
    sweep=[*grid(cell=(0.004,), drop=(0.05, 0.1, 0.2, 0.4)), *grid(cell=(0.004,), density_ratio=(0.8, 1.8)),
           *grid(cell=(0.006, 0.005, 0.003)), {"friction_deg": 30.0}, {"stiffness": 4e6}],
    quick=grid(cell=(0.006,), drop=(0.05, 0.2)),
    # the error crosses zero between the cells; powers of the whole drop and of the densities' ratio
    expectations=(*(Within("depth", 0.20, {"cell": c}) for c in (0.006, 0.005, 0.004, 0.003)),
                  Power("stopped", "fallen", 0.25, 0.41, {**USUAL, "density_ratio": 5.1}),
                  Power("scaled_depth", "ratio", 0.38, 0.62, {**USUAL, "drop": 0.1})),
    main_error="depth", resolution="cell", compare=compare)
def dropped_sphere(*, drop: float = 0.1, density_ratio: float = 5.1, friction_deg: float = 24.0, cell: float = 0.005,
                   stiffness: float = E, precision: str = "f32") -> Record:
    """Sphere dropped into a bed of sand, a free rigid body; a quarter of it is computed.

    Measured: relative error of the depth at which it stops, and the powers of drop and density in it. Reference: for
    dry grains d = 0.14 / mu (rho_b / rho_g)^(1/2) D^(2/3) H^(1/3), H from the start to the end. drop: free fall [m];
    density_ratio: of ball to bed, 5.1 for steel."""
    sand, mu = make_sand(friction_deg, stiffness), math.tan(math.radians(friction_deg))
    width, height = (math.ceil(part * DIAMETER / cell) * cell for part in (4.0, 6.0))
    positions = mpm.sample_box((0, 0, 0), (width, width, height), cell / 2)
    volume = width**2 * height / len(positions)
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (width, width, height + 4 * DIAMETER), cell), precision=precision,
                        walls=mpm.Walls(lower=("roller", "roller", "friction"), upper=("slip", "slip", "slip")),
                        bodies=[resting_body(sand, positions, volume)], gravity=(0, 0, -G))
    # a quarter of the bed carries a quarter of the ball
    mass = math.pi / 6 * DIAMETER**3 * density_ratio * DENSITY / 4
    near = cell  # where the computed fall begins, above contact
    plugin = couple(one_body(f'type="sphere" size="{DIAMETER / 2}" mass="{mass}" friction="{BALL_FRICTION}"',
                             (0, 0, height + DIAMETER / 2 + near), joint='<joint type="slide" axis="0 0 1"/>',
                             host_step=HOST_STEP), solver)
    data = plugin.data
    data.qvel[0] = -math.sqrt(2 * G * (drop - near))
    timed, has_hit = TimedSolver(solver), False
    while solver.time < LONGEST and not (has_hit and data.qvel[0] > -5e-3):  # at rest
        timed.run(plugin.step)
        has_hit = has_hit or data.qpos[0] < -near - 0.25 * DIAMETER
    depth = -float(data.qpos[0]) - near if has_hit and solver.time < LONGEST else np.nan
    expected = predict(drop, density_ratio, mu)
    return timed.record({"depth": depth / expected - 1}, stopped=depth, expected=expected, fallen=drop + depth,
                        ratio=density_ratio, scaled_depth=depth / (drop + depth) ** (1 / 3))
