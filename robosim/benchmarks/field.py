"""`robosim bench field`: nanoseconds per grain and substep, beside yardsticks measured in the same run."""

import json
import re
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import mpm
from robosim.benchmarks import FIELD_SCENES
from robosim.config.output import OutputFolder
from robosim.errors import ConfigError, UnknownName
from robosim.verification.cases.coupling.shell_leak import AXES, bowl

NODES = 64
"""Cells along each side of the unit cube that is the workspace."""
SUBSTEPS = 10
"""Substeps in one launch, as in a host step of the paper's ancestors."""
WORK = 3e6
"""Grains times substeps that one repetition measures, at most."""
LAUNCHES = 30
"""Launches of one repetition at most; each begins at the same state, so that all scenes are timed in the same shape."""
YARDSTICKS = {
    "reference_layout.py": ("reference", r'"ns_per_particle_substep": ([0-9.]+)'),
    "lane_fused.py": ("prototype", r"ns/particle-substep ([0-9.]+)"),
}
"""File in the folder given by --yardsticks -> (name, where its output states the figure)."""
PROBE, PROBE_SPEED = "limit_probe.cpp", r"total ([0-9.]+) Mp/s"
"""A program of that folder, built where there is a compiler, and where it states millions of grains a second."""


def time_scene(scene: str, grains: int, repetitions: int = 9) -> dict[str, float]:
    """Compile time [s] and median ns per grain and substep of one scene, in this process."""
    solver = _solver(scene, grains)
    state = solver.state()
    begin = time.perf_counter()
    solver.compile()
    compile_time = time.perf_counter() - begin
    launches = min(max(5, int(WORK / grains / SUBSTEPS)), LAUNCHES)
    figures = []
    for _ in range(repetitions):
        solver.load(state)
        solver.advance(SUBSTEPS * solver.dt)
        begin = time.perf_counter()
        for _ in range(launches):
            solver.advance(SUBSTEPS * solver.dt)
        figures.append((time.perf_counter() - begin) / launches / SUBSTEPS / grains * 1e9)
    return {"compile_s": compile_time, "ns": statistics.median(figures)}


def _solver(scene: str, grains: int) -> mpm.Solver:
    cell = 1.0 / NODES
    laws = {
        "fluid": mpm.NewtonianFluid(bulk_modulus=1000.0, density=1.0),
        "clay": mpm.VonMises(E=1000.0, nu=0.2, density=1.0, yield_stress=10.0),
    }
    law = laws.get(scene, mpm.DruckerPrager(E=1000.0, nu=0.2, density=1.0, friction_angle_deg=30.0))
    side = (grains / 8) ** (1 / 3) * cell
    corner = np.array([0.3, 0.3, 2 * cell])
    positions = np.random.default_rng(0).uniform(0, 1, (2 * grains, 3)) * side + corner
    if scene == "sand_with_shell":  # no grain begins in the wall
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


def bench_field(sizes: list[int], scenes: list[str], yardsticks: Path | None, out: Path | None,
                threads: int = 1, arch: str = "cpu") -> int:
    """Print one JSON line per measurement, each from a fresh process, and write bench_field.json; returns 0. With
    several threads, or on a graphics card, how many times faster that is than one thread of the CPU."""
    for scene in scenes:
        if scene not in FIELD_SCENES:
            raise UnknownName("bench scene", scene, FIELD_SCENES)
    folder = OutputFolder(out) if out else None
    lines: list[dict] = []
    for grains in sizes:
        references = _yardsticks(yardsticks, grains) if yardsticks else {}
        for scene in scenes:
            line = {"case": "bench_field", "scene": scene, "grains": grains, "arch": arch, "threads": threads}
            try:
                line |= _in_fresh_process(scene, grains, threads, arch)
                if threads > 1 or arch != "cpu":
                    line["times_one_thread"] = _in_fresh_process(scene, grains, 1, "cpu")["ns"] / line["ns"]
                line |= {f"times_{name}": figure / line["ns"] for name, figure in references.items()}
            except ConfigError as error:  # the other scenes may well run there
                line["refused"] = str(error)
            lines.append(line)
            print(json.dumps({k: round(v, 3) if isinstance(v, float) else v for k, v in line.items()}), flush=True)
            if folder:
                folder.write_json("bench_field.json", lines)
    return 0


def _in_fresh_process(scene: str, grains: int, threads: int, arch: str) -> dict[str, float]:
    """A process of its own: compiled kernels and memory of the last scene must not help this one."""
    code = (f"import json, mpm; from robosim.benchmarks.field import time_scene; "
            f"mpm.init(threads={threads}, arch={arch!r}); "
            f"print(json.dumps(time_scene({scene!r}, {grains})))")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    if done.returncode != 0:
        raise ConfigError(f"{(done.stderr.strip().splitlines() or ['said nothing'])[-1]}")
    return json.loads(done.stdout.strip().splitlines()[-1])


def _yardsticks(folder: Path, grains: int) -> dict[str, float]:
    """ns per grain and substep of the yardsticks that are found."""
    found = {}
    for file, (name, pattern) in YARDSTICKS.items():
        if (folder / file).is_file():
            arguments = [str(grains)] if name == "reference" else ["bench", str(grains)]
            done = subprocess.run([sys.executable, str(folder / file), *arguments], capture_output=True, text=True)
            match = re.search(pattern, done.stdout)
            if match:
                found[name] = float(match.group(1))
    limit = _probe(folder / PROBE, grains)
    if limit is not None:
        found["limit"] = limit
    for name, ns in found.items():
        print(json.dumps({"case": "bench_field", "yardstick": name, "grains": grains, "ns": ns}), flush=True)
    return found


def _probe(source: Path, grains: int) -> float | None:
    """ns per grain and substep of a hand-written loop for this processor; None where it cannot be built."""
    compiler = shutil.which("g++") or shutil.which("clang++")
    if not source.is_file() or compiler is None:
        return None
    with tempfile.TemporaryDirectory() as folder:
        built = Path(folder) / "probe"
        options = ["-O3", "-march=native", "-ffast-math", "-std=c++17", str(source), "-o", str(built)]
        if subprocess.run([compiler, *options], capture_output=True).returncode != 0:
            return None
        done = subprocess.run([str(built), str(grains)], capture_output=True, text=True)
    match = re.search(PROBE_SPEED, done.stdout)
    return 1e3 / float(match.group(1)) if match else None
