"""Rehearsals and episodes with grains that sleep, against the same awake: what sleeping costs and saves in use.

Scenes: a rehearsal of configs/rehearsals, or an episode of a sub-task with its script, from the nominal start.
Reference: the same scene with field.sleep = false, run in the same process.
"""

import time
from typing import Any

import numpy as np

import mpm
from robosim.config.rehearsal import load_rehearsal
from robosim.envs import TASKS
from robosim.envs.grain_env import GrainEnv
from robosim.planning.learned_motions import place_target
from robosim.planning.plan import plan_motion
from robosim.rehearsal.metrics import compute_figures
from robosim.rehearsal.run import RehearsalRun
from robosim.studies.evaluation.policies import make_policy
from robosim.studies.verification.cases.case import Cost, Record, case, grid, make_record
from robosim.studies.verification.cases.expectations import Within
from robosim.tasks.task import load_task


class Outcome:
    """What a scene came to: its readings, and what they cost."""

    def __init__(self, solver: mpm.Solver) -> None:
        self.particles, self.steps = sum(solver.particles.counts), 0
        self.readings, self.seconds = dict[str, float](), 0.0
        began = time.perf_counter()
        solver.compile()
        self.compile_seconds = time.perf_counter() - began


def rehearse(name: str, sleep: float) -> Outcome:
    """Run a rehearsal."""
    config = place_target(load_rehearsal(name))
    config = config.model_copy(update={"field": config.field.model_copy(update={"sleep": sleep or False})})
    run = RehearsalRun(plan_motion(config))
    outcome = Outcome(run.solver)
    run.run(lambda: None)
    figures = compute_figures(run)
    outcome.seconds, outcome.steps = run.wall_time, run.solver.steps
    names = {"mass": "scooped_mass_kg", "unaccounted": "momentum_residual", "delivered": "delivered_fraction",
             "awake": "awake_share"}
    outcome.readings = {name: _number(figures[figure]) for name, figure in names.items()}
    return outcome


def play(task: str, sleep: float) -> Outcome:
    """Run an episode with the task's script, from the nominal start."""
    config = load_task(task)
    config = config.model_copy(update={"field": config.field.model_copy(update={"sleep": sleep or False})})
    env, shares, info, over = GrainEnv(task=config), list[float](), dict[str, Any](), False
    outcome = Outcome(env.solver)
    env.reset(seed=0, options={"nominal": True})
    policy = make_policy("scripted", env, 0)
    while not over:
        action = policy(env.observation)
        began = time.perf_counter()
        _, _, terminated, truncated, info = env.step(action)
        outcome.seconds += time.perf_counter() - began
        shares.append(float(env.solver.awake.mean()))
        over = terminated or truncated
    outcome.readings = {"score": float(info["tcs"]), "awake": float(np.mean(shares))}
    outcome.steps = env.solver.steps
    env.close()
    return outcome


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
def measure(*, scene: str = "SpoonScoop", sleep: float = 1.0) -> Record:
    """Run a scene awake and with sleeping; return the errors of its readings. sleep: factor on the thresholds.

    The error "change" is that of the mass or of the score, relative.
    """
    run = play if scene in TASKS else rehearse
    awake, asleep = run(scene, 0.0), run(scene, sleep)
    before, after = awake.readings, asleep.readings
    if "score" in after:
        errors = {"score": after["score"] - before["score"], "change": after["score"] / before["score"] - 1.0}
    else:
        lost = after["mass"] / before["mass"] - 1.0
        errors = {"mass": lost, "change": lost, "delivered": after["delivered"] - before["delivered"],
                  "unaccounted": after["unaccounted"]}
    cost = Cost(asleep.particles, asleep.steps, asleep.seconds, asleep.compile_seconds)
    return make_record([cost], errors, {
        "speedup": awake.seconds / asleep.seconds, "seconds_awake": awake.seconds, "awake_share": after["awake"],
        **{f"{name} awake": value for name, value in before.items()}})


def _number(value: object) -> float:
    """Return a figure of a report as a number, NaN where there is none."""
    return float(value) if isinstance(value, int | float) else float("nan")
