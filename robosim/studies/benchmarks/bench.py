"""`robosim bench`: speed of coupling, kinematics, environments and rendering.
Each figure is the median of repeated runs in a process of its own."""

import os
import statistics
import sys
import timeit
from collections.abc import Callable
from functools import partial
from importlib.metadata import entry_points
from pathlib import Path

import numpy as np

import mpm
from robosim.base.digests import code_digest
from robosim.base.errors import UnknownName
from robosim.base.output_folder import OutputFolder
from robosim.base.provenance import provenance
from robosim.base.study import Job, Study
from robosim.envs import TASKS
from robosim.envs.batch import GrainBatch
from robosim.envs.grain_env import GrainEnv
from robosim.envs.vector import GrainVectorEnv
from robosim.episode.play import play
from robosim.studies.policies.script import ScriptedPolicy
from robosim.studies.verification.cases import find
from robosim.studies.verification.stability.coupled import build_scene


def median_seconds(work: Callable[[], object], repeats: int = 5) -> float:
    """Return the median wall time [s] of calls, after a first one that is not timed."""
    return statistics.median(timeit.repeat(work, number=1, repeat=repeats + 1)[1:])


def measure_coupling() -> dict[str, float]:
    """Time a coupled step of a free box of 10 g on a tray of sand, and the part outside the field."""
    plugin = build_scene(0.01, 2e-3, "mobility", half=0.01, lift=0.0, bed=(0.08, 0.08, 0.0208))
    for _ in range(50):
        plugin.step()
    whole = median_seconds(lambda: [plugin.step() for _ in range(50)]) / 50
    field = median_seconds(lambda: [plugin.solver.advance(2e-3) for _ in range(50)]) / 50
    return {"coupled step of 2 ms [ms]": 1e3 * whole, "part of it outside the field [ms]": 1e3 * (whole - field)}


def measure_kinematics() -> dict[str, float]:
    """Time the inverse kinematics of poses of the arm, from mid-range to 1e-6."""
    record = find("ik_poses")(poses=500)
    return {"inverse kinematics, mean [ms]": record.readings["mean_ms"],
            "inverse kinematics, 95th percentile [ms]": record.readings["p95_ms"],
            "poses solved [%]": 100 * (1 - record.errors["failed"])}


def measure_environment(name: str, arm: bool = False) -> dict[str, float]:
    """Time an episode of the scripted policy; arm: with the whole arm."""
    env = GrainEnv(task=name, arm=arm)

    def episode() -> None:
        observation, _ = env.reset(options={"nominal": True})
        play(env, ScriptedPolicy(env), observation=observation)

    seconds = median_seconds(episode, 1 if arm else 3)
    return {f"{name}{', whole arm' if arm else ''}: steps of 2 ms per second": env.task.steps / seconds}


def measure_side_by_side(name: str = "SpoonTranslate", n: int = 8) -> dict[str, float]:
    """Time n environments with a process for each core, and one alone."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, range(os.cpu_count() or 1))

    def rate(vector: GrainVectorEnv) -> float:
        vector.reset(seed=0)
        still = np.zeros((vector.num_envs, *(vector.single_action_space.shape or ())), np.float32)
        seconds = median_seconds(lambda: [vector.step(still) for _ in range(20)])
        vector.close()
        return 200 * vector.num_envs / seconds

    alone, together = rate(GrainVectorEnv(name, 1, workers=1)), rate(GrainVectorEnv(name, n))
    return {f"{n} x {name} on {os.cpu_count()} cores: steps of 2 ms per second": together,
            "speed-up over one environment alone": together / alone,
            "memory of one more environment [MB]": GrainBatch(name, 1).batch.bytes_each / 1e6}


def measure_rendering() -> dict[str, float]:
    """Time pictures of a sub-task."""
    env = GrainEnv(render_mode="rgb_array", task="SpoonScoop")
    env.reset(seed=0)
    env.render()
    return {"frames of 2880 grains per second": 10 / median_seconds(lambda: [env.render() for _ in range(10)])}


PARTS: dict[str, Callable[[], dict[str, float]]] = {
    "coupling": measure_coupling, "kinematics": measure_kinematics, "rendering": measure_rendering,
    **{name: partial(measure_environment, name) for name in TASKS}, "side_by_side": measure_side_by_side,
    **{f"arm_{name}": partial(measure_environment, name, arm=True) for name in TASKS},
}
DEFAULT_PARTS = list(PARTS)
"""What is measured where no part is named; other packages' parts are asked for by name."""
PARTS |= {entry.name: lambda entry=entry: entry.load()() for entry in entry_points(group="robosim.benchmarks")}


def bench(parts: list[str], out: Path | None) -> int:
    """Measure parts, all when the list is empty; print the figures and write bench.json.
    Returns 0, or 1 where a part could not be measured. Raises UnknownName for a part that does not exist."""
    for part in parts:
        if part not in PARTS:
            also = "field by itself" if part != "field" else "field is measured by itself, without other parts"
            raise UnknownName("part", part, PARTS, also)
    folder = OutputFolder(out) if out else None
    names, figures, failures = parts or DEFAULT_PARTS, {}, {}
    result = {"made_by": provenance(), "code": code_digest(__name__), "figures": figures, "not_measured": failures}
    work = [Job("robosim.studies.benchmarks.bench:measure_part", {"name": name}) for name in names]
    for index, (_, measured, reason) in Study(None).run(work):  # times are those of today
        figures |= measured or {}
        if measured is None:
            failures[names[index]] = reason
        for name, figure in (measured or {}).items():
            print(f"{name:52} {figure:10.3g}", flush=True)
        if folder is not None:
            folder.write_json("bench.json", result)
    for name, reason in failures.items():
        print(f"{name}: not measured: {reason}", file=sys.stderr)
    return int(bool(failures))


def measure_part(name: str) -> dict[str, float]:
    """Measure one part; return its figures."""
    mpm.init()
    return PARTS[name]()
