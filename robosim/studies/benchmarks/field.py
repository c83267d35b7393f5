"""`robosim bench field`: nanoseconds per particle and substep."""

import json
import statistics
import subprocess
import sys
import time
import warnings
from pathlib import Path

import numpy as np

import mpm
from robosim.base.errors import ConfigError, UnknownName
from robosim.base.output_folder import OutputFolder
from robosim.studies.benchmarks import FIELD_SCENES
from robosim.studies.verification.cases.coupling.shell_leak import AXES, bowl

CORNER, MARGIN = 0.3, 6.0
"""Corner of the block of grains [m], and the least distance from its other side to the walls in cells."""
SUBSTEPS = 10
"""Substeps of one launch, a typical host step."""


def bench_field(sizes: list[int], scenes: list[str], out: Path | None, threads: int = 1, arch: str = "cpu") -> int:
    """Time scenes of these sizes, each in a fresh process; print a JSON line each and write bench_field.json.
    With several threads, or on a GPU (arch "cuda"), each line has the speed-up over one CPU thread. A scene that cannot
    run there has the reason.
    Returns 0, or 1 where a scene could not run. Raises UnknownName for a scene that does not exist."""
    for scene in scenes:
        if scene not in FIELD_SCENES:
            raise UnknownName("bench scene", scene, FIELD_SCENES)
    folder = OutputFolder(out) if out else None
    lines: list[dict] = []
    for grains in sizes:
        for scene in scenes:
            line = {"case": "bench_field", "scene": scene, "grains": grains, "arch": arch, "threads": threads}
            try:
                line |= _in_fresh_process(scene, grains, threads, arch)
                if threads > 1 or arch != "cpu":
                    line["speedup_over_one_thread"] = _in_fresh_process(scene, grains, 1, "cpu")["ns"] / line["ns"]
            except ConfigError as error:  # the other scenes may run
                line["refused"] = str(error)
            lines.append(line)
            print(json.dumps({k: round(v, 3) if isinstance(v, float) else v for k, v in line.items()}), flush=True)
            if folder:
                folder.write_json("bench_field.json", lines)
    return int(any("refused" in line for line in lines))


def _in_fresh_process(scene: str, grains: int, threads: int, arch: str) -> dict[str, float]:
    """Time a scene in a process of its own, where no kernel is compiled and no memory allocated yet."""
    code = (f"import json, mpm; from {time_scene.__module__} import time_scene; "
            f"mpm.init(threads={threads}, arch={arch!r}); "
            f"print(json.dumps(time_scene({scene!r}, {grains})))")
    process = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    if process.returncode != 0:
        raise ConfigError(f"{(process.stderr.strip().splitlines() or ['the process printed no error'])[-1]}")
    return json.loads(process.stdout.strip().splitlines()[-1])


def time_scene(scene: str, grains: int, repetitions: int = 9) -> dict[str, float]:
    """Time one scene in this process.
    Returns compile_s, the compile time [s], and ns, the median nanoseconds per particle and substep."""
    solver = build_scene(scene, grains)
    state = solver.state()
    begin = time.perf_counter()
    solver.compile()
    compile_time = time.perf_counter() - begin
    # in one repetition some 3 million particles times substeps; each starts at the same state, and keeps its shape
    launches = min(max(5, int(3e6 / grains / SUBSTEPS)), 30)
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
    edge = (grains / 8) ** (1 / 3)
    # cells along each side of the unit cube: more where the block of grains would not fit
    cell = 1.0 / max(64, int(np.ceil((edge + MARGIN) / (1.0 - CORNER))))
    laws = {"fluid": mpm.NewtonianFluid(bulk_modulus=1000.0, density=1.0),
            "clay": mpm.VonMises(E=1000.0, nu=0.2, density=1.0, yield_stress=10.0)}
    law = laws.get(scene, mpm.DruckerPrager(E=1000.0, nu=0.2, density=1.0, friction_angle_deg=30.0))
    side = edge * cell
    corner = np.array([CORNER, CORNER, 2 * cell])
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
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mpm.GrainsInSolid)  # the tool is in contact from the first substep
        return mpm.Solver(grid=mpm.Grid((0, 0, 0), (top, top, top), cell), bodies=[body], colliders=colliders, dt=1e-4)
