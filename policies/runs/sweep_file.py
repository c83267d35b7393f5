"""Sweep files: tasks x methods x seeds, and the runs that they stand for."""

import json
from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import pydantic
from pydantic import Field

import mpm
from policies.learning.names import check_trainable, is_task_file
from policies.learning.options import to_words
from policies.learning.presets import Episodes, load_preset
from robosim.base.files import LOG
from robosim.base.input_files import read_json
from robosim.config.settings import Setting
from robosim.config.table import Table, load

Short = Annotated[str, Field(max_length=4096)]
"""A name, an argument or a path; Linux takes paths of up to 4096 characters."""
Seed = Annotated[int, Field(ge=0, le=2**31 - 1)]
"""numpy takes up to 2^32 - 1, and later episodes have larger ones."""
MAX_RUNS = 10_000
"""Runs of a sweep: at an hour each, a year of one core."""


class Entry(Table):
    """A method with changes of its own, where a name alone does not say enough."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$", max_length=100)]
    """Folder of its runs, and their line in tables."""
    method: Short
    set: dict[Short, Any] = Field({}, max_length=1000)
    """Dotted key of the method's file -> value in place of its own."""
    demos: Short | None = None
    """Folder of the demonstrations; null: the sweep's."""
    options: list[Short] = Field([], max_length=1000)
    """Further arguments of `robosim train`, after those of the sweep."""
    tasks: list[Short] | None = Field(None, min_length=1, max_length=MAX_RUNS)
    """Those of the sweep's tasks that it is run on; null: all."""
    seeds: list[Seed] | None = Field(None, min_length=1, max_length=MAX_RUNS)
    """null: the sweep's."""

    @pydantic.model_validator(mode="before")
    @classmethod
    def _read_name(cls, given: object) -> object:
        """Read the name of a method alone as its entry without changes."""
        return {"name": Path(given).stem, "method": given} if isinstance(given, str) else given

    @property
    def arguments(self) -> list[str]:
        """Arguments of `robosim train` that tell its runs from others of the method."""
        changes = [word for key, value in self.set.items() for word in ("--set", f"{key}={json.dumps(value)}")]
        label = [] if self.name == Path(self.method).stem else ["--label", self.name]
        return [*self.options, *changes, *label]


class SweepFile(Table):
    """The content of a sweep file."""

    tasks: list[Short] = Field(min_length=1, max_length=MAX_RUNS)
    methods: list[Entry] = Field(min_length=1, max_length=MAX_RUNS)
    """Methods, each a name, a file, or a table that changes one."""
    seeds: list[Seed] = Field(min_length=1, max_length=MAX_RUNS)
    demos: Short | None = None
    """Folder of the demonstrations; {task} stands for the task's name."""
    rollouts: Short | None = None
    """Folder of the rollouts that a graph network learns from; {task} as above."""
    episodes: Episodes | None = None
    """Largest number of episodes; null: the method's own."""
    options: list[Short] = Field([], max_length=1000)
    """Further arguments of `robosim train`."""
    launch: dict[Short, Any] = Field({}, max_length=100)
    """What a job of a cluster is given: partition, hours, memory_gb, cores, parallel, setup, python, ..."""
    out: Path
    """Runs are written to out/task/method/seed_k, or out/task/name/seed_k for an entry."""

    def check(self) -> None:
        for k, entry in enumerate(self.methods):
            if unknown := set(entry.tasks or ()) - set(self.tasks):
                raise ValueError(f"methods[{k}].tasks: {', '.join(sorted(unknown))}; accepted: those of the sweep, "
                                 f"{', '.join(self.tasks)}")
        count = sum(len(entry.tasks or self.tasks) * len(entry.seeds or self.seeds) for entry in self.methods)
        if count > MAX_RUNS:
            raise ValueError(f"tasks, methods and seeds make {count} runs; accepted: up to {MAX_RUNS}")


class SweepRun(NamedTuple):
    """One run of a sweep."""

    out: Path
    arguments: list[str]
    """Arguments of `robosim`."""
    preset: dict[str, Any]

    @property
    def log(self) -> Path:
        """File that the run's stdout and stderr are appended to."""
        return self.out / LOG

    @property
    def state(self) -> str:
        """State of the run's folder: "new", "another" (of another run), or that of its status.json."""
        try:
            manifest = read_json(self.out / "manifest.json")
            stored = manifest["preset"]
            # What arguments may change is compared by the command below: with --set, everything.
            from_arguments = stored if "--set" in self.arguments else {
                name: stored.get(name) for name in ("obs", "episodes")}
            has_same_command = manifest["command"].split(" ", 1)[-1] == " ".join(self.arguments)
            if not has_same_command or {**self.preset, **from_arguments} != stored:
                return "another"  # `robosim train` refuses it and names the difference
            return str(read_json(self.out / "status.json")["state"])
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            return "new"


def load_sweep(path: Path, settings: Sequence[Setting] = ()) -> SweepFile:
    """Load a sweep file; raises robosim.ConfigError for one that is wrong."""
    return load(path, SweepFile, settings=settings)


def plan_runs(file: SweepFile) -> list[SweepRun]:
    """Return all runs of a sweep, seeds outermost, so that an interrupted sweep has each seed for all methods.
    Raises robosim.ConfigError for an unknown task or method, mpm.InvalidValue where a method's input is missing, or two
    runs share a folder."""
    for task in file.tasks:
        check_trainable(task)
    runs: dict[Path, SweepRun] = {}
    seeds = dict.fromkeys([*file.seeds, *(seed for entry in file.methods for seed in entry.seeds or ())])
    for seed, task, method in product(seeds, file.tasks, file.methods):
        if task not in (method.tasks or file.tasks) or seed not in (method.seeds or file.seeds):
            continue
        run = _plan_run(file, seed, task, method)
        if run.out in runs:
            both = [" ".join(["robosim", *one.arguments]) for one in (runs[run.out], run)]
            raise mpm.InvalidValue(f"two runs would share the folder {run.out}: {both[0]!r} and {both[1]!r}; accepted: "
                                   f"tasks, methods, seeds and names that differ")
        runs[run.out] = run
    return list(runs.values())


def _plan_run(file: SweepFile, seed: int, task: str, entry: Entry) -> SweepRun:
    name, method = Path(task).stem if is_task_file(task) else task, entry.method
    out = file.out / name / entry.name / f"seed_{seed}"
    preset = load_preset(method, [Setting(tuple(key.split(".")), value) for key, value in entry.set.items()])
    inputs = {}
    for key, folder, is_needed in (("demos", entry.demos or file.demos, preset.needs_demonstrations),
                                   ("rollouts", file.rollouts, preset.needs_rollouts)):
        if is_needed:
            if folder is None:
                raise mpm.InvalidValue(f"method {method} learns from {key}; give their folder as `{key}`")
            inputs[key] = folder.replace("{task}", name)
    arguments = ["train", method, task, *to_words(seed=seed, out=out), *file.options, *to_words(**inputs),
                 *entry.arguments, *to_words(episodes=file.episodes)]
    changed = {} if file.episodes is None else {"episodes": file.episodes}
    return SweepRun(out, arguments, {**preset.model_dump(), **changed})
