"""`robosim sweep`: training runs of many tasks, methods and seeds."""

import argparse
from pathlib import Path
from typing import Any

EXAMPLE = """example, with a file small.yaml of
  tasks: [SpoonPour, ShovelMove]
  methods: [dg_sac, sac]
  seeds: [0, 1, 2]
  demos: out/demo/{task}
  out: out/runs
and then
  robosim sweep small.yaml --jobs 2
an interrupted sweep continues with the same command; finished runs are not repeated"""


def add_parser(commands: Any) -> None:
    """Add `sweep` to the command line."""
    parser = commands.add_parser("sweep", help="train many sub-tasks, methods and seeds", epilog=EXAMPLE,
                                 description="Train every combination of the tasks, methods and seeds of a file. Exit "
                                 "status 0 only if every run finished.")
    parser.add_argument("file", type=Path, help="a .yaml file, as below")
    parser.add_number("--jobs", default=1, help="processes at a time, one core each (default: 1)")
    parser.add_launch()
    parser.add_argument("--dry-run", action="store_true", help="list the runs that are left, and start none")
    parser.add_settings("file", "seeds=[0,1]")
    parser.set_defaults(run=run, after_interrupt="finished runs are kept; the same command continues")


def run(options: argparse.Namespace) -> int:
    """Start the runs."""
    from policies.runs.sweep import sweep
    from robosim.studies.clusters.slurm import make_launcher

    return sweep(options.file, jobs=options.jobs, launcher=make_launcher(options.launch), dry_run=options.dry_run,
                 settings=options.settings)
