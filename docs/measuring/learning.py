"""Hours and days of learning, which continue where they were interrupted."""

import json
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from generators.results.learning import KINDS, NETWORKS, TRAINED
from generators.results.measured import ROOT

from measuring.running import command
from policies.results.rows import pack_rows
from policies.results.tables import collect_rows
from policies.runs.sweep_file import load_sweep, plan_runs

SCORED = {"wide": ["--suite", "wide"], "hard": ["--suite", "hard"],
          **{f"wide_{arm}": ["--suite", "wide", "--alone", "--arm", "--robot", arm] for arm in ("iiwa14", "ur5e")}}
"""End of a file with scores -> arguments of `robosim evaluate`: the tool alone, and two arms from the same starts."""
EPISODES = 30


def networks(_: Path) -> None:
    """Train the sweep of the bundled policies, take the best of finished runs, and score those of a task.
    The first seed's policy is bundled; scores are those of all seeds."""
    words = ["sweep", "configs/published/networks.yaml", "--jobs", "2"]
    subprocess.run([sys.executable, "-m", "robosim", *words], cwd=ROOT, check=False)
    taken: dict[str, dict[Path, float]] = {}  # task -> folder of policies that differ in the seed -> newest [s]
    for run in plan_runs(load_sweep(ROOT / words[1])):
        task, best, kind = run.arguments[2], ROOT / run.out / "best_policy.npz", KINDS[run.out.parent.name]
        if run.state != "finished" or not best.is_file():
            print(f"{run.out}: {run.state}, no policy")
            continue
        folder = Path("out/networks") / task / kind
        stored = ROOT / folder / run.out.name / "best.npz"
        stored.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(best, stored)
        if run.out.name == "seed_0":
            shutil.copy2(best, TRAINED / kind / f"{task}.npz")
        folders = taken.setdefault(task, {})
        folders[folder] = max(folders.get(folder, 0.0), best.stat().st_mtime)

    def score(task: str, end: str) -> None:
        out, names = ROOT / "out" / "networks" / task / end, [str(folder) for folder in taken[task]]
        scored = out / "evaluation.json"
        if not scored.is_file() or scored.stat().st_mtime < max(taken[task].values()):
            beside = ["--beside", *names[1:]] if names[1:] else []
            command(["evaluate", task, "--policy", names[0], *beside, *SCORED[end], "--episodes", str(EPISODES)], out)
        for kind in ("json", "csv"):
            shutil.copyfile(out / f"evaluation.{kind}", NETWORKS / f"{task}_{end}.{kind}")

    with ThreadPoolExecutor(2) as pool:
        list(pool.map(score, *zip(*((task, end) for end in SCORED for task in taken))))
    table = ROOT / "out" / "networks" / "tables"
    command(["tables", "out/networks"], table)
    rows = json.loads((table / "tables.json").read_text())
    (TRAINED / "networks.json").write_text(json.dumps(
        {"made_by": "robosim tables out/networks", **{key: rows[key] for key in ("runs", "code")}}, indent=1) + "\n")


def tables(_: Path) -> None:
    """Run the queue of the paper's tables, and store the rows of finished runs in place of earlier ones of theirs."""
    file = ROOT / "configs" / "published" / "tables.yaml"
    for task in load_sweep(file).tasks:
        command(["rollouts", task], ROOT / "out" / "tables" / "rollouts" / task)
    words = ["sweep", str(file.relative_to(ROOT)), "--jobs", "2"]
    subprocess.run([sys.executable, "-m", "robosim", *words], cwd=ROOT, check=False)
    rows = {}
    for source in (TRAINED / "tables.json", ROOT / "out" / "tables"):  # the second takes the place of the first
        rows |= {(row["task"], row["method"], row["seed"]): row for row in collect_rows([source])[0]}
    stored = {"made_by": "python docs/measure.py tables", **pack_rows([rows[key] for key in sorted(rows)])}
    (TRAINED / "tables.json").write_text(json.dumps(stored, indent=1) + "\n")
