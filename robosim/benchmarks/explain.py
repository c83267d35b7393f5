"""`robosim explain`: what a scene is made of, what each part costs, the cheapest setting that still reads the same."""

import hashlib
import json
import sys
from pathlib import Path
from typing import Any

import yaml
from tqdm import tqdm

from robosim.benchmarks.settings import FRACTIONS
from robosim.config.output import OutputFolder
from robosim.config.resources import config_names, config_path
from robosim.envs import TASKS
from robosim.errors import ConfigError, UnknownName
from robosim.reports.jobs import run_jobs
from robosim.reports.page import Page
from robosim.reports.plot import Plot
from robosim.reports.provenance import code_digest
from robosim.tasks.task import is_task

OWN: dict[str, float] = {}
FINE = {"task": {"cell": 0.8, "dt": 0.8}, "rehearsal": {"cell": 0.8}}
"""What errors are measured against: a scene's own setting has one, too."""
SETTINGS = {
    "task": (FINE["task"], {"cell": 1.5}, {"cell": 1.25}, {"E": 0.25, "dt": 2.0}, {"dt": 0.5},
             {"cell": 1.25, "E": 0.25, "dt": 2.5}),
    "rehearsal": (FINE["rehearsal"], {"cell": 2.0}, {"cell": 1.5}, {"cell": 1.25}, {"E": 0.25},
                  {"cell": 1.5, "E": 0.25}, {"cell": 1.25, "E": 0.25}, {"grains_per_cell": 0.6}),
}
"""Factors on the scene's own cell, step, stiffness and grains per cell that are tried: the finest, then coarse ones
first."""


def explain(scene: str, *, tolerance: float | None = None, out: Path | None = None, apply: bool = False,
            jobs: int = 1) -> int:
    """Tell what a sub-task or rehearsal is made of; with a tolerance, run it coarse to fine as well. Returns 0, or 1
    where nothing cheaper than the scene's own keeps within the tolerance of the finest."""
    if scene not in TASKS and scene not in config_names("rehearsals") and not Path(scene).is_file():
        raise UnknownName("scene", scene, [*TASKS, *config_names("rehearsals")], "or the .yaml file of one")
    if tolerance is not None and not 0 < tolerance < 1:
        raise ConfigError(f"--tolerance {tolerance}; accepted: above 0, below 1")
    if apply and (tolerance is None or out is None):
        raise ConfigError("--apply writes the setting that --tolerance finds into --out; give both")
    kind = "task" if is_task(scene) else "rehearsal"
    settings = [OWN, *(SETTINGS[kind] if tolerance is not None else ())]
    folder = OutputFolder(out) if out else None
    results = ran(scene, settings, folder, jobs)
    own = results[0]["answer"]
    if own is None:
        raise ConfigError(f"{scene}: the scene itself did not run: {results[0]['failed']}")
    for line in anatomy(own):
        print(line)
    if tolerance is None:
        return written(scene, results, folder, None)
    rows = judged(results, tolerance)
    best = min((row for row in rows if row["within"]), key=lambda row: row["seconds"], default=None)
    for row in sorted(rows, key=lambda row: row["seconds"]):
        print(f"{named(row['setting']):44} {row['seconds']:8.2f} s  {row['cheaper']:5.2f}x  worst {row['worst']}: "
              f"{row['error']:.3%}{'' if row['within'] else '  outside'}")
    assert best is not None  # the finest is within any tolerance of itself
    finest = named(reference(results)["setting"])
    print(f"cheapest within {tolerance:.1%} of {finest}: {named(best['setting'])}, {best['cheaper']:.2f} times cheaper")
    for result in results:
        if result["answer"] is None:
            print(f"{named(result['setting'])}: did not run: {result['failed']}")
    if apply and folder is not None:  # a scene's file says nothing of its material's numbers
        plain = min((row for row in rows if row["within"] and "E" not in row["setting"]),
                    key=lambda row: row["seconds"])
        print(f"written, with {named(plain['setting'])}: {applied(scene, kind, plain['setting'], folder)}")
    written(scene, results, folder, rows)
    return int(best["setting"] in (OWN, FINE[kind]))


def ran(scene: str, settings: list[dict[str, float]], folder: OutputFolder | None, jobs: int) -> list[dict[str, Any]]:
    """Answers of the settings; those that the folder holds from the same code are not run again."""
    code = code_digest("robosim.benchmarks.settings")
    if Path(scene).is_file():
        code += hashlib.sha256(Path(scene).read_bytes()).hexdigest()[:12]
    known: dict[str, dict[str, Any]] = {}
    if folder is not None and (folder.path / "explain.json").is_file():
        try:
            told = json.loads((folder.path / "explain.json").read_text())
            if (told["scene"], told["code"]) == (scene, code):
                known = {json.dumps(r["setting"]): r for r in told["results"] if r["answer"] is not None}
        except (ValueError, KeyError, TypeError) as error:
            raise ConfigError(f"{folder.path / 'explain.json'}: not a report of `robosim explain` ({error}); it is "
                              f"left as it is: give another --out") from error
    waiting = [setting for setting in settings if json.dumps(setting) not in known]
    work = [("robosim.benchmarks.settings", (scene, json.dumps(setting))) for setting in waiting]
    progress = tqdm(total=len(waiting), unit="setting", file=sys.stderr)
    for place, answer, failed in run_jobs(work, jobs):
        known[json.dumps(waiting[place])] = {"setting": waiting[place], "answer": answer, "failed": failed}
        progress.update()
        if folder is not None:
            folder.write_json("explain.json", {"scene": scene, "code": code, "results": list(known.values())})
    progress.close()
    return [known[json.dumps(setting)] for setting in settings]


def named(setting: dict[str, float]) -> str:
    """A setting in words."""
    return ", ".join(f"{key} x {value:g}" for key, value in setting.items()) or "as it is"


def anatomy(own: dict[str, Any]) -> list[str]:
    """Parts and costs, for a terminal."""
    lines = [f"{own['grains']} grains, cells of {1e3 * own['cell']:g} mm, steps of {1e6 * own['dt']:.4g} us"]
    for here in (True, False):
        lines.append("has:" if here else "leaves out:")
        for part in own["parts"]:
            if part["here"] == here:
                held = f"  [{part['bytes'] / 1e6:.3g} MB]" if part["bytes"] else ""
                lines.append(f"  {part['name']}: {part['why']}{held}")
    lines.append("seconds per simulated second:")
    lines += [f"  {name}: {value:.3f}" for name, value in own["costs"].items()]
    lines.append("reads: " + ", ".join(f"{key} {value:.4g}" for key, value in own["readings"].items()))
    return lines


def reference(results: list[dict[str, Any]]) -> dict[str, Any]:
    """The finest setting's result, or where it did not run the scene's own."""
    fine = [result for result in results if result["setting"] in FINE.values() and result["answer"] is not None]
    return (fine or results)[0]


def judged(results: list[dict[str, Any]], tolerance: float) -> list[dict[str, Any]]:
    """Each setting that ran: how much cheaper than the finest, and its worst reading's error against that."""
    finest, rows = reference(results)["answer"], []
    for result in results:
        answer = result["answer"]
        if answer is None:
            continue
        errors = {name: error(name, answer["readings"][name], value) for name, value in finest["readings"].items()}
        worst = max(errors, key=lambda name: errors[name])
        rows.append({"setting": result["setting"], "seconds": answer["seconds"], "worst": worst, "errors": errors,
                     "error": errors[worst], "cheaper": finest["seconds"] / answer["seconds"],
                     "within": errors[worst] <= tolerance})
    return rows


def error(name: str, value: float, reference: float) -> float:
    """Of a share the difference, of any other reading relative to the reference."""
    return abs(value - reference) / (1.0 if name in FRACTIONS else max(abs(reference), 1e-12))


def applied(scene: str, kind: str, setting: dict[str, float], folder: OutputFolder) -> Path:
    """The scene's file with a setting applied."""
    config = yaml.safe_load(config_path("tasks" if kind == "task" else "rehearsals", scene, "scene").read_text())
    field = config["field"]
    for key in ("cell", "grains_per_cell"):
        if key in setting and key in field:
            field[key] = float(field[key]) * setting[key]
    if setting.get("dt") and field.get("dt"):
        field["dt"] = float(field["dt"]) * setting["dt"]
    if "collision_thickness" in config:
        config["collision_thickness"] = min(max(config["collision_thickness"], 0.5 * field["cell"]), field["cell"])
    return folder.write_yaml(f"{Path(scene).stem}.yaml", config)


def written(scene: str, results: list[dict[str, Any]], folder: OutputFolder | None,
            rows: list[dict[str, Any]] | None) -> int:
    """The page, where there is a folder; returns 0."""
    if folder is None:
        return 0
    own, page = results[0]["answer"], Page(f"What {scene} is made of")
    page.add_table(["part", "here", "why", "MB"], [[p["name"], "yes" if p["here"] else "left out", p["why"],
                                              p["bytes"] / 1e6 if p["bytes"] else None] for p in own["parts"]])
    page.add_heading("Seconds per simulated second")
    page.add_table(["part", "seconds"], own["costs"].items())
    page.add_heading("Readings")
    page.add_table(["reading", "value"], own["readings"].items())
    if rows is not None:
        plot = Plot(scene, "seconds", "error of the worst reading")
        for row in rows:
            words = "\n".join(f"{name} {value:.3%}" for name, value in row["errors"].items())
            plot.add_series([(row["seconds"], max(row["error"], 1e-4))], [f"{named(row['setting'])}\n{words}"],
                      named(row["setting"]))
        page.add_heading("Cheaper settings")
        page.add_plot(plot.svg())
        page.add_table(["setting", "seconds", "times cheaper", *own["readings"]],
                   [[named(r["setting"]), r["seconds"], r["cheaper"], *(r["errors"][k] for k in own["readings"])]
                    for r in rows])
    folder.write("index.html", lambda path: path.write_text(page.html()))
    print(folder.path / "index.html")
    return 0
