"""`robosim evaluate`: the score of a policy on a sub-task."""

import argparse
from pathlib import Path
from typing import Any

from robosim.base.errors import ConfigError
from robosim.base.resources import config_names, part_names, trained
from robosim.commands.arguments import one_of, refuse
from robosim.envs import BUNDLED, is_task_file, task_name
from robosim.studies.policies import NETWORKS, POLICIES, SUITES, check_policy

EXAMPLE = """examples:
  robosim evaluate SpoonPour --policy scripted --out out/pour
  robosim evaluate ShovelMove --policy recorded --nominal --arm
  robosim evaluate SpoonPour --policy out/runs/pour --suite wide --out out/wide"""


def add_parser(commands: Any) -> None:
    """Add `evaluate` to the command line."""
    parser = commands.add_parser("evaluate", help="score a policy on a sub-task", epilog=EXAMPLE,
                                 description="Run episodes of a policy on a sub-task and print its scores.")
    parser.add_argument("task", help=one_of(BUNDLED, "or a task's .yaml file"))
    named = (*POLICIES, *(name for name in NETWORKS if with_network(name)))
    parser.add_argument("--policy", default="scripted", help=one_of(named, "or a .npz file with an "
                        "array `actions` or a network; with --suite also the folder of a training run (default: "
                        "scripted)"))
    parser.add_argument("--suite", choices=SUITES, help="score on a suite of held-out starts, beside the recorded "
                        "motion, the script and no motion, or in dosing tasks the three controllers: the task's own "
                        "starts (nominal); other places, fills, materials, frictions and errors of the robot (wide); "
                        "thirteen materials (materials); far places, half the target, a delay, noise and materials "
                        "that no preset trains in (hard)")
    parser.add_argument("--beside", nargs="+", default=[], metavar="POLICY", help="with --suite: policies to score "
                        "from the same starts, such as a run of bc on the same demonstrations")
    parser.add_argument("--alone", action="store_true", help="with --suite: score no other policy")
    parser.add_number("--episodes",
                        help="number of episodes, with seeds from --seed on (default: 5; 1 with "
                        "--nominal; 50 with --suite)")
    parser.add_number("--seed", default=0, help="random seed of the first episode")
    parser.add_material()
    parser.add_argument("--nominal", action="store_true", help="start at the task's nominal start, without its random "
                        "displacement")
    parser.add_argument("--arm", action="store_true", help="move the tool with the whole arm")
    parser.add_argument("--grasp", choices=["weld", "friction"], default="weld", help="with --arm: tool welded to the "
                        "hand, or held by the fingers alone (default: weld)")
    parser.add_argument("--robot", help=f"with --arm: one of {', '.join(part_names('robots'))}; or an arm's .yaml "
                        "file (default: iiwa14)")
    parser.add_argument("--gripper", help="with --arm: a hand's name or .yaml file, or none (default: the arm's usual "
                        "one)")
    parser.add_out("evaluation.json and episode.mp4 (the first episode); "
                        "with --suite evaluation.csv, a row an episode, and a picture", is_required=False)
    parser.add_argument("--no-video", action="store_true", help="make no video")
    parser.add_settings("task's file", "grains.count=100")
    parser.add_threads()
    parser.set_defaults(run=run, after_interrupt="evaluation.json has the finished episodes; the same "
                        "command begins again")


def run(options: argparse.Namespace) -> int:
    """Check the names, then run the episodes, or a suite of them."""
    is_task_file(options.task)
    if options.suite is None:
        refuse(options, "without --suite; accepted: with one, such as --suite wide", alone=False, beside=[])
    else:
        refuse(options, f"with --suite {options.suite}; accepted: without, a suite has starts of its own",
               nominal=False, seed=0)
    policies = [find_network(policy, options.task) for policy in (options.policy, *options.beside)]
    for policy in policies:
        if options.suite is None or not Path(policy).is_dir():
            check_policy(policy)
    names = ("episodes", "material", "arm", "grasp", "robot", "gripper")
    given: dict[str, Any] = {name: getattr(options, name) for name in names}
    given["changed"] = {setting.path[0] for setting in options.settings}
    with options.settings.changed("tasks", options.task, options.out) as task:
        if options.suite is not None:
            from robosim.studies.evaluation.suite_run import evaluate_suite

            return evaluate_suite(task, policies, options.suite, options.out, alone=options.alone, **given)
        from robosim.studies.evaluation.evaluate import evaluate

        return evaluate(task, policies[0], options.out, seed=options.seed, film=not options.no_video,
                        nominal=options.nominal, **given)


def find_network(name: str, task: str) -> str:
    """Return the file of a task's policy for a name of NETWORKS, another name as it is; raises ConfigError without."""
    tasks = with_network(name)
    if not tasks:
        return name
    path = trained(task_name(task), NETWORKS[name])
    if path is None:
        raise ConfigError(f"policy {name}: none is bundled for {task}; accepted: for {', '.join(tasks)}; "
                          f"`robosim train` learns one")
    return str(path)


def with_network(name: str) -> list[str]:
    """Return the sub-tasks that a policy of a name of NETWORKS is bundled for."""
    return [task for task in config_names("tasks") if name in NETWORKS and trained(task, NETWORKS[name])]
