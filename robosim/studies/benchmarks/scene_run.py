"""One run of a scene at a setting, a job of a study: its readings, its cost and its parts."""

import time
from typing import Any

import numpy as np

import mpm
from robosim.config.materials import MaterialConfig, load_material, overridden
from robosim.config.rehearsal import load_rehearsal
from robosim.envs.grain_env import GrainEnv
from robosim.episode.play import play
from robosim.planning.learned_motions import place_target
from robosim.planning.plan import plan_motion
from robosim.rehearsal.metrics import compute_figures
from robosim.rehearsal.run import RehearsalRun
from robosim.studies.benchmarks.scene_parts import Stopwatch, list_parts
from robosim.studies.evaluation.policies import ScriptedPolicy
from robosim.tasks.task import is_task, load_task

DOSED = ("poured", "spilled", "held")
"""Masses of a dosing task, whose shares of the load are read."""
FRACTIONS = ("delivered", "spilled", "retained", *DOSED)
"""Readings that are shares of the grains: their errors are differences, all others' are relative."""


def measure_scene(scene: str, setting: dict[str, float]) -> dict[str, Any]:
    """Run a sub-task or a rehearsal; return readings, seconds, simulated seconds, parts and costs.
    setting: factors on the scene's own "cell", "grains_per_cell", "E" and "dt"."""
    mpm.init()
    return run_task(scene, setting) if is_task(scene) else run_rehearsal(scene, setting)


def make_result(solver: mpm.Solver, stopwatch: Stopwatch, seconds: float, simulated: float,
                readings: dict[str, float]) -> dict[str, Any]:
    """Return the result of a run; costs are seconds per simulated second."""
    costs = {name: value / simulated for name, value in sorted(stopwatch.seconds.items(), key=lambda item: -item[1])}
    costs["everything else"] = (seconds - sum(stopwatch.seconds.values())) / simulated
    return {"readings": {k: float(v) for k, v in readings.items()}, "seconds": seconds, "simulated_s": simulated,
            "grains": sum(solver.particles.counts), "cell_m": solver.grid.cell, "dt_s": solver.dt, "costs": costs,
            "parts": [part._asdict() for part in list_parts(solver)]}


def scaled_stiffness(material: MaterialConfig, setting: dict[str, float]) -> dict[str, float]:
    """Return {"E": Young's modulus [Pa]} scaled by a setting; nothing where it has no factor for it."""
    return {"E": getattr(material, "E").value * setting["E"]} if "E" in setting else {}  # noqa: B009  (not every law)


def run_task(name: str, setting: dict[str, float]) -> dict[str, Any]:
    """Run an episode of the scripted policy, without the arm."""
    task = load_task(name)
    dt = task.field.dt and task.step_dt / max(1, round(task.step_dt / (task.field.dt * setting.get("dt", 1.0))))
    field = task.field.model_copy(update={"cell": task.field.cell * setting.get("cell", 1.0), "dt": dt})
    numbers: dict[str, Any] = dict(scaled_stiffness(load_material(task.material), setting))
    env = GrainEnv(task=task.model_copy(update={"field": field}), **numbers)
    observation, _ = env.reset(options={"nominal": True})
    env.solver.compile()
    stopwatch = Stopwatch()
    stopwatch.wrap(env.solver, "advance", "field")
    stopwatch.wrap(env.reward, "step", "reward")
    stopwatch.wrap(env.world.observer, "read", "observation")
    policy, impulses, begin = ScriptedPolicy(env), [], time.perf_counter()
    _, info = play(env, policy, observation=observation,
                   hooks=[lambda step: impulses.append(np.linalg.norm(env.solver.ledger[2, :3]))])
    seconds = time.perf_counter() - begin
    force = float(np.mean(impulses)) / (env.action_repeat * task.step_dt)
    load = float(env.solver.masses().sum())  # the same number of grains weighs more on coarser cells
    readings = {k: info["readings"][k] for k in FRACTIONS[:3]} if task.dose is None else \
        {k: info["readings"][k] / load for k in DOSED}
    return make_result(env.solver, stopwatch, seconds, env.episode.time,
                       readings | {"tool_force_over_weight": force / (9.81 * load)})


def run_rehearsal(name: str, setting: dict[str, float]) -> dict[str, Any]:
    """Run a rehearsal with the whole arm, without film."""
    config = place_target(load_rehearsal(name))
    cell = config.field.cell * setting.get("cell", 1.0)
    field = config.field.model_copy(update={"cell": cell, "grains_per_cell": config.field.grains_per_cell
                                            * setting.get("grains_per_cell", 1.0)})
    wall = "shell" if config.tool_wall == "shell" else float(np.clip(config.solid_wall, 0.5 * cell, cell))
    config = config.model_copy(update={"field": field, "tool_wall": wall})
    material = load_material(config.material)
    material = overridden(material, scaled_stiffness(material, setting))
    run = RehearsalRun(plan_motion(config), material=material)
    run.solver.compile()
    stopwatch = Stopwatch()
    stopwatch.wrap(run.solver, "advance", "field")
    stopwatch.wrap(run.cell.plugin, "step", "coupling, with MuJoCo's step")
    stopwatch.wrap(run.cell.servo, "compute_torque", "servo")
    run.run(lambda: None)
    figures = compute_figures(run)
    names = {"scooped_mass_kg": "scooped_mass_kg", "wrist_payload_kg": "wrist_payload_kg",
             "delivered": "delivered_fraction", "spilled": "spilled_fraction", "dose_kg": "dose_kg"}
    lacking = {"dose_kg"} if config.dose is None else set()
    lacking |= {"wrist_payload_kg"} if config.weigh_at is None else set()  # a shovel does not weigh its load
    readings = {name: float(figures[key])  # pyright: ignore[reportArgumentType]
                for name, key in names.items() if name not in lacking}
    return make_result(run.solver, stopwatch, run.wall_time, run.time, readings)
