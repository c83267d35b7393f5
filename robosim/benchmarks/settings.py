"""A scene at one setting: what it reads, what it costs, what it is made of. In a process of its own:
`python -m robosim.benchmarks.settings SCENE SETTING CORE`."""

import json
import sys
import time
from typing import Any

import numpy as np

import mpm
from robosim.benchmarks.compiled import parts
from robosim.benchmarks.stopwatch import Stopwatch
from robosim.config.materials import MaterialConfig, load_material, overridden
from robosim.config.rehearsal import load_rehearsal
from robosim.reports.jobs import pin_to_core
from robosim.tasks.task import is_task, load_task

FRACTIONS = ("delivered", "spilled", "retained")
"""Readings that are shares of the grains: their errors are differences, those of all others are relative."""


def measured(scene: str, setting: dict[str, float]) -> dict[str, Any]:
    """Readings, seconds, simulated seconds, parts and costs of a sub-task or a rehearsal; setting: factors on "cell",
    "grains_per_cell", "E" and "dt" of the scene's own."""
    mpm.init()
    return of_task(scene, setting) if is_task(scene) else of_rehearsal(scene, setting)


def told(solver: mpm.Solver, watch: Stopwatch, seconds: float, simulated: float, readings: dict[str, float]) -> dict:
    """The answer of a process."""
    costs = {name: value / simulated for name, value in sorted(watch.seconds.items(), key=lambda item: -item[1])}
    costs["everything else"] = (seconds - sum(watch.seconds.values())) / simulated
    return {"readings": {k: float(v) for k, v in readings.items()}, "seconds": seconds, "simulated": simulated,
            "grains": sum(solver.particles.counts), "cell": solver.grid.cell, "dt": solver.dt, "costs": costs,
            "parts": [part._asdict() for part in parts(solver)]}


def softened(material: MaterialConfig, setting: dict[str, float]) -> dict[str, float]:
    """Young's modulus by a setting, where it has a factor for it."""
    return {"E": getattr(material, "E").value * setting["E"]} if "E" in setting else {}  # noqa: B009  (not every law)


def of_task(name: str, setting: dict[str, float]) -> dict[str, Any]:
    """An episode of the scripted policy, the tool alone."""
    from robosim.envs.grain_env import GrainEnv
    from robosim.evaluation.policies import ScriptedPolicy

    task = load_task(name)
    dt = task.field.dt and task.step_dt / max(1, round(task.step_dt / (task.field.dt * setting.get("dt", 1.0))))
    field = task.field.model_copy(update={"cell": task.field.cell * setting.get("cell", 1.0), "dt": dt})
    material = load_material(task.material)
    numbers: dict[str, Any] = dict(softened(material, setting))
    env = GrainEnv(task=task.model_copy(update={"field": field}), **numbers)
    env.reset(options={"nominal": True})
    env.solver.compile()
    watch = Stopwatch()
    watch.watch(env.solver, "advance", "field")
    watch.watch(env.reward, "step", "reward")
    watch.watch(env.world.observer, "read", "observation")
    act, over, impulses, begin, info = ScriptedPolicy(env), False, [], time.perf_counter(), {}
    while not over:
        _, _, terminated, truncated, info = env.step(act())
        impulses.append(np.linalg.norm(env.solver.ledger[2, :3]))
        over = terminated or truncated
    seconds = time.perf_counter() - begin
    force = float(np.mean(impulses)) / (env.action_repeat * task.step_dt)
    weight = 9.81 * float(env.solver.masses().sum())  # as many grains on coarser cells weigh more
    readings = {k: info["readings"][k] for k in FRACTIONS} | {"tool_force_over_weight": force / weight}
    return told(env.solver, watch, seconds, task.steps * task.step_dt, readings)


def of_rehearsal(name: str, setting: dict[str, float]) -> dict[str, Any]:
    """A whole-arm rehearsal without film."""
    from robosim.rehearsal.learned import placed
    from robosim.rehearsal.metrics import figures
    from robosim.rehearsal.rehearsal import Rehearsal, plan

    config = placed(load_rehearsal(name))
    cell = config.field.cell * setting.get("cell", 1.0)
    field = config.field.model_copy(update={"cell": cell, "grains_per_cell": config.field.grains_per_cell
                                            * setting.get("grains_per_cell", 1.0)})
    wall = float(np.clip(config.collision_thickness, 0.5 * cell, cell))
    config = config.model_copy(update={"field": field, "collision_thickness": wall})
    material = load_material(config.material)
    material = overridden(material, softened(material, setting))
    run = Rehearsal(config, plan(config), material=material)
    run.solver.compile()
    watch = Stopwatch()
    watch.watch(run.solver, "advance", "field")
    watch.watch(run.plugin, "step", "coupling, with MuJoCo's step")
    watch.watch(run.servo, "compute_torque", "servo")
    run.run(lambda: None)
    values = figures(run)
    names = {"scooped_mass": "scooped_mass", "wrist_payload": "wrist_payload", "delivered": "delivered_fraction",
             "spilled": "spilled_fraction"}
    readings = {name: float(values[key]) for name, key in names.items()  # pyright: ignore[reportArgumentType]
                if key != "wrist_payload" or config.weigh_at is not None}  # a shovel weighs nothing
    return told(run.solver, watch, run.wall_time, run.time, readings)


def main() -> None:
    """One setting."""
    scene, setting, core = sys.argv[1:]
    pin_to_core(core)
    print(json.dumps(measured(scene, json.loads(setting))))


if __name__ == "__main__":
    main()
