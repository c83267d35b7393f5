"""`robosim gradients`: growth and accuracy of derivatives backwards in time."""

import argparse
from contextlib import ExitStack
from typing import Any

from policies.demonstrations import TASKS
from policies.learning.names import check_task
from robosim.base.resources import config_names

EXAMPLE = """example:
  robosim gradients SpoonPour ShovelMove --jobs 2 --out out/gradients"""


def add_parser(commands: Any) -> None:
    """Add `gradients` to the command line."""
    parser = commands.add_parser("gradients", help="measure the growth of derivatives over time", epilog=EXAMPLE,
                                 description="Differentiate a rollout of each task's scripted motion in several "
                                 "materials, and compare the derivatives with finite differences.")
    parser.add_argument("tasks", nargs="*", metavar="TASK",
                        help=f"of {', '.join(config_names('tasks'))} (default: all)")
    parser.add_out("index.html and gradients.json; rollouts that are finished there are not repeated")
    parser.add_number("--jobs", default=1, help="number of rollouts at the same time")
    parser.add_settings("file of every task", "grains.count=100")
    parser.set_defaults(run=run, after_interrupt="finished tasks are kept; the same command continues")


def run(options: argparse.Namespace) -> int:
    """Check the names, then measure."""
    for task in options.tasks:
        check_task(task)
    with ExitStack() as stack:
        tasks = [stack.enter_context(options.settings.changed("tasks", task, options.out))
                 for task in options.tasks or TASKS]
        from policies.demonstrations.gradients import gradients

        return gradients(tasks, options.out, options.jobs)
