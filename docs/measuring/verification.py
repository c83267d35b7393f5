"""The whole report of verification cases, which continues where it was interrupted."""

import json
from pathlib import Path
from typing import Any

from generators.results.measured import DATA, ROOT

from measuring.running import command, made_by
from robosim.studies.verification.cases import CASES
from robosim.studies.verification.cases.case import Record
from robosim.studies.verification.runs import picture_of

JOBS = 2


def report(_: Path) -> None:
    """Run all cases, a subject at a time; store what is finished in place of the subject's earlier runs."""
    for subject in CASES:
        words = ["report", subject, "--jobs", str(JOBS)]
        folder = ROOT / "out" / "verification" / subject
        command(words, folder)
        store(json.loads((folder / "report.json").read_text()))


def store(new: dict[str, Any], target: Path = DATA / "report.json") -> None:
    """Put the cases of a report in place of theirs in the stored one; of each case one picture is kept."""
    old = json.loads(target.read_text()) if target.is_file() else {"cases": {}, "runs": []}
    commit = new["made_by"]["commit"]
    cases = {**old["cases"], **{name: {**result, "commit": commit} for name, result in new["cases"].items()}}
    runs = [run for run in old["runs"] if run["case"] not in new["cases"]]
    for name in new["cases"]:
        mine = [run for run in new["runs"] if run["case"] == name]
        kept = picture_of([Record(**run["record"]) for run in mine if run["record"]])
        for run in mine:
            if run["record"] and run["record"]["picture"] != kept:
                run["record"]["picture"] = ""
        runs += mine
    commits = ", ".join(sorted({result.get("commit", "unknown") for result in cases.values()}))
    origin = {**made_by(["report", "SUBJECT", "--jobs", str(JOBS)]), "commit": commits}
    target.write_text(json.dumps({"made_by": origin, "cases": cases, "runs": runs}, indent=1) + "\n")
