"""`robosim tune`: a search of a dosing controller's numbers on training seeds."""

import sys
from pathlib import Path
from typing import Any, NamedTuple

from robosim.base.jobs import Launcher
from robosim.base.output_folder import OutputFolder, aligned
from robosim.base.progress import Progress
from robosim.base.provenance import provenance
from robosim.base.study import Job, Study
from robosim.dosing.numbers import DosingNumbers
from robosim.envs import task_name
from robosim.studies.evaluation.dosing_policy import numbers_of
from robosim.studies.tuning.choices import GENERATION, draw_choice
from robosim.studies.tuning.trial import summarize_doses
from robosim.tasks.task import load_task

SHOWN = ("cost", "success_rate", "error_g", "error_g_std", "seconds", "spilled_g")
"""Figures that are printed."""


class SearchOptions(NamedTuple):
    """How numbers are searched for."""

    choices: int
    """Choices of numbers, the task's own among them."""
    episodes: int
    """Episodes of each choice, with the seeds from `seed` on."""
    seed: int = 0
    material: str | None = None
    """None: the task's."""
    randomize: str = "nominal"
    """Suite that the episodes' starts and materials are drawn from."""


def tune(task: str, controller: str, out: Path, options: SearchOptions, *, jobs: int = 1,
         launcher: Launcher | None = None) -> int:
    """Search a controller's numbers; write tune.json and the best numbers as numbers.yaml into a folder.

    The first choice are the task's own numbers. jobs: choices at a time, here; launcher: runs them elsewhere. Choices
    and episodes that the folder has of the same arguments and code are not run again; as choices are drawn from costs,
    a search that goes on is the same one. Returns 0, or 1 where a process failed; the same command then continues.
    Raises ConfigError for a task without a dose."""
    choices, episodes, seed, material, randomize = options
    config = load_task(task)
    numbers = numbers_of(config, controller)
    same = {"controller": controller, "material": material or config.material, "randomize": randomize}
    table = config.model_dump(mode="json", exclude={"description"})
    made_by, duration = provenance(), numbers.motion.duration
    head = {"made_by": made_by, "task": table, **same, "seed": seed, "episodes": episodes,
            "numbers": numbers.model_dump(mode="json", exclude={"source"})}
    with OutputFolder(out) as folder:
        study, drawn, rows = Study(folder.path, jobs, launcher), [numbers], {}
        with Progress(total=choices, desc=f"{task_name(task)}, {controller}", unit="choices") as progress:
            while not folder.failures and (waiting := _next(choices, rows)):
                costs = {k: summarize_doses(row, duration)["cost"] for k, row in rows.items()}
                for k in range(len(drawn), waiting[-1] + 1):
                    drawn.append(draw_choice(controller, numbers, k, seed, costs, drawn))
                trials = [Job("robosim.studies.tuning.trial:run_trial", {
                    "search": {"task": task, "config": table, **same}, "numbers": drawn[k].model_dump(mode="json"),
                    "seed": seed, "count": episodes}, places={"folder": str(study.store.folder)}) for k in waiting]
                for index, row in study.run(trials):
                    if row.failed:
                        folder.failures.append(f"choice {waiting[index]}: {row.failed}")
                    else:
                        rows[waiting[index]] = row.value
                        _write(folder, head, drawn, rows, choices)
                        progress.update()
        if rows:
            best = find_best(rows, duration)
            folder.write_yaml("numbers.yaml", drawn[best].model_dump(mode="json") | {"source": made_by["command"]})
            print(format_search(rows, duration, best))
    for failure in folder.failures:
        print(f"failed: {failure}; what is finished is kept, run the same command again to continue", file=sys.stderr)
    return int(bool(folder.failures))


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
    duration = drawn[0].motion.duration
    listed = [{"numbers": one.model_dump(mode="json"), "episodes": rows.get(k, []),
               "figures": summarize_doses(rows[k], duration) if k in rows else None} for k, one in enumerate(drawn)]
    folder.write_json("tune.json", {**values, "best": find_best(rows, duration) if rows else None,
                                    "is_complete": all(k in rows for k in range(choices)), "choices": listed})
