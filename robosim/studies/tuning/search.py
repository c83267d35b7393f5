"""`robosim tune`: a search of a dosing controller's numbers on training seeds, and how its choices are drawn."""

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from robosim.base.jobs import Launcher
from robosim.base.output_folder import OutputFolder, aligned
from robosim.base.progress import Progress
from robosim.base.provenance import provenance
from robosim.base.study import Job, Study
from robosim.dosing.numbers import PI_RATES, DosingNumbers
from robosim.envs import task_name
from robosim.studies.policies.tool_view import numbers_of
from robosim.studies.tuning.trial import summarize_doses
from robosim.tasks.task import load_task

GENERATION = 6
"""Choices that are drawn around the same best one, and may run at the same time."""
SHOWN = ("cost", "success_rate", "error_g", "error_g_std", "seconds", "spilled_g")
"""Figures that are printed."""


class Range(NamedTuple):
    """Where a number is searched."""

    low: float
    high: float
    is_log: bool = True
    """Whether it is drawn on a logarithmic scale."""

    def place(self, value: float) -> float:
        """Return the place of a value in the range, 0 at its low end and 1 at its high end."""
        ends = (self.low, self.high, max(value, self.low))  # a logarithm of a given 0 has no place
        low, high, at = np.log(ends) if self.is_log else ends
        return float(np.clip((at - low) / (high - low), 0.0, 1.0))

    def value(self, place: float) -> float:
        """Return the value at a place, with four digits: what the file of a choice holds."""
        low, high = np.log([self.low, self.high]) if self.is_log else (self.low, self.high)
        at = low + float(np.clip(place, 0.0, 1.0)) * (high - low)
        return float(np.clip(float(f"{np.exp(at) if self.is_log else at:.4g}"), self.low, self.high))


RANGES: dict[str, dict[str, Range]] = {
    "open_loop": {"before_deg": Range(2.0, 30.0), "search_deg": Range(1.0, 20.0), "share": Range(0.5, 1.5),
                  "hold": Range(0.1, 3.0)},
    "pi": {"before_deg": Range(5.0, 40.0), "search_deg": Range(0.5, 6.0), "middle": Range(0.2, 0.9, False),
           "fastest_deg": Range(3.0, 30.0), "time": Range(1.0, 6.0), "least": Range(0.3, 3.0),
           "proportional": Range(0.0, 0.3, False), "integral": Range(0.05, 1.0), "first": Range(0.3, 0.95, False),
           "left": Range(5e-4, 0.01),
           "delay": Range(0.1, 0.6), "window": Range(0.1, 0.4), "stop_deg": Range(2.0, 20.0, False),
           "resume_deg": Range(0.0, 6.0, False), "settle": Range(0.3, 1.2), "resume": Range(0.0, 1.0, False),
           "weakest": Range(0.01, 0.3), "pulse": Range(0.06, 0.4), "pause": Range(0.2, 1.0),
           "next": Range(0.1, 1.0, False), "close": Range(0.2, 1.0, False)},
    "shaker": {"before_deg": Range(2.0, 30.0), "search_deg": Range(1.0, 8.0), "amplitude": Range(0.2, 1.0),
               "time": Range(0.5, 10.0), "ahead": Range(0.02, 0.5), "pulse": Range(0.04, 1.0),
               "settle": Range(0.4, 1.5), "margin": Range(0.1, 0.8, False)},
}
"""Controller -> its numbers with the ranges that they are searched in. The balance's `lag` is known, not searched."""


def draw_choice(controller: str, numbers: DosingNumbers, index: int, seed: int,
                costs: Mapping[int, float], choices: Sequence[DosingNumbers]) -> DosingNumbers:
    """Return the numbers of the choice `index`: the first are those given, later ones lie around the best so far.
    costs: mean cost of each earlier choice that has one, of which those of earlier generations count; so the search is
    the same with any number of processes. Rates of pi go up to `motion.fast_deg`, also where that is below their range.
    choices: the earlier choices' numbers."""
    if index == 0:
        return numbers
    generation = (index - 1) // GENERATION
    known = {k: cost for k, cost in costs.items() if k < 1 + GENERATION * generation}
    best = choices[min(known, key=lambda k: (known[k], k))] if known else numbers
    spread = max(0.05, 0.25 * 0.8**generation)  # standard deviation, as a share of the range
    rng = np.random.default_rng((seed, index))
    own = getattr(best, controller)
    drawn = {name: one.value(one.place(getattr(own, name)) + spread * rng.standard_normal())
             for name, one in RANGES[controller].items()}
    if controller == "pi":
        drawn |= {name: min(drawn[name], best.motion.fast_deg) for name in PI_RATES}
    table = best.model_dump()
    return DosingNumbers.model_validate(table | {controller: table[controller] | drawn})


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
