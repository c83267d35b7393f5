"""`robosim bench`: how fast field, coupling, kinematics, environments and rendering are, and the README's table of it.

Each figure is the median of repeated runs in a process of its own; one measurement:
`python -m robosim.benchmarks.bench WHAT CORE`.
"""

import json
import os
import re
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from robosim.config.output import OutputFolder, replaced
from robosim.envs import TASKS
from robosim.errors import ConfigError, UnknownName
from robosim.reports.jobs import pin_to_core, run_jobs
from robosim.reports.provenance import provenance

REPEATS = 5
MARKS = ("<!-- bench -->", "<!-- /bench -->")
"""Around the table in a README."""


def median(work: Callable[[], object], repeats: int = REPEATS) -> float:
    """Median seconds of some work, after a first time that is not counted."""
    taken = []
    for _ in range(repeats + 1):
        begin = time.perf_counter()
        work()
        taken.append(time.perf_counter() - begin)
    return statistics.median(taken[1:])


def coupling() -> dict[str, float]:
    """A free box of 10 g on a tray of sand: a coupled step, and the field's share of it."""
    from robosim.verification.stability.coupled import scene

    plugin = scene(0.01, 2e-3, "mobility", half=0.01, lift=0.0, bed=(0.08, 0.08, 0.0208), dt=1e-4)
    for _ in range(50):
        plugin.step()
    whole = median(lambda: [plugin.step() for _ in range(50)]) / 50
    field = median(lambda: [plugin.solver.advance(2e-3) for _ in range(50)]) / 50
    return {"coupled step of 2 ms [ms]": 1e3 * whole, "of it coupling and MuJoCo [ms]": 1e3 * (whole - field)}


def kinematics() -> dict[str, float]:
    """Poses of the arm, solved from mid-range to 1e-6."""
    from robosim.verification.cases.robot.ik_poses import measure

    record = measure(poses=500)
    return {"inverse kinematics, mean [ms]": record.readings["mean_ms"],
            "inverse kinematics, 95 % below [ms]": record.readings["p95_ms"],
            "poses solved [%]": 100 * (1 - record.errors["failed"])}


def environment(name: str, arm: bool = False) -> dict[str, float]:
    """An episode of the scripted policy."""
    from robosim.envs.grain_env import GrainEnv
    from robosim.evaluation.policies import ScriptedPolicy

    env = GrainEnv(task=name, arm=arm)

    def episode() -> None:
        env.reset(options={"nominal": True})
        act, over = ScriptedPolicy(env), False
        while not over:
            _, _, terminated, truncated, _ = env.step(act())
            over = terminated or truncated

    seconds = median(episode, 1 if arm else 3)
    return {f"{name}{', whole arm' if arm else ''}: steps of 2 ms a second": env.task.steps / seconds}


def side_by_side(name: str = "SpoonTranslate", n: int = 8) -> dict[str, float]:
    """Actions of n environments in a process for each core, against those of one alone."""
    import numpy as np

    from robosim.envs.batch import GrainBatch
    from robosim.envs.vector import GrainVectorEnv

    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, range(os.cpu_count() or 1))

    def rate(vector: GrainVectorEnv) -> float:
        vector.reset(seed=0)
        still = np.zeros((vector.num_envs, *(vector.single_action_space.shape or ())), np.float32)
        seconds = median(lambda: [vector.step(still) for _ in range(20)])
        vector.close()
        return 200 * vector.num_envs / seconds

    alone, together = rate(GrainVectorEnv(name, 1, workers=1)), rate(GrainVectorEnv(name, n))
    return {f"{n} x {name} on {os.cpu_count()} cores: steps of 2 ms a second": together,
            "the same, of one alone": together / alone,
            "memory of one more [MB]": GrainBatch(name, 1).batch.bytes_each / 1e6}


def rendering() -> dict[str, float]:
    """Frames of a sub-task at the size of its pictures."""
    from robosim.envs.grain_env import GrainEnv

    env = GrainEnv(render_mode="rgb_array", task="SpoonScoop")
    env.reset(seed=0)
    env.render()
    return {"frames of 2880 grains a second": 10 / median(lambda: [env.render() for _ in range(10)])}


PARTS: dict[str, Callable[[], dict[str, float]]] = {
    "coupling": coupling, "kinematics": kinematics, "rendering": rendering,
    **{name: lambda name=name: environment(name) for name in TASKS}, "side_by_side": side_by_side,
    **{f"arm_{name}": lambda name=name: environment(name, arm=True) for name in TASKS},
}


def bench(parts: list[str], out: Path | None, readme: Path | None) -> int:
    """Measure parts (all when the list is empty), print a table, write bench.json; with `readme` put the table between
    its marks. Returns 0, or 1 where a part could not be measured."""
    for part in parts:
        if part not in PARTS:
            also = "field by itself" if part != "field" else "field is measured by itself, without other parts"
            raise UnknownName("part", part, PARTS, also)
    if readme is not None and not all(mark in readme.read_text() for mark in MARKS):
        raise ConfigError(f"{readme}: has no {' ... '.join(MARKS)}, between which the table goes")
    folder = OutputFolder(out) if out else None
    names, figures, failures = parts or list(PARTS), {}, {}
    result = {"made_by": provenance(), "figures": figures, "not_measured": failures}
    for place, found, failed in run_jobs([("robosim.benchmarks.bench", (name,)) for name in names], 1):
        figures |= found or {}
        if found is None:
            failures[names[place]] = failed
        for name, figure in (found or {}).items():
            print(f"{name:52} {figure:10.3g}", flush=True)
        if folder is not None:
            folder.write_json("bench.json", result)
    for name, reason in failures.items():
        print(f"{name}: not measured: {reason}", file=sys.stderr)
    if readme is not None:
        put_table(readme, result)
    return int(bool(failures))


def put_table(readme: Path, result: dict[str, Any]) -> None:
    """The figures as a table between the marks of a README."""
    told = result["made_by"]
    rows = "\n".join(f"| {name} | {figure:.3g} |" for name, figure in result["figures"].items())
    table = f"{MARKS[0]}\n| on one core of {told['machine']} | |\n|---|---|\n{rows}\n{MARKS[1]}"
    text = re.sub(f"{MARKS[0]}.*?{MARKS[1]}", lambda _: table, readme.read_text(), flags=re.DOTALL)
    replaced(readme, lambda path: path.write_text(text))


def main() -> None:
    """One part."""
    import mpm

    name, core = sys.argv[1:]
    pin_to_core(core)
    mpm.init()
    print(json.dumps(PARTS[name]()))


if __name__ == "__main__":
    main()
