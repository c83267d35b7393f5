"""`robosim explain`: parts and cost of a scene, and the cheapest setting with the same readings."""

from pathlib import Path
from typing import Any

from robosim.base.digests import code_digest
from robosim.base.errors import ConfigError
from robosim.base.input_files import read_text
from robosim.base.output_folder import OutputFolder
from robosim.base.study import Job, Study
from robosim.reports.page import Page
from robosim.reports.plot import Plot
from robosim.studies.benchmarks.field_profile import format_profile
from robosim.studies.benchmarks.scene_run import FRACTIONS
from robosim.tasks.task import is_task

SCENE_RUN = "robosim.studies.benchmarks.scene_run"
OWN: dict[str, float] = {}
"""The scene's own setting."""
FINEST = {"task": {"cell": 0.8, "dt": 0.8}, "rehearsal": {"cell": 0.8}}
"""Settings that errors are measured against, because a scene's own setting has an error, too."""
SETTINGS = {
    "task": (FINEST["task"], {"cell": 1.5}, {"cell": 1.25}, {"E": 0.25, "dt": 2.0}, {"dt": 0.5},
             {"cell": 1.25, "E": 0.25, "dt": 2.5}),
    "rehearsal": (FINEST["rehearsal"], {"cell": 2.0}, {"cell": 1.5}, {"cell": 1.25}, {"E": 0.25},
                  {"cell": 1.5, "E": 0.25}, {"cell": 1.25, "E": 0.25}, {"grains_per_cell": 0.6}, {"host_dt": 2.0},
                  {"host_dt": 0.5}, {"host_dt": 2.0, "cell": 1.25}),
}
"""Settings that are compared: factors on the scene's own cell, step, stiffness, grains per cell, and MuJoCo step."""


def explain(scene: str, *, tolerance: float | None = None, out: Path | None = None, jobs: int = 1) -> int:
    """Print the parts and costs of a sub-task or rehearsal; with a tolerance, compare settings as well.

    tolerance: largest error of the worst reading against the finest setting. out: folder for index.html and
    explain.json. jobs: settings at a time.
    Returns 0, or 1 where no setting within the tolerance is cheaper than the scene's own.
    Raises ConfigError for options that do not fit or a scene that fails."""
    if tolerance is not None and not 0 < tolerance < 1:
        raise ConfigError(f"--tolerance {tolerance}; accepted: above 0, below 1")
    kind = "task" if is_task(scene) else "rehearsal"
    settings = [OWN, *(SETTINGS[kind] if tolerance is not None else ())]
    folder = OutputFolder(out) if out else None
    results = run_settings(scene, settings, folder, jobs)
    own = results[0]["result"]
    if own is None:
        raise ConfigError(f"{scene}: the scene itself did not run: {results[0]['failed']}")
    for line in format_parts(own):
        print(line)
    rows = None if tolerance is None else compare_settings(results, tolerance)
    status = 0 if rows is None or tolerance is None else print_comparison(rows, results, kind, tolerance)
    if folder is not None:
        write_page(scene, own, rows, folder)
    return status


def print_comparison(rows: list[dict[str, Any]], results: list[dict[str, Any]], kind: str, tolerance: float) -> int:
    """Print settings by run time and the cheapest within the tolerance; return 1 where none is cheaper."""
    best = min((row for row in rows if row["within"]), key=lambda row: row["seconds"], default=None)
    for row in sorted(rows, key=lambda row: row["seconds"]):
        print(f"{describe_setting(row['setting']):44} {row['seconds']:8.2f} s  {row['speedup']:5.2f}x  "
              f"worst {row['worst']}: {row['error']:.3%}{'' if row['within'] else '  outside'}")
    assert best is not None  # the finest is within any tolerance of itself
    finest = describe_setting(reference(results)["setting"])
    print(f"cheapest within {tolerance:.1%} of {finest}: {describe_setting(best['setting'])}, "
          f"{best['speedup']:.2f} x faster")
    for result in results:
        if result["result"] is None:
            print(f"{describe_setting(result['setting'])}: did not run: {result['failed']}")
    return int(best["setting"] in (OWN, FINEST[kind]))


def run_settings(scene: str, settings: list[dict[str, float]], folder: OutputFolder | None,
                 jobs: int) -> list[dict[str, Any]]:
    """Return the results of settings; those that the folder has from the same code are not run again."""
    content = read_text(Path(scene)) if Path(scene).is_file() else ""
    work = [Job(f"{SCENE_RUN}:measure_scene", {"scene": scene, "setting": setting}, depends=content)
            for setting in settings]
    rows = Study(folder and folder.path, jobs).rows(work, "explain", "settings")
    results = [{"setting": setting, "result": row.value, "failed": row.failed} for setting, row in zip(settings, rows)]
    if folder is not None:
        folder.write_json("explain.json", {"scene": scene, "code": code_digest(SCENE_RUN), "results": results})
    return results


def reference(results: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the finest setting's result, or the scene's own where the finest did not run."""
    finest = [result for result in results if result["setting"] in FINEST.values() and result["result"] is not None]
    return (finest or results)[0]


def compare_settings(results: list[dict[str, Any]], tolerance: float) -> list[dict[str, Any]]:
    """Return speed-up and worst error of each setting that ran, against the finest."""
    finest, rows = reference(results)["result"], []
    for row in results:
        result = row["result"]
        if result is None:
            continue
        # the difference of a share of the grains, the relative error of any other reading
        errors = {name: abs(result["readings"][name] - value) / (1.0 if name in FRACTIONS else max(abs(value), 1e-12))
                  for name, value in finest["readings"].items()}
        worst = max(errors, key=lambda name: errors[name])
        rows.append({"setting": row["setting"], "seconds": result["seconds"], "worst": worst, "errors": errors,
                     "error": errors[worst], "speedup": finest["seconds"] / result["seconds"],
                     "within": errors[worst] <= tolerance})
    return rows


def describe_setting(setting: dict[str, float]) -> str:
    """Format a setting, factors on the scene's own numbers."""
    return ", ".join(f"{key} x {value:g}" for key, value in setting.items()) or "own setting"


def format_parts(result: dict[str, Any]) -> list[str]:
    """Format parts, costs and readings of a run as lines for a terminal."""
    lines = [f"{result['grains']} grains, cells of {1e3 * result['cell_m']:g} mm, "
             f"steps of {1e6 * result['dt_s']:.4g} us"]
    for is_present in (True, False):
        lines.append("compiled in:" if is_present else "left out:")
        for part in result["parts"]:
            if part["present"] == is_present:
                memory = f"  [{part['bytes'] / 1e6:.3g} MB]" if part["bytes"] else ""
                lines.append(f"  {part['name']}: {part['reason']}{memory}")
    lines.append("seconds per simulated second:")
    lines += [f"  {name}: {value:.3f}" for name, value in result["costs"].items()]
    lines += format_profile(result["profile"])
    lines.append("readings: " + ", ".join(f"{key} {value:.4g}" for key, value in result["readings"].items()))
    return lines


def write_page(scene: str, own: dict[str, Any], rows: list[dict[str, Any]] | None, folder: OutputFolder) -> None:
    """Write index.html and print its path.
    own: result of the scene's own setting. rows: of `compare_settings`; None without a comparison."""
    page = Page(f"Parts and cost of {scene}")
    page.add_table(["part", "compiled in", "reason", "MB"],
                   [[p["name"], "yes" if p["present"] else "no", p["reason"],
                     p["bytes"] / 1e6 if p["bytes"] else None] for p in own["parts"]])
    page.add_heading("Seconds per simulated second")
    page.add_table(["part", "seconds"], own["costs"].items())
    page.add_heading("Field, over the motion")
    page.add_table(["stretch", "from [s]", "grains awake", "active blocks", "substeps an advance", "ms an advance",
                    "ns a grain awake and substep"], [list(row.values()) for row in own["profile"][:-1]])
    page.add_text(format_profile(own["profile"])[-1])
    page.add_heading("Readings")
    page.add_table(["reading", "value"], own["readings"].items())
    if rows is not None:
        _add_settings(page, scene, rows, list(own["readings"]))
    folder.write_text("index.html", page.html())
    print(folder.path / "index.html")


def _add_settings(page: Page, scene: str, rows: list[dict[str, Any]], readings: list[str]) -> None:
    plot = Plot(scene, "seconds", "error of the worst reading")
    for row in rows:
        name = describe_setting(row["setting"])
        errors = "\n".join(f"{reading} {value:.3%}" for reading, value in row["errors"].items())
        if row["error"] > 0.0:  # zero has no place on a logarithmic axis
            plot.add_series([(row["seconds"], row["error"])], [f"{name}\n{errors}"], name)
        else:
            plot.add_reference(row["seconds"], name)
    page.add_heading("Settings")
    page.add_plot(plot.html(), "Dashed: settings whose results are those of the finest, to which the others are "
                               "compared.")
    page.add_table(["setting", "seconds", "speed-up over the finest", *(f"error of {key}" for key in readings)],
                   [[describe_setting(r["setting"]), r["seconds"], r["speedup"], *(r["errors"][k] for k in readings)]
                    for r in rows])
