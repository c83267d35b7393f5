"""`robosim calibrate`: a material card from measurements of a laboratory."""

import argparse
from pathlib import Path
from typing import Any

from robosim.base.errors import ConfigError

EXAMPLE = """examples:
  robosim calibrate flour_lab.yaml --out out/flour
  robosim calibrate flour_lab.yaml --set experiments.tall.held_out=true --runs 80 --out out/flour"""
RUNS = 60


def add_parser(commands: Any) -> None:
    """Add `calibrate` to the command line."""
    parser = commands.add_parser("calibrate", help="make a material card from measurements", epilog=EXAMPLE,
                                 description="Find the numbers of a material from heaps, poured masses, tilted or "
                                 "sheared samples, a scoop's mass and a cup's, with intervals and a check on held-out "
                                 "experiments. Exit status 0 only if the material is calibrated.")
    parser.add_argument("measurements", metavar="FILE", help=".yaml file that names the experiments, their data and "
                        "the numbers sought, see `robosim keys measurements`")
    parser.add_out("the card, calibration.json and index.html; runs that are finished there are not repeated")
    parser.add_number("--runs", default=RUNS, help=f"most simulations of each experiment (default: {RUNS})")
    parser.add_number("--seed", default=0, help="random seed of the search")
    parser.add_settings("measurements' file", "experiments.tall.held_out=true")
    parser.add_threads()
    parser.set_defaults(run=run, after_interrupt="finished runs are kept; the same command continues")


def run(options: argparse.Namespace) -> int:
    """Check what can be checked at once, then calibrate."""
    if not Path(options.measurements).is_file():
        raise ConfigError(f"measurements {options.measurements}: no such file; accepted: the path of a .yaml file, see "
                          f"`robosim keys measurements`")
    try:
        from robosim.studies.calibration.run import calibrate
    except ImportError as error:
        raise ConfigError(f"a package is missing ({error}); install what the command needs with pip install "
                          f"'robosim[calibrate]'") from None

    return calibrate(Path(options.measurements), options.out, runs=options.runs, seed=options.seed,
                     settings=tuple(options.settings))
