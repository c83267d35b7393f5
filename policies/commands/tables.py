"""`robosim tables`: results of training runs beside published numbers."""

import argparse
from pathlib import Path
from typing import Any

EXAMPLE = """example:
  robosim tables out/runs --out out/tables"""


def add_parser(commands: Any) -> None:
    """Add `tables` to the command line."""
    parser = commands.add_parser("tables", help="tabulate training runs beside published numbers", epilog=EXAMPLE,
                                 description="Tabulate the results of finished training runs, method by method, beside "
                                 "published numbers.")
    parser.add_argument("runs", type=Path, nargs="+", help="folders that contain runs, or a tables.json")
    parser.add_argument("--out", type=Path, required=True, help="folder for index.html, tables.json and tables.csv")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Write the tables."""
    from policies.results.tables import tables

    return tables(options.runs, options.out)
