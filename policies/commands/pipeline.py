"""`robosim pipeline`: from nothing to the whole arm's motion, one command after the other."""

import argparse
from typing import Any

import mpm
from robosim.base.resources import config_names, config_path
from robosim.commands.arguments import one_of

EXAMPLE = """examples:
  robosim pipeline spoon --jobs 2 --out out/pipeline
  robosim pipeline shovel --method dg_sac --episodes 50 --material sugar --out out/shovel
an interrupted pipeline continues with the same command; finished steps are not repeated"""
METHOD = "residual"
"""Corrections of a demonstration stay where the arm can follow; a free policy may turn a tool over its handle, where
the hand meets the container."""


def add_parser(commands: Any) -> None:
    """Add `pipeline` to the command line."""
    parser = commands.add_parser("pipeline", help="make demonstrations, train, replay in sequence and with the arm",
                                 description="Make demonstrations of a rehearsal's sub-tasks, train on them, replay "
                                 "the recorded motions in sequence and with the whole arm. Exit status 0 only if every "
                                 "step succeeded.", epilog=EXAMPLE)
    parser.add_argument("rehearsal", help=f"one of {', '.join(config_names('rehearsals'))}")
    parser.add_out("all results")
    parser.add_argument("--method", default=METHOD, help=f"training method: {one_of(config_names('training'))}")
    parser.add_number("--seed", default=0, help="random seed")
    parser.add_number("--n", default=1, help="demonstrations of each sub-task (default: 1; arXiv 2406.09178: 10)")
    parser.add_number("--iterations", default=150, help="largest number of iterations for each demonstration")
    parser.add_number("--episodes", help="largest number of training episodes (default: the method's)")
    parser.add_material("the rehearsal's", "material of the grains")
    parser.add_argument("--grasp", choices=["weld", "friction"], default="friction", help="tool welded to the hand, or "
                        "held by the fingers alone")
    parser.add_number("--jobs", default=1, help="number of sub-tasks at the same time")
    parser.add_argument("--no-video", action="store_true", help="make no videos")
    parser.add_settings("rehearsal's file", "recorded=[SpoonScoop,SpoonTranslate]")
    parser.set_defaults(run=run, after_interrupt="finished steps are kept; the same command continues")


def run(options: argparse.Namespace) -> int:
    """Check the names, then run the pipeline."""
    if options.rehearsal not in config_names("rehearsals"):
        raise mpm.InvalidValue(f"rehearsal {options.rehearsal!r}; accepted: {', '.join(config_names('rehearsals'))}")
    config_path("training", options.method, "method")
    options.settings.check("rehearsals", options.rehearsal)
    from policies.runs.pipeline import Pipeline

    return Pipeline(options).run()
