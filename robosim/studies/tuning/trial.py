"""Episodes of one choice of numbers, in a process of its own.

`python -m robosim.studies.tuning.trial JOB CORE`: JOB is a `TrialJob` as JSON. Each episode is written to the file of
episodes as it ends; those that are there are not run again. Prints all of them as JSON.
"""

import contextlib
import json
import sys
from pathlib import Path
from typing import Any, NamedTuple

from robosim.base.files import write_json
from robosim.base.input_files import read_json
from robosim.base.jobs import pin_to_core
from robosim.dosing.command import accepted_error
from robosim.dosing.numbers import DosingNumbers, load_dosing
from robosim.envs.grain_env import GrainEnv
from robosim.studies.evaluation.dosing_policy import TERMS, DosingPolicy
from robosim.studies.evaluation.suites import Start, make_environment
from robosim.tasks.task import load_task


class TrialJob(NamedTuple):
    """What a process runs."""

    task: str
    controller: str
    numbers: str
    """File with the numbers."""
    episodes: str
    """File that the episodes are written to."""
    seed: int
    """Of the first episode."""
    count: int
    material: str
    randomize: str
    """Preset of what the seeds draw."""


def run_episode(env: GrainEnv, controller: str, numbers: DosingNumbers, seed: int) -> dict[str, Any]:
    """Run one dose; return its figures."""
    env.reset(seed=seed)
    policy, over, info = DosingPolicy(controller, env, numbers), False, {}
    while not over:
        _, _, terminated, truncated, info = env.step(policy())
        over = terminated or truncated
    readings, dose = info["readings"], env.task.dose
    assert dose is not None
    accepted = accepted_error(readings["target_mass"], dose.tolerance_percent, dose.tolerance_g)
    return {"seed": seed, "is_success": bool(info["is_success"]), "diverged": info.get("diverged") or "",
            "accepted_error": float(accepted),
            **{name: float(readings[name]) for name in
               ("target_mass", "poured", "dose_error", "overshoot", "seconds", "spilled")}}


def run_trial(job: TrialJob) -> list[dict[str, Any]]:
    """Run the episodes that the file does not have, and return all."""
    path, numbers = Path(job.episodes), load_dosing(job.numbers)
    rows: list[dict[str, Any]] = read_json(path) if path.is_file() else []
    missing = [job.seed + k for k in range(job.count) if job.seed + k not in {row["seed"] for row in rows}]
    if missing:
        start = Start(missing[0], job.material, randomize=job.randomize)
        env = make_environment(load_task(job.task), start, obs=list(TERMS))
        for seed in missing:
            rows.append(run_episode(env, job.controller, numbers, seed))
            write_json(path, rows)
        env.close()
    return rows


def main() -> None:
    """Run the job and print its episodes."""
    text, core = sys.argv[1:]
    pin_to_core(core)
    with contextlib.redirect_stdout(sys.stderr):
        rows = run_trial(TrialJob(**json.loads(text)))
    print(json.dumps(rows))


if __name__ == "__main__":
    main()
