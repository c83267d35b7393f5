"""`robosim report`: verification cases, error against run time."""

import argparse
from pathlib import Path
from typing import Any

from robosim.studies.verification.cases import GROUPS, NAMES, expand

EXAMPLE = """examples:
  robosim report axis_aligned vortex --quick --out out/report
  robosim report forces --quick --out out/forces"""


def add_parser(commands: Any) -> None:
    """Add `report` to the command line."""
    parser = commands.add_parser("report", help="run verification cases: error against run time", epilog=EXAMPLE,
                                 description="Run cases with independent reference solutions and report error against "
                                 "run time. Exit status 0 only if every error is in its accepted range.")
    parser.add_argument("cases", nargs="*", metavar="CASE", help=f"of {', '.join(NAMES)}; or of the subjects "
                        f"{', '.join(GROUPS)}, for all of their cases (default: all)")
    parser.add_out("index.html, report.json and rows/, a file for each run; runs that are finished there are not "
                   "repeated")
    parser.add_argument("--quick", action="store_true", help="fewer and smaller runs of every case")
    parser.add_number("--jobs", default=1, help="number of runs at the same time, each on its own core; measured run "
                      "times are reliable with 1 only")
    parser.add_argument("--points", type=Path, help="JSON file with results of other codes for the column collapse")
    parser.add_argument("--compare", type=Path, help="report.json of another run, to list what improved and what "
                        "became worse")
    parser.add_launcher()
    parser.set_defaults(run=run, after_interrupt="finished runs are kept; the same command continues")


def run(options: argparse.Namespace) -> int:
    """Check the names, then run the cases."""
    expand(options.cases)
    from robosim.studies.verification.report import report

    return report(options.cases, options.out, quick=options.quick, jobs=options.jobs, points=options.points,
                  compare=options.compare, launcher=options.find_launcher(options))
