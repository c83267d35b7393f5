"""The page of the dosing benchmark: metrics of the entries of docs/results/data/dosing."""

import csv

from dosing_benchmark import DRAWS, HEAD, Entry, convert, measure, read_entry

from generators.markdown import table
from generators.results.measured import DATA

OWN = {"DoseScoop_pi": ("pi", "DoseScoop", "robosim evaluate DoseScoop --policy pi --suite wide --episodes 40 --alone, "
                                           "broken off; commit 02c9abfc")}
"""Rows of `robosim evaluate` -> policy, task and source of their entry; other entries are .json files."""


def entries() -> list[Entry]:
    """Our own entries, made of their rows, and those of others."""
    made = []
    for name, origin in OWN.items():
        with (DATA / "dosing" / f"{name}.csv").open(newline="") as file:
            made.append(convert(csv.DictReader(file), *origin))
    return made + [read_entry(path.read_text()) for path in sorted((DATA / "dosing").glob("*.json"))]


def page() -> str:
    """A table for each entry."""
    parts = []
    for entry in entries():
        note = "" if entry.draws >= DRAWS else f" **{entry.draws} of {DRAWS} draws: too few to compare.**"
        parts.append(f"### {entry.task}: {entry.name}\n\n{entry.kind}, `{entry.source}`.{note}\n\n"
                     + table(HEAD, measure(entry)))
    return "\n".join(parts)
