"""`robosim stability`: the matrix of stiff and extreme cases."""

import argparse
from typing import Any

from robosim.base.errors import UnknownName
from robosim.studies.verification.stability import AXES, COMPARISONS, SLEEPING_AXES

EXAMPLE = """example:
  robosim stability courant drop_height --out out/stability"""


def add_parser(commands: Any) -> None:
    """Add `stability` to the command line."""
    parser = commands.add_parser("stability", help="run stiff and extreme cases", epilog=EXAMPLE,
                                 description="Run stiff and extreme cases along axes such as stiffness or drop height. "
                                 "Exit status 0 only if none is unstable.")
    parser.add_argument("axes", nargs="*", metavar="AXIS", help=f"of {', '.join(AXES)} (default: all of these); to "
                        f"compare couplings: {', '.join(COMPARISONS)}; with grains that sleep: "
                        f"{', '.join(SLEEPING_AXES)}")
    parser.add_out("index.html and stability.json")
    parser.add_number("--jobs", default=1, help="number of cases at the same time")
    parser.add_launcher()
    parser.set_defaults(run=run, after_interrupt="finished cells are kept; the same command continues")


def run(options: argparse.Namespace) -> int:
    """Check the names, then run the matrix."""
    for axis in options.axes:
        if axis not in (*AXES, *COMPARISONS, *SLEEPING_AXES):
            raise UnknownName("axis", axis, (*AXES, *COMPARISONS, *SLEEPING_AXES))
    from robosim.studies.verification.stability_report import stability

    return stability(options.axes, options.out, options.jobs, options.find_launcher(options))
