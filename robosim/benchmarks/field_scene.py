"""Scenes of the field's benchmark, and their timing."""

import statistics
import time

import numpy as np

import mpm
from robosim.verification.cases.coupling.shell_leak import AXES, bowl

NODES = 64
"""Cells along each side of the unit cube that is the workspace."""
SUBSTEPS = 10
"""Substeps of one launch, a typical host step."""
MOST_WORK = 3e6
"""Most particles times substeps in one repetition."""
MOST_LAUNCHES = 30
"""Most launches in one repetition; each repetition starts at the same state, so that all scenes keep their shape."""


def time_scene(scene: str, grains: int, repetitions: int = 9) -> dict[str, float]:
    """Time one scene in this process.

    Returns compile_s, the compile time [s], and ns, the median nanoseconds per particle and substep.
    """
    solver = build_scene(scene, grains)
    state = solver.state()
    begin = time.perf_counter()
    solver.compile()
    compile_time = time.perf_counter() - begin
    launches = min(max(5, int(MOST_WORK / grains / SUBSTEPS)), MOST_LAUNCHES)
    figures = []
    for _ in range(repetitions):
        solver.load(state)
        solver.advance(SUBSTEPS * solver.dt)
        begin = time.perf_counter()
        for _ in range(launches):
            solver.advance(SUBSTEPS * solver.dt)
        figures.append((time.perf_counter() - begin) / launches / SUBSTEPS / grains * 1e9)
    return {"compile_s": compile_time, "ns": statistics.median(figures)}


def build_scene(scene: str, grains: int) -> mpm.Solver:
    """Build a block of particles on the floor of a unit cube, with the scene's law and collider."""
    cell = 1.0 / NODES
    laws = {
        "fluid": mpm.NewtonianFluid(bulk_modulus=1000.0, density=1.0),
        "clay": mpm.VonMises(E=1000.0, nu=0.2, density=1.0, yield_stress=10.0),
    }
    law = laws.get(scene, mpm.DruckerPrager(E=1000.0, nu=0.2, density=1.0, friction_angle_deg=30.0))
    side = (grains / 8) ** (1 / 3) * cell
    corner = np.array([0.3, 0.3, 2 * cell])
    positions = np.random.default_rng(0).uniform(0, 1, (2 * grains, 3)) * side + corner
    if scene == "sand_with_shell":  # no particle starts in the wall
        height = np.linalg.norm(positions - corner - [side / 2, side / 2, side], axis=1)
        positions = positions[np.abs(height - side / 4) > 0.5 * cell]
    positions = positions[:grains]
    colliders = []
    pose = mpm.Pose(corner + [side / 2, side / 2, side], mpm.Pose.identity().quaternion)
    if scene == "sand_with_shell":
        mesh = bowl()
        mesh.vertices *= side / 4 / AXES
        colliders = [mpm.Collider(mpm.Shell.from_mesh(mesh, 1e-3), friction=0.1, pose=pose)]
    if scene == "sand_with_tool":
        colliders = [mpm.Collider(mpm.Sdf.box((side / 4,) * 3), friction=0.1, pose=pose)]
    top = 1.0 - 4 * cell
    body = mpm.Body(law, positions, volume=(cell / 2) ** 3)
    return mpm.Solver(grid=mpm.Grid((0, 0, 0), (top, top, top), cell), bodies=[body], colliders=colliders, dt=1e-4)
