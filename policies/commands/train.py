"""`robosim train`: learn a sub-task, with or without demonstrations."""

import argparse
from pathlib import Path
from typing import Any

from policies.commands.arguments import add_action_repeat, add_task, take_options
from policies.learning.names import check_trainable
from policies.learning.options import TrainingOptions
from robosim.base.resources import config_names, config_path
from robosim.commands.arguments import one_of

EXAMPLE = """examples:
  robosim train dg_sac SpoonPour --demos out/demo/SpoonPour --seed 0 --out out/runs/SpoonPour/dg_sac/seed_0
  robosim train sac SpoonPour --set options.learning_rate=3e-4 --out out/runs/slow
  robosim train dagger ShovelMove --randomize wide --out out/runs/push
  robosim evaluate SpoonPour --policy out/runs/SpoonPour/dg_sac/seed_0/best.npz --nominal --out out/pour"""


def add_parser(commands: Any) -> None:
    """Add `train` to the command line."""
    parser = commands.add_parser("train", help="train a policy on a sub-task", epilog=EXAMPLE,
                                 description="Train a policy on a sub-task with one of the methods.")
    parser.add_argument("method", help=one_of(config_names("training")))
    add_task(parser, "a task's .yaml file; or an id of Gymnasium, such as Pendulum-v1")
    parser.add_out("the run; an interrupted run continues with the same command")
    parser.add_number("--seed", default=0, help="random seed")
    parser.add_argument("--demos", type=Path, help="folder with demonstration_*.npz, or one .npz file with `actions`")
    parser.add_argument("--rollouts", type=Path, help="folder of `robosim rollouts`, for methods with a graph network")
    parser.add_number("--episodes", help="largest number of episodes (default: the method's)")
    parser.add_material(what="material of the grains")
    parser.add_argument("--starts", choices=["nominal", "random"], default="nominal", help="start of the episodes: the "
                        "task's nominal start, or random within its ranges")
    parser.add_argument("--randomize", metavar="wide|hard|FILE", help="what every episode draws: a preset, or a .yaml "
                        "file of ranges, name: [lowest, highest]; its starts are random (default: the task's own)")
    add_action_repeat(parser)
    parser.add_argument("--obs", help="layout of the observation, or terms separated by commas, such as "
                        "goal_frame,time (default: the method's)")
    parser.add_number("--checkpoint-every", default=10, metavar="N", help="write a checkpoint after every N episodes; "
                      "an interrupted run writes its last one")
    parser.add_number("--evaluate-every", default=10, metavar="N", help="evaluate the policy without exploration after "
                      "every N episodes; the best one is kept")
    parser.add_number("--n-envs", default=1, metavar="N", help="sub-tasks that are simulated together, with as many "
                      "updates a transition as for one alone")
    parser.add_argument("--label", help="name of the run's line in `robosim tables`, for a method with changes "
                        "(default: the method)")
    parser.add_argument("--force", action="store_true", help="continue a run of another configuration or commit")
    parser.add_argument("--trust", action="store_true", help="continue from a checkpoint that another user or machine "
                        "wrote; it may execute code")
    parser.add_settings("method's file", "options.gamma=0.95")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Check the names, then train."""
    config_path("training", options.method, "method")
    check_trainable(options.task)
    from policies.methods.train import train
    from policies.results.pages import write_run_page

    o = options
    return train(o.method, o.task, o.out, take_options(TrainingOptions, o), episodes=o.episodes, obs=o.obs,
                 settings=o.settings, page=write_run_page)
