"""`robosim pipeline`: from nothing to the whole arm's motion, one command after the other."""

import argparse
from pathlib import Path
from typing import Any

import mpm
from policies.learning.bundled import bundled_names, check_material, check_method

EXAMPLE = """examples:
  robosim pipeline spoon --jobs 2 --out out/pipeline
  robosim pipeline shovel --method rlpd --episodes 50 --material sugar --out out/shovel
an interrupted pipeline continues with the same command; finished steps are not repeated"""
METHOD = "residual"
"""Corrections of a demonstration stay where the arm can follow; a free policy may turn a tool over its handle, where
the hand meets the container."""


def add_parser(commands: Any) -> None:
    """Add `pipeline` to the command line."""
    parser = commands.add_parser("pipeline", help="demonstrations, training, sub-tasks in sequence, whole arm",
                                 description="Make demonstrations of a rehearsal's sub-tasks, train on them, replay "
                                 "the learned motions in sequence and with the whole arm. Exit status 0 only if every "
                                 "step succeeded.", epilog=EXAMPLE)
    parser.add_argument("rehearsal", help=f"one of {', '.join(bundled_names('rehearsals'))}")
    parser.add_argument("--out", type=Path, required=True, help="folder of all results")
    parser.add_argument("--method", default=METHOD, help=f"of training: one of {', '.join(bundled_names('training'))}; "
                        f"or the path of a .yaml file (default: {METHOD})")
    parser.add_argument("--seed", type=int, default=0, help="of everything random (default: 0)")
    parser.add_argument("--n", type=int, default=1, help="demonstrations of each sub-task (default: 1; arXiv "
                        "2406.09178: 10)")
    parser.add_argument("--iterations", type=int, default=150, help="of each demonstration, at most (default: 150)")
    parser.add_argument("--episodes", type=int, help="of training, at most (default: the method's)")
    parser.add_argument("--material", help=f"of the grains: one of {', '.join(bundled_names('materials'))}; or the "
                        "path of a .yaml file (default: the rehearsal's)")
    parser.add_argument("--grasp", choices=["weld", "friction"], default="friction", help="tool welded to the hand, or "
                        "held by the fingers alone (default: friction)")
    parser.add_argument("--jobs", type=int, default=1, help="sub-tasks at a time, a core each (default: 1)")
    parser.add_argument("--no-video", action="store_true", help="draw no films")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Check the names, then run the pipeline."""
    if options.rehearsal not in bundled_names("rehearsals"):
        raise mpm.InvalidValue(f"rehearsal {options.rehearsal!r}; accepted: {', '.join(bundled_names('rehearsals'))}")
    check_method(options.method)
    check_material(options.material)
    from policies.runs.pipeline import Pipeline

    return Pipeline(options).run()
