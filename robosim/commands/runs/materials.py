"""`robosim materials`: the score of one motion in thirteen materials."""

import argparse
from contextlib import ExitStack
from typing import Any

from robosim.commands.arguments import one_of
from robosim.envs import TASKS, is_task_file
from robosim.studies.policies import POLICIES, check_policy

EXAMPLE = """example:
  robosim materials SpoonTranslate ShovelMove --jobs 2 --out out/materials"""


def add_parser(commands: Any) -> None:
    """Add `materials` to the command line."""
    parser = commands.add_parser("materials", help="score one motion in thirteen materials", epilog=EXAMPLE,
                                 description="Replay one motion of each sub-task in thirteen materials, from the "
                                 "nominal start. Exit status 0 only if every episode ran.")
    parser.add_argument("tasks", nargs="*", metavar="TASK",
                        help=f"of {', '.join(TASKS)}; or a task's .yaml file (default: all bundled sub-tasks)")
    parser.add_argument("--policy", default="recorded", help=one_of(POLICIES, "or a .npz file with an array `actions` "
                        "(default: recorded, the bundled motions)"))
    parser.add_number("--jobs", default=1, help="number of episodes at the same time")
    parser.add_out("materials.json and .csv; episodes that are finished there are not repeated")
    parser.add_settings("tasks' files", "success.delivered=0.9")
    parser.add_launcher()
    parser.set_defaults(run=run, after_interrupt="finished episodes are kept; the same command continues")


def run(options: argparse.Namespace) -> int:
    """Check the names, then run the episodes."""
    for task in options.tasks:
        is_task_file(task)
    check_policy(options.policy)
    with ExitStack() as stack:
        tasks = [stack.enter_context(options.settings.changed("tasks", task, options.out))
                 for task in options.tasks or TASKS]
        from robosim.studies.evaluation.materials import materials

        return materials(tasks, options.out, name=options.policy, jobs=options.jobs,
                         launcher=options.find_launcher(options))
