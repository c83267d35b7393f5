"""`robosim tables`: results of training runs beside published numbers."""

import argparse
from pathlib import Path
from typing import Any

import mpm

EXAMPLE = """example:
  robosim tables out/runs --out out/tables
  robosim tables policies/trained/tables.json --check
  robosim tables --paper"""


def add_parser(commands: Any) -> None:
    """Add `tables` to the command line."""
    parser = commands.add_parser("tables", help="tabulate training runs beside published numbers", epilog=EXAMPLE,
                                 description="Tabulate the results of finished training runs, method by method, beside "
                                 "published numbers.")
    parser.add_argument("runs", type=Path, nargs="*", help="folders that contain runs, or a tables.json; "
                        "needed without --paper, which takes the stored runs where none is given")
    parser.add_out("index.html, tables.json, tables.csv and curves.png", is_required=False)
    parser.add_argument("--mixed", action="store_true", help="show means over runs that differ, with a note, where "
                        "they would be refused")
    parser.add_argument("--check", action="store_true", help="only name the rows that are older than the code that "
                        "they exercise; the exit status is 1 if there are any")
    parser.add_argument("--paper", action="store_true", help="only print the tables of arXiv 2406.09178 with our "
                        "figures in them; the exit status is 1 if any cell has no run")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Write the tables, or check the rows."""
    from policies.results.tables import STORED, check, print_paper, tables

    if options.paper:
        return print_paper(options.runs or [STORED])
    if not options.runs:
        raise mpm.InvalidValue("tables: no runs; accepted: folders that contain runs, or a tables.json")
    if options.check:
        return check(options.runs)
    if options.out is None:
        raise mpm.InvalidValue("tables: no --out; accepted: a folder, or --check, which writes nothing")
    return tables(options.runs, options.out, options.mixed)
