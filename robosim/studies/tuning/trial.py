"""Episodes of one choice of numbers, a job of a study; each is stored as it ends."""

from pathlib import Path
from typing import Any

from robosim.base.digests import code_digest, digest
from robosim.base.study import Store
from robosim.dosing.command import accepted_error
from robosim.dosing.numbers import DosingNumbers
from robosim.envs.grain_env import GrainEnv
from robosim.episode.play import play
from robosim.studies.evaluation.dosing_policy import TERMS, DosingPolicy
from robosim.studies.evaluation.suites import Start, make_environment
from robosim.tasks.task import load_task


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
        env = make_environment(load_task(search["task"]), start, obs=list(TERMS))
        for one in missing:
            row = play_dose(env, search["controller"], DosingNumbers.model_validate(numbers), one)
            store.keep(keys[one], row)
            rows[one] = (row,)
        env.close()
    return [row[0] for row in rows.values() if row is not None]
