"""`robosim tune`: the numbers of a dosing controller, and the pour curve that it works with."""

import argparse
from typing import Any

from robosim.commands.arguments import refuse
from robosim.dosing import CONTROLLERS
from robosim.envs import is_task_file

EXAMPLE = """examples:
  robosim tune DoseSpoon --curve --out out/curve
  robosim tune DoseSpoon --controller pi --jobs 2 --out out/tuned
  robosim evaluate DoseSpoon --policy pi --set dose.controllers=out/tuned/numbers.yaml"""
PRESETS = ("nominal", "wide")
"""Of what training seeds draw."""


def add_parser(commands: Any) -> None:
    """Add `tune` to the command line."""
    parser = commands.add_parser("tune", help="tune a dosing controller, or measure its pour curve", epilog=EXAMPLE,
                                 description="Search the numbers of a dosing controller on training seeds, around "
                                 "those that the task names; or measure the pour curve of the task's tool. Writes a "
                                 "file for dose.controllers. Exit status 0 only if every episode ran.")
    parser.add_argument("task", help="a dosing task, such as DoseSpoon, or a task's .yaml file")
    parser.add_argument("--controller", choices=CONTROLLERS, default="pi", help="controller (default: pi)")
    parser.add_argument("--curve", action="store_true", help="measure the pour curve in a slow tilt instead")
    parser.add_number("--choices", help="choices of numbers, the given ones included (default: 30)")
    parser.add_number("--episodes", help="episodes of each choice (default: 12), or of the curve (default: 3)")
    parser.add_argument("--randomize", choices=PRESETS, help="what the episodes of a choice draw (default: nominal)")
    parser.add_number("--rate-deg", help="with --curve: tilt rate [deg/s] (default: 4)")
    parser.add_number("--most-deg", help="with --curve: last tilt [deg] (default: 120)")
    parser.add_number("--seed", default=0, help="random seed of the first episode")
    parser.add_material()
    parser.add_number("--jobs", default=1, help="choices that run at the same time")
    parser.add_out("tune.json or curve.json, and numbers.yaml; what is finished there is not repeated")
    parser.add_settings("task's file", "dose.target_g=[5,20]")
    parser.set_defaults(run=run, after_interrupt="finished choices and episodes are kept; the same command continues")


def run(options: argparse.Namespace) -> int:
    """Check the names, then search or measure."""
    is_task_file(options.task)
    if options.curve:
        refuse(options, "with --curve; accepted: without it", choices=None, randomize=None)
    else:
        refuse(options, "without --curve; accepted: with it", rate_deg=None, most_deg=None)
    with options.settings.changed("tasks", options.task, options.out) as task:
        if options.curve:
            from robosim.studies.tuning.curve import measure_curve

            return measure_curve(task, options.out, episodes=options.episodes or 3, rate_deg=options.rate_deg or 4.0,
                                 most_deg=options.most_deg or 120.0, seed=options.seed, material=options.material)
        from robosim.studies.tuning.search import SearchOptions, tune

        return tune(task, options.controller, options.out, SearchOptions(
            options.choices or 30, options.episodes or 12, options.seed, options.material,
            options.randomize or "nominal"), jobs=options.jobs)
