"""Matter in equilibrium: whatever the law, the step and the stride, nothing at rest gains energy."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import trimesh

import mpm
from mpm.materials.material import Material
from mpm.materials.stable_step import material_bound
from robosim.studies.verification.cases.beds import UPRIGHT, fill_box, rms
from robosim.studies.verification.stability.cell import DENSITY, G, Outcome, make_sand

CELL, WIDTH, DEPTH = 0.005, 0.06, 0.06
SUBSTEPS, WINDOWS = 20_000, 20
GROWTH, NOISE, GAIN = 1.25, 5e-5, 1e-4
"""Largest rms speed in the second half of a run over that in the first; what is added for rounding [m/s]; and the
largest gain of energy, in the weight times the depth."""
BLOCK = mpm.Elastic(E=3e5, nu=0.25, density=DENSITY)
SAND = make_sand(1.5e5, 33.0)
RADIUS, BOWL = 0.035, np.array([0.091, 0.0805, 0.0592])  # of a bowl, and its centre [m]


def build(law: Material = BLOCK, *, share: float | None = None, stride: int = 4, settled: bool = True,
          spacing: float = CELL / 2, gravity: float = -G, **scene: Any) -> mpm.Solver:
    """Build a layer of a law between smooth walls, under the stress of rest.
    share: substep in bounds of the law; None: the default, and the default stride. stride: substeps.
    settled: False for a layer without stress. spacing: of the particles [m]. scene: of `mpm.Solver`."""
    x = mpm.sample_box((0, 0, 0), (WIDTH, 2 * CELL, DEPTH), spacing)
    upright = x * [1, 1, -np.sign(gravity)]
    stress = mpm.geostatic_stress(upright, spacing**3, law) if settled else None
    dt = None if share is None else share * material_bound(CELL, law, volume=spacing**3)
    steps: dict[str, Any] = {} if dt is None else {"dt": dt, "transfer_interval": (stride + 0.01) * dt}
    top = DEPTH if gravity > 0 else 1.4 * DEPTH
    return mpm.Solver(grid=mpm.Grid((0, 0, 0), (WIDTH, 2 * CELL, top), CELL), walls=mpm.Walls.all("slip"),
                      bodies=[mpm.Body(law, x, volume=spacing**3, stress=stress)], gravity=(0, 0, gravity),
                      **steps | scene)


def two_materials() -> mpm.Solver:
    """Build a soft layer on one that is 10 000 times as stiff."""
    laws = [mpm.Elastic(E=E, nu=0.25, density=DENSITY) for E in (1e8, 1e4)]
    bodies = [fill_box(law, (0, 0, low), (WIDTH, 2 * CELL, low + DEPTH / 2), CELL)
              for law, low in zip(laws, (0.0, DEPTH / 2))]
    return mpm.Solver(grid=mpm.Grid((0, 0, 0), (WIDTH, 2 * CELL, 1.4 * DEPTH), CELL), walls=mpm.Walls.all("slip"),
                      bodies=bodies)


def heap(sleep: bool = False) -> mpm.Solver:
    """Build a cone of sand with slopes of 24 degrees on a rough floor."""
    x = mpm.sample_box((0, 0, 0), (0.16, 0.16, 0.04), CELL / 2)
    x = x[x[:, 2] < 0.03 - np.tan(np.radians(24.0)) * np.hypot(x[:, 0] - 0.08, x[:, 1] - 0.08)]
    return mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.16, 0.16, 0.06), CELL), walls=mpm.Walls.all("stick"), sleep=sleep,
                      bodies=[mpm.Body(SAND, x, volume=(CELL / 2) ** 3, stress=mpm.geostatic_stress(
                          x, (CELL / 2) ** 3, SAND))])


def in_bowl() -> mpm.Solver:
    """Build sand in a thin bowl that stands anywhere between the nodes."""
    sheet = trimesh.creation.icosphere(4, RADIUS)
    sheet.update_faces(sheet.triangles_center[:, 2] < 0)
    x = mpm.sample_box((-RADIUS,) * 3, (RADIUS, RADIUS, -0.1 * RADIUS), CELL / 2)
    x = x[np.linalg.norm(x, axis=1) < RADIUS - 0.002] + BOWL
    return mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.18, 0.16, 0.1), CELL),
                      bodies=[mpm.Body(SAND, x, volume=(CELL / 2) ** 3)],
                      colliders=[mpm.Collider(mpm.Shell.from_mesh(sheet, 1e-3), friction=0.3,
                                              pose=mpm.Pose(BOWL, UPRIGHT))])


SCENES: dict[str, Callable[[], mpm.Solver]] = {
    "default": build, "f64": partial(build, precision="f64"),
    **{f"{share} x {stride}": partial(build, share=share, stride=stride) for share, stride in (
        (0.83, 2), (0.83, 3), (0.83, 6), (0.83, 12), (0.765, 3), (0.765, 4), (0.75, 3), (0.75, 4), (0.75, 5),
        (0.72, 4), (0.66, 4), (0.65, 5), (0.6, 4), (0.6, 5), (0.5, 6), (0.3, 12))},  # 0.765: fitted to an advance
    "single substeps": partial(build, transfer_interval=0.0),
    "neo-Hookean": partial(build, mpm.Elastic(E=3e5, nu=0.25, density=DENSITY, model="neo_hookean"), settled=False),
    "nu 0": partial(build, mpm.Elastic(E=3e5, nu=0.0, density=DENSITY)),
    "nu 0.499": partial(build, mpm.Elastic(E=3e5, nu=0.499, density=DENSITY)),
    "E 1e4 Pa": partial(build, mpm.Elastic(E=1e4, nu=0.25, density=DENSITY)),
    "E 1e9 Pa": partial(build, mpm.Elastic(E=1e9, nu=0.25, density=DENSITY)),
    "no gravity": partial(build, settled=False, gravity=0.0), "upward": partial(build, gravity=G),
    "one grain a cell": partial(build, spacing=CELL), "two materials": two_materials,
    "clay": partial(build, mpm.VonMises(E=3e5, nu=0.25, density=DENSITY, yield_stress=2e3)),
    "water": partial(build, mpm.NewtonianFluid(bulk_modulus=1.5e5, density=1000.0)),
    **{f"sand {share} x {stride}": partial(build, SAND, share=share, stride=stride)
       for share, stride in ((0.83, 1), (0.83, 3), (0.83, 12), (0.765, 3))},
    "sand, one grain a cell": partial(build, SAND, spacing=CELL),
    "sand": partial(build, SAND), "sand asleep": partial(build, SAND, sleep=True),
    "sand 0 deg": partial(build, make_sand(1.5e5, 0.0)), "sand 60 deg": partial(build, make_sand(1.5e5, 60.0)),
    "cohesive sand": partial(build, mpm.DruckerPrager(E=1.5e5, nu=0.2, density=DENSITY, friction_angle_deg=33.0,
                                                      cohesion=300.0)),
    "heap": heap, "heap asleep": partial(heap, sleep=True), "bowl": in_bowl,
}
"""Value of the axis -> what builds its scene."""


def rest(kind: str) -> Outcome:
    """Leave a scene alone for 20 000 substeps: neither its rms speed nor its energy may grow."""
    solver = SCENES[kind]()
    begin, speeds = sum(solver.energy()), []
    scale = solver.masses().sum() * G * DEPTH
    for _ in range(WINDOWS):
        solver.advance(SUBSTEPS / WINDOWS * solver.dt)
        speeds.append(rms(solver.velocities()))
    half = WINDOWS // 2
    gain = (sum(solver.energy()) - begin) / scale
    readings = {"rms_m_s": speeds[-1], "growth": max(speeds[half:]) / max(max(speeds[:half]), 1e-12),
                "energy_gain": gain}
    failure = ""
    if max(speeds[half:]) > GROWTH * max(speeds[:half]) + NOISE:
        failure = f"rms speed grows from {1e3 * max(speeds[:half]):.3g} to {1e3 * max(speeds[half:]):.3g} mm/s"
    elif gain > GAIN:
        failure = f"energy grows by {gain:.2g} of weight times depth"
    return failure, readings


REST_AXES: dict[str, tuple[Callable[..., Outcome], tuple]] = {"rest": (rest, tuple(SCENES))}
"""Axis -> (function that runs a cell, values)."""
