"""`robosim tune`: a search of a dosing controller's numbers on training seeds."""

import hashlib
import json
import sys
from pathlib import Path
from typing import Any

from robosim.base.digests import code_digest
from robosim.base.errors import ConfigError
from robosim.base.input_files import read_json
from robosim.base.jobs import run_jobs
from robosim.base.output_folder import OutputFolder, aligned
from robosim.base.progress import Progress
from robosim.base.provenance import provenance
from robosim.dosing.numbers import DosingNumbers
from robosim.envs import task_name
from robosim.studies.evaluation.dosing_policy import numbers_of
from robosim.studies.tuning.choices import GENERATION, draw_choice
from robosim.studies.tuning.cost import summarize_doses
from robosim.studies.tuning.trial import TrialJob
from robosim.tasks.task import load_task

WORKER = "robosim.studies.tuning.trial"
FILE, NUMBERS = "tune.json", "numbers.yaml"
SHOWN = ("cost", "success_rate", "error_g", "error_g_std", "seconds", "spilled_g")
"""Figures that are printed."""


def tune(task: str, controller: str, out: Path, *, choices: int, episodes: int, seed: int = 0, jobs: int = 1,
         material: str | None = None, randomize: str = "nominal") -> int:
    """Search a controller's numbers; write tune.json and the best numbers as numbers.yaml into a folder.

    The first choice are the task's own numbers. choices: in all. episodes: of each, with the seeds from `seed` on.
    jobs: processes. Choices and episodes that the folder has are not run again.
    Returns 0, or 1 where a process failed; the same command then continues.
    Raises ConfigError where the folder has a search with other numbers, arguments or code, and for a task without a
    dose.
    """
    config = load_task(task)
    numbers = numbers_of(config, controller)
    values = {"task": config.model_dump(mode="json", exclude={"description"}), "controller": controller, "seed": seed,
              "numbers": numbers.model_dump(mode="json", exclude={"source"}), "episodes": episodes,
              "material": material or config.material, "randomize": randomize}
    key, made_by = fingerprint(values), provenance()
    head = {"key": key, "made_by": made_by, **values}
    with OutputFolder(out) as folder:
        drawn, rows = read_search(folder.path, key)
        drawn = drawn or [numbers]
        failed: dict[int, str] = {}
        progress = Progress(initial=sum(k < choices for k in rows), total=choices,
                            desc=f"{task_name(task)}, {controller}", unit="choices")
        while not failed and (waiting := _next(choices, rows)):
            costs = {k: summarize_doses(row, numbers.motion.duration)["cost"] for k, row in rows.items()}
            for k in range(len(drawn), waiting[-1] + 1):
                drawn.append(draw_choice(controller, numbers, k, seed, costs, drawn))
            work = []
            for k in waiting:
                file = folder.write_yaml(f"choice_{k}.yaml", drawn[k].model_dump(mode="json"))
                job = TrialJob(task, controller, str(file), str(folder.path / f"episodes_{k}.json"), seed, episodes,
                               values["material"], randomize)
                work.append((WORKER, [json.dumps(job._asdict())]))
            _write(folder, head, drawn, rows, choices)  # what an interrupted choice has done is kept, too
            for index, row, reason in run_jobs(work, jobs):
                if row is None:
                    failed[waiting[index]] = reason
                else:
                    rows[waiting[index]] = row
                    _write(folder, head, drawn, rows, choices)
                    progress.update()
        progress.close()
        if rows:
            best = find_best(rows, numbers.motion.duration)
            table = drawn[best].model_dump(mode="json") | {"source": made_by["command"]}
            folder.write_yaml(NUMBERS, table)
            print(format_search(rows, numbers.motion.duration, best))
    for k, reason in failed.items():
        print(f"failed: choice {k}: {reason}; what is finished is kept, run the same command again to continue",
              file=sys.stderr)
    return 1 if failed else 0


def fingerprint(values: dict[str, Any]) -> str:
    """Return twelve hexadecimal digits that change with the task, the numbers, the episodes and the code."""
    text = json.dumps([values, code_digest(WORKER)], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def read_search(path: Path, key: str) -> tuple[list[DosingNumbers], dict[int, list[dict[str, Any]]]]:
    """Return the choices of a folder and their episodes; none where it has no search.

    Raises ConfigError for a search with another key, or one that cannot be read.
    """
    file = path / FILE
    if not file.is_file():
        for left in [*path.glob("choice_*.yaml"), *path.glob("episodes_*.json")]:
            left.unlink()  # of a search whose tune.json was removed
        return [], {}
    try:
        stored = read_json(file)
        known, choices = stored["key"], stored["choices"]
        drawn = [DosingNumbers.model_validate(one["numbers"]) for one in choices]
        rows = {k: one["episodes"] for k, one in enumerate(choices) if one["episodes"]}
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise ConfigError(f"--out {path}: {FILE} cannot be read ({error}); give another folder") from None
    if known != key:
        raise ConfigError(f"--out {path}: holds a search with other numbers, another task, other episodes or code; "
                          f"give the arguments and files of that search, or another folder")
    return drawn, rows


def find_best(rows: dict[int, list[dict[str, Any]]], duration: float) -> int:
    """Return the choice with the lowest mean cost."""
    return min(rows, key=lambda k: (summarize_doses(rows[k], duration)["cost"], k))


def format_search(rows: dict[int, list[dict[str, Any]]], duration: float, best: int) -> str:
    """Format the given numbers and the best ones for a terminal."""
    lines = [["choice", *SHOWN, "episodes"]]
    for k in dict.fromkeys([min(rows), best]):
        figures = summarize_doses(rows[k], duration)
        label = f"{k}{' (given)' if k == 0 else ''}{' (best)' if k == best else ''}"
        lines.append([label, *(f"{figures[name]:.3g}" for name in SHOWN), str(len(rows[k]))])
    return aligned(lines)


def _next(choices: int, rows: dict[int, list[dict[str, Any]]]) -> list[int]:
    """Return the choices of the first generation that is not finished; none at the end."""
    missing = [k for k in range(choices) if k not in rows]
    return [k for k in missing if (k + GENERATION - 1) // GENERATION == (missing[0] + GENERATION - 1) // GENERATION]


def _write(folder: OutputFolder, values: dict[str, Any], drawn: list[DosingNumbers],
           rows: dict[int, list[dict[str, Any]]], choices: int) -> None:
    """Write tune.json; values: what identifies the search."""
    duration = drawn[0].motion.duration
    listed = [{"numbers": one.model_dump(mode="json"), "episodes": rows.get(k, []),
               "figures": summarize_doses(rows[k], duration) if k in rows else None} for k, one in enumerate(drawn)]
    folder.write_json(FILE, {**values, "best": find_best(rows, duration) if rows else None,
                             "is_complete": all(k in rows for k in range(choices)), "choices": listed})
