"""The dosing benchmark: entries of any simulator or robot, checked, and what they are measured by.

This file needs Python 3.10 and pydantic, and nothing of robosim: copy it to where your doses are.

  python docs/dosing_benchmark.py schema
  python docs/dosing_benchmark.py check my_entry.json
  python docs/dosing_benchmark.py convert evaluation.csv --policy pi --task DoseSpoon --source "..." > entry.json

An entry is a JSON file of `Entry`; its doses have the numbers 0 to draws - 1, none left out: a dose that failed stays
in it, without a mass where nothing came. `check` prints the metrics, or what is wrong by field, with exit status 1.
"""

import argparse
import csv
import json
import statistics
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

DRAWS = 200
"""Doses of a whole entry; shorter ones are marked in the table."""
HEAD = ["material", "doses", "failure rate", "error, mean [%]", "RSD [%]", "abs. error, median [%]", "seconds",
        "spilled [g]"]
"""Of the rows of `measure`."""


class Strict(BaseModel):
    """A table that refuses keys it does not have, texts for numbers, and numbers that are not finite."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


class Dose(Strict):
    """One dose."""

    draw: int = Field(ge=0)
    """Its number in the list that all entries of a task are measured on."""
    material: str = Field(min_length=1, max_length=60)
    """As in the materials of robosim, such as salt; or any other name."""
    target_g: float = Field(gt=0.0, le=1e5)
    """Mass that was asked for [g]."""
    dosed_g: float | None = Field(ge=0.0, le=1e5)
    """Mass in the receiver at the end [g], as weighed; null where there is none, as after a jam."""
    seconds: float = Field(gt=0.0, le=1e5)
    """From the command to the end [s]."""
    spilled_g: float | None = Field(default=None, ge=0.0, le=1e5)
    """Mass beside the receiver [g]; null: not measured."""


class Entry(Strict):
    """What one machine, controller or policy did with one task."""

    name: str = Field(min_length=1, max_length=80)
    kind: Literal["simulation", "robot"]
    task: str = Field(min_length=1, max_length=80)
    """Tool and receiver: one of robosim's dosing tasks, or in words."""
    source: str = Field(min_length=1, max_length=400)
    """Command and version, or DOI."""
    tolerance_percent: float = Field(default=2.0, gt=0.0, le=100.0)
    """Error of a dose that is accepted, in % of its target,"""
    tolerance_g: float = Field(default=0.3, ge=0.0, le=100.0)
    """or in g, whichever is more."""
    draws: int = Field(ge=1, le=1_000_000)
    """Doses that were begun."""
    doses: list[Dose]

    @model_validator(mode="after")
    def _check_draws(self) -> "Entry":
        given = [dose.draw for dose in self.doses]
        if twice := sorted({draw for draw in given if given.count(draw) > 1}):
            raise ValueError(f"doses: draws {shorten(twice)} are there twice; accepted: each of 0 to {self.draws - 1} "
                             f"once")
        if missing := sorted(set(range(self.draws)) - set(given)):
            raise ValueError(f"doses: draws {shorten(missing)} of {self.draws} are missing; accepted: all, a failed "
                             f"one with dosed_g null")
        if beyond := sorted(set(given) - set(range(self.draws))):
            raise ValueError(f"doses: draws {shorten(beyond)}; accepted: 0 to {self.draws - 1}")
        return self

    def fails(self, dose: Dose) -> bool:
        """Return whether a dose is outside of the tolerance."""
        accepted = max(self.tolerance_g, 0.01 * self.tolerance_percent * dose.target_g)
        return dose.dosed_g is None or abs(dose.dosed_g - dose.target_g) > accepted


def shorten(numbers: list[int]) -> str:
    """Return the first five of some numbers, and how many there are."""
    return ", ".join(map(str, numbers[:5])) + (f" and {len(numbers) - 5} more" if len(numbers) > 5 else "")


def measure(entry: Entry) -> list[list[Any]]:
    """Return rows as HEAD names them, of each material and of all; errors are relative to the target.
    RSD: standard deviation of the dosed mass in % of the target, with n - 1; None for what cannot be computed."""
    materials = sorted({dose.material for dose in entry.doses})
    return [[name, *_measure(entry, [dose for dose in entry.doses if name in (dose.material, "all")])]
            for name in [*materials, *["all"] * (len(materials) > 1)]]


def _measure(entry: Entry, doses: list[Dose]) -> list[Any]:
    errors = [100.0 * (dose.dosed_g / dose.target_g - 1.0) for dose in doses if dose.dosed_g is not None]
    spilled = [dose.spilled_g for dose in doses if dose.spilled_g is not None]
    return [len(doses), sum(map(entry.fails, doses)) / len(doses), statistics.fmean(errors) if errors else None,
            statistics.stdev(errors) if len(errors) > 1 else None,
            statistics.median(map(abs, errors)) if errors else None,
            statistics.fmean(dose.seconds for dose in doses), statistics.fmean(spilled) if spilled else None]


def read_entry(text: str) -> Entry:
    """Read an entry; raises ValidationError, which names the fields."""
    return Entry.model_validate_json(text)


def convert(rows: Iterable[dict[str, str]], policy: str, task: str, source: str) -> Entry:
    """Make an entry of the rows of `robosim evaluate --suite`, of one policy; a dose that diverged has no mass."""
    doses = [Dose(draw=int(row["episode"]), material=row["material"], target_g=1e3 * float(row["target_mass"]),
                  dosed_g=None if row["diverged"] else 1e3 * float(row["poured"]), seconds=float(row["seconds"]),
                  spilled_g=1e3 * float(row["spilled"])) for row in rows if row["policy"] == policy]
    return Entry(name=f"robosim, {policy}", kind="simulation", task=task, source=source, draws=len(doses), doses=doses)


def main(words: list[str] | None = None) -> int:
    """Print the schema, the metrics of entries, or an entry."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parts = parser.add_subparsers(dest="part", required=True)
    parts.add_parser("schema", help="print the JSON schema of an entry")
    parts.add_parser("check", help="check entries, print their metrics").add_argument("files", nargs="+", type=Path)
    one = parts.add_parser("convert", help="print an entry of an evaluation.csv of robosim")
    one.add_argument("csv", type=Path)
    for option in ("--policy", "--task", "--source"):
        one.add_argument(option, required=True)
    options, status = parser.parse_args(words), 0
    if options.part == "schema":
        print(json.dumps(Entry.model_json_schema(), indent=1))
    elif options.part == "convert":
        with options.csv.open(newline="") as file:
            entry = convert(csv.DictReader(file), options.policy, options.task, options.source)
        print(entry.model_dump_json(indent=1))
    else:
        for path in options.files:
            try:
                entry = read_entry(path.read_text(encoding="utf-8"))
            except (ValidationError, OSError, UnicodeDecodeError) as error:
                lines = [f"{'.'.join(map(str, one['loc'])) or 'entry'}: {one['msg']}" for one in error.errors()] if \
                    isinstance(error, ValidationError) else [str(error)]
                print("\n".join(f"{path}: {line}" for line in lines), file=sys.stderr)
                status = 1
                continue
            note = "" if entry.draws >= DRAWS else f" ({entry.draws} of {DRAWS} draws)"
            print(f"{path}: {entry.name}, {entry.task}{note}\n" + "\t".join(HEAD))
            for row in measure(entry):
                print("\t".join("" if value is None else f"{value:.3g}" if isinstance(value, float) else str(value)
                                for value in row))
    return status


if __name__ == "__main__":
    sys.exit(main())
