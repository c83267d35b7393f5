"""Our entries of the dosing benchmark."""

import csv
import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from dosing_benchmark import DRAWS, convert
from generators.results.measured import DATA, ROOT

from measuring.running import command

DOSING = ("DoseSpoon", "DoseScoop", "DoseBottle")


def dosing(_: Path) -> None:
    """Dose with the bundled controller, and store our entries of the benchmark; tasks that are complete stay."""
    def enter(task: str) -> None:
        out = ROOT / "out" / "dosing" / task
        words = ["evaluate", task, "--policy", "pi", "--suite", "wide", "--episodes", str(DRAWS), "--alone"]
        if not (out / "evaluation.json").is_file():  # which is written last
            command([*words, "--no-video"], out)
        if not (out / "evaluation.json").is_file():
            print(f"{out}: broken off, not stored")
            return
        made_by = json.loads((out / "evaluation.json").read_text())["made_by"]
        with (out / "evaluation.csv").open(newline="") as file:
            source = f"robosim {' '.join(words)}; commit {made_by['commit']}"
            entry = convert(csv.DictReader(file), "pi", task, source)
        (DATA / "dosing" / f"{task}_pi.json").write_text(entry.model_dump_json(indent=1) + "\n")

    with ThreadPoolExecutor(2) as pool:
        list(pool.map(enter, DOSING))
