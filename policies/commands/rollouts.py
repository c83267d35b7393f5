"""`robosim rollouts`: rollouts of the simulator from which a graph network learns."""

import argparse
from typing import Any

from policies.commands.arguments import add_action_repeat, add_task
from policies.learning.names import check_task

EXAMPLE = """examples:
  robosim rollouts SpoonPour --episodes 200 --jobs 2 --out out/rollouts/SpoonPour
  robosim train gnn_cmaes SpoonPour --rollouts out/rollouts/SpoonPour --out out/runs/SpoonPour/gnn_cmaes/seed_0"""


def add_parser(commands: Any) -> None:
    """Add `rollouts` to the command line."""
    parser = commands.add_parser("rollouts", help="record rollouts for training a graph network", epilog=EXAMPLE,
                                 description="Simulate a sub-task with random starts and motions, and write the "
                                 "positions of grains and tool at every action.")
    add_task(parser)
    parser.add_out("the rollouts; those that are there are not repeated")
    parser.add_number("--episodes", default=200, help="number of rollouts")
    parser.add_material(what="material of the grains")
    add_action_repeat(parser, "; one frame each")
    parser.add_number("--seed", default=0, help="random seed of starts and motions")
    parser.add_number("--jobs", default=1, help="number of rollouts at the same time")
    parser.add_settings("task's file", "grains.count=100")
    parser.set_defaults(run=run, after_interrupt="finished rollouts are kept; the same command continues")


def run(options: argparse.Namespace) -> int:
    """Check the names, then make the rollouts."""
    check_task(options.task)
    with options.settings.changed("tasks", options.task, options.out) as task:
        from policies.dynamics.rollouts import make_rollouts

        return make_rollouts(task, options.out, episodes=options.episodes, material=options.material,
                             action_repeat=options.action_repeat, seed=options.seed, jobs=options.jobs)
