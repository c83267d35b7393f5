"""`robosim report`: verification cases, error against run time, as a page and JSON."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

from robosim.base import input_files
from robosim.base.errors import ConfigError
from robosim.base.jobs import Launcher
from robosim.base.output_folder import OutputFolder
from robosim.base.provenance import provenance
from robosim.studies.verification.cases import NAMES, expand
from robosim.studies.verification.cases.case import describe
from robosim.studies.verification.report_page import add_comparison, make_page
from robosim.studies.verification.runs import execute_runs, replace_non_finite, summarize_case

POINTS = {"reference": {"r_final_m": float},
          "points": [{"code": str, "cell_m": float, "seconds": float, "r99_m": float, "particles": float}]}
"""Form of the file of other codes' results."""


def report(names: list[str], out: Path, *, quick: bool = False, jobs: int = 1, points: Path | None = None,
           compare: Path | None = None, launcher: Launcher | None = None) -> int:
    """Run cases, all when the list is empty, and write index.html and report.json.

    names: of cases, or of subjects such as "forces", which stand for all of their cases. quick: their quick sweeps.
    jobs: runs at a time. points: JSON file with other codes' results on the column collapse. compare: report.json of an
    earlier run. launcher: runs the runs elsewhere. Returns 0 if every expectation is met, else 1.
    Raises ConfigError, UnknownName for what cannot be used."""
    names = expand(names) or list(NAMES)
    if jobs < 1:
        raise ConfigError(f"--jobs {jobs}; accepted: 1 or more")
    peers = read_peers(points) if points else None
    earlier = read_json(compare) if compare else None
    with OutputFolder(out) as folder:
        runs = execute_runs(names, quick, folder.path, jobs, launcher)
        results = {name: summarize_case(name, [run for run in runs if run.case == name]) for name in names}
        content = replace_non_finite({"made_by": provenance(), "cases": results,
                                      "runs": [asdict(run) for run in runs]})
        folder.write_json("report.json", content)
        page = make_page(results, runs, peers)
        if earlier is not None:
            add_comparison(page, earlier, content)
        folder.write_text("index.html", page.html())
        return print_summary(results, folder.path, quick)


def print_summary(results: dict[str, Any], path: Path, quick: bool) -> int:
    """Print the verdicts; return 1 for a failure, and where a whole report leaves an expectation without a run."""
    bad = 0
    for name, result in results.items():
        verdicts = [claim["verdict"] for claim in result["claims"]]
        print(f"{name:18} {verdicts.count('pass')} passed, {verdicts.count('fail')} failed, "
              f"{verdicts.count('not run')} not run")
        for claim in result["claims"]:
            if claim["verdict"] == "fail":
                print(f"  fail: {claim['claim']}: {claim['found']}; accepted {claim['low']} to {claim['high']}")
        for failed in result["failed"]:
            print(f"  no result: {describe(failed['choices'])}: {failed['reason']}")
        bad += verdicts.count("fail") + len(result["failed"]) + (0 if quick else verdicts.count("not run"))
    print(path / "index.html")
    return int(bad > 0)


def read_peers(path: Path) -> dict[str, Any]:
    """Read other codes' results on the column collapse. Raises ConfigError for a file that holds anything else."""
    content = read_json(path)
    try:
        input_files.check_form(content, POINTS)
        positive = [p[key] for p in content["points"] for key in ("cell_m", "seconds")]
        if min([content["reference"]["r_final_m"], *positive]) <= 0.0:
            raise ValueError("a length or a time is not positive")
    except ValueError as error:
        raise ConfigError(f"--points {path}: {error}; accepted: reference.r_final_m, and points with code, cell_m, "
                          f"particles, seconds, r99_m") from error
    return content


def read_json(path: Path) -> Any:
    """Read a JSON file. Raises ConfigError for one that cannot be read."""
    try:
        return input_files.read_json(path)
    except (OSError, ValueError) as error:
        raise ConfigError(f"{path}: cannot be read as JSON: {str(error).removeprefix(f'{path}: ')}; it is left as "
                          f"it is") from None
