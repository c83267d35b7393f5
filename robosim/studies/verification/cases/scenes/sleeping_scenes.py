"""Rehearsals and episodes with grains that sleep, against the same awake."""

from typing import Any

import numpy as np

from robosim.config.rehearsal import load_rehearsal
from robosim.envs import TASKS
from robosim.envs.grain_env import GrainEnv
from robosim.episode.play import play
from robosim.planning.plan import plan_motion
from robosim.planning.recorded_motions import place_target
from robosim.rehearsal.metrics import compute_figures
from robosim.rehearsal.run import RehearsalRun
from robosim.studies.policies.script import ScriptedPolicy
from robosim.studies.verification.cases.case import Cost, Record, TimedSolver, case, grid, make_record
from robosim.studies.verification.cases.expectations import Within
from robosim.tasks.task import load_task

Outcome = tuple[Cost, dict[str, float]]
"""What a scene cost, and its readings."""


def rehearse(name: str, sleep: float) -> Outcome:
    """Run a rehearsal."""
    config = place_target(load_rehearsal(name))
    config = config.model_copy(update={"field": config.field.model_copy(update={"sleep": sleep or False})})
    run = RehearsalRun(plan_motion(config))
    timed = TimedSolver(run.solver)
    timed.run(lambda: run.run(lambda: None))
    figures = compute_figures(run)
    names = {"mass": "scooped_mass_kg", "unaccounted": "momentum_residual", "delivered": "delivered_fraction",
             "awake": "awake_share"}
    values = {name: figures[figure] for name, figure in names.items()}
    readings = {name: float(value) if isinstance(value, int | float) else np.nan for name, value in values.items()}
    return timed.cost._replace(seconds=run.wall_time), readings


def play_task(task: str, sleep: float) -> Outcome:
    """Run an episode with the task's script, from the nominal start."""
    config = load_task(task)
    config = config.model_copy(update={"field": config.field.model_copy(update={"sleep": sleep or False})})
    env, shares, info = GrainEnv(task=config), list[float](), dict[str, Any]()
    timed = TimedSolver(env.solver)
    env.reset(seed=0, options={"nominal": True})
    timed.run(lambda: info.update(play(env, ScriptedPolicy(env), observation=env.observation, hooks=[
        lambda _: shares.append(float(env.solver.awake.mean()))])[1]))
    cost = timed.cost
    env.close()
    return cost, {"score": float(info["tcs"]), "awake": float(np.mean(shares))}


@case(
    source="the same scene without sleeping",
    sweep=grid(scene=("spoon", "SpoonScoop", "ScoopScoop", "ShovelMove"), sleep=(0.25, 1.0, 4.0)),
    quick=[{"scene": "SpoonScoop", "sleep": 1.0}],
    # mass that a rehearsal's tool lifts; an episode's score, of 44 at most; momentum that the rehearsal's ledger lacks,
    # of what was exchanged
    expectations=(Within("mass", 0.005, {"scene": "spoon", "sleep": 1.0}),
                  *(Within("score", 0.5, {"scene": scene, "sleep": 1.0})
                    for scene in ("SpoonScoop", "ScoopScoop", "ShovelMove")),
                  Within("unaccounted", 1e-5, {"scene": "spoon"})),
    main_error="change", resolution="sleep", units={"score": "points"})
def sleeping_scenes(*, scene: str = "SpoonScoop", sleep: float = 1.0) -> Record:
    """Rehearsals and episodes with grains that sleep, against the same awake: what sleeping costs and saves in use.

    Scenes: a rehearsal of configs/rehearsals, or an episode of a sub-task with its script, from the nominal start. The
    reference, with field.sleep = false, is run in the same process. The error "change" is that of the mass or of the
    score, relative. sleep: factor on the thresholds."""
    run = play_task if scene in TASKS else rehearse
    (awake, before), (asleep, after) = run(scene, 0.0), run(scene, sleep)
    if "score" in after:
        errors = {"score": after["score"] - before["score"], "change": after["score"] / before["score"] - 1.0}
    else:
        lost = after["mass"] / before["mass"] - 1.0
        errors = {"mass": lost, "change": lost, "delivered": after["delivered"] - before["delivered"],
                  "unaccounted": after["unaccounted"]}
    return make_record([asleep], errors, speedup=awake.seconds / asleep.seconds, seconds_awake=awake.seconds,
                       awake_share=after["awake"], **{f"{name} awake": value for name, value in before.items()})

