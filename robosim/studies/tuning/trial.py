"""Episodes of one choice of numbers, a job of a study; what they cost a search, and their figures."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from robosim.base.digests import code_digest, digest
from robosim.base.study import Store
from robosim.dosing.command import accepted_error
from robosim.dosing.numbers import DosingNumbers
from robosim.envs.grain_env import GrainEnv
from robosim.episode.play import play
from robosim.studies.policies.dosing import DosingPolicy
from robosim.studies.policies.suites import Start, make_environment
from robosim.studies.policies.tool_view import terms_of
from robosim.tasks.task import load_task

WORST = 5.0
"""Largest cost of an error: a dose that is five times out of bounds is as bad as none."""
TIME_WEIGHT = 0.5
"""Cost of a dose that takes all of the time."""


def episode_cost(row: dict[str, Any], duration: float) -> float:
    """Return the cost of an episode: error and spilled mass in accepted errors, and a part for its time.
    row: of `robosim.studies.tuning.trial`. duration: longest time of a dose [s]."""
    if row["diverged"]:
        return 2.0 * WORST + TIME_WEIGHT
    accepted = row["accepted_error"]
    error, spilled = (min(abs(row[name]) / accepted, WORST) if accepted > 0.0 else WORST * (row[name] != 0.0)
                      for name in ("dose_error", "spilled"))
    return error + spilled + TIME_WEIGHT * min(1.0, row["seconds"] / duration)


def summarize_doses(rows: Sequence[dict[str, Any]], duration: float) -> dict[str, float]:
    """Return cost, success rate, mean and standard deviation of the error [g], mean time [s] and spilled mass [g]."""
    errors = np.array([row["dose_error"] for row in rows]) * 1e3
    return {"cost": float(np.mean([episode_cost(row, duration) for row in rows])),
            "success_rate": float(np.mean([row["is_success"] for row in rows])), "error_g": float(errors.mean()),
            "error_g_std": float(errors.std()), "error_g_abs": float(np.abs(errors).mean()),
            "seconds": float(np.mean([row["seconds"] for row in rows])),
            "spilled_g": 1e3 * float(np.mean([row["spilled"] for row in rows]))}


def play_dose(env: GrainEnv, controller: str, numbers: DosingNumbers, seed: int) -> dict[str, Any]:
    """Play one dose; return its figures."""
    _, info = play(env, DosingPolicy(controller, env, numbers), seed=seed)
    readings, dose = info["readings"], env.task.dose
    assert dose is not None
    accepted = accepted_error(readings["target_mass"], dose.tolerance_percent, dose.tolerance_g)
    return {"seed": seed, "is_success": bool(info["is_success"]), "diverged": info.get("diverged") or "",
            "accepted_error": float(accepted),
            **{name: float(readings[name]) for name in
               ("target_mass", "poured", "dose_error", "overshoot", "seconds", "spilled")}}


def run_trial(search: dict[str, Any], numbers: dict[str, Any], seed: int, count: int, folder: str
              ) -> list[dict[str, Any]]:
    """Return the episodes of one choice of numbers with the seeds from `seed` on, stored in a folder or run now.
    search: task, controller, material, randomize (preset of what the seeds draw), and what else tells it from others.
    """
    store, code = Store(Path(folder)), code_digest(__name__)
    keys = {one: digest([search, numbers, one, code]) for one in range(seed, seed + count)}
    rows = {one: store.find(key) for one, key in keys.items()}
    missing = [one for one, row in rows.items() if row is None]
    if missing:
        start = Start(missing[0], search["material"], randomize=search["randomize"])
        task = load_task(search["task"])
        env = make_environment(task, start, obs=list(terms_of(task)))
        for one in missing:
            row = play_dose(env, search["controller"], DosingNumbers.model_validate(numbers), one)
            store.keep(keys[one], row)
            rows[one] = (row,)
        env.close()
    return [row[0] for row in rows.values() if row is not None]
