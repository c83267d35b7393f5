"""`robosim evaluate`: the score of a policy on a sub-task."""

import argparse
from pathlib import Path
from typing import Any

from robosim.base.errors import ConfigError, UnknownName
from robosim.base.resources import config_names, config_path, part_names, trained_network
from robosim.commands.arguments import one_of
from robosim.envs import BUNDLED, is_task_file, task_name
from robosim.studies.evaluation import NETWORK, POLICIES, SUITES

EXAMPLE = """examples:
  robosim evaluate SpoonPour --policy scripted --out out/pour
  robosim evaluate ShovelMove --policy learned --nominal --arm
  robosim evaluate SpoonPour --policy out/runs/pour --suite wide --out out/wide"""


def add_parser(commands: Any) -> None:
    """Add `evaluate` to the command line."""
    parser = commands.add_parser("evaluate", help="score a policy on a sub-task", epilog=EXAMPLE,
                                 description="Run episodes of a policy on a sub-task and print its scores.")
    parser.add_argument("task", help=one_of(BUNDLED, "or a task's .yaml file"))
    named = (*POLICIES, *([NETWORK] if with_network() else []))
    parser.add_argument("--policy", default="scripted", help=one_of(named, "or a .npz file with an "
                        "array `actions` or a network; with --suite also the folder of a training run (default: "
                        "scripted)"))
    parser.add_argument("--suite", choices=SUITES, help="score on a suite of held-out starts, beside the recorded "
                        "motion, the script and no motion, or in dosing tasks the three controllers: the task's own "
                        "starts (nominal); other places, fills, materials, frictions and errors of the robot (wide); "
                        "thirteen materials (materials)")
    parser.add_argument("--alone", action="store_true", help="with --suite: score no other policy")
    parser.add_number("--episodes",
                        help="number of episodes, with seeds from --seed on (default: 5; 1 with "
                        "--nominal; 50 with --suite)")
    parser.add_number("--seed", default=0, help="random seed of the first episode (default: 0)")
    parser.add_argument("--material", help="material: " + one_of(config_names("materials")) + " (default: the task's)")
    parser.add_argument("--nominal", action="store_true", help="start at the task's nominal start, without its random "
                        "displacement")
    parser.add_argument("--arm", action="store_true", help="move the tool with the whole arm")
    parser.add_argument("--grasp", choices=["weld", "friction"], default="weld", help="with --arm: tool welded to the "
                        "hand, or held by the fingers alone (default: weld)")
    parser.add_argument("--robot", help=f"with --arm: one of {', '.join(part_names('robots'))}; or an arm's .yaml "
                        "file (default: iiwa14)")
    parser.add_argument("--gripper", help="with --arm: a hand's name or .yaml file, or none (default: the arm's usual "
                        "one)")
    parser.add_argument("--out", type=Path, help="folder for evaluation.json and episode.mp4 (the first episode); "
                        "with --suite evaluation.csv, a row an episode, and a picture")
    parser.add_argument("--no-video", action="store_true", help="make no video")
    parser.add_settings("task's file", "grains.count=100")
    parser.add_threads()
    parser.set_defaults(run=run, after_interrupt="evaluation.json has the finished episodes; the same "
                        "command begins again")


def run(options: argparse.Namespace) -> int:
    """Check the names, then run the episodes."""
    is_task_file(options.task)
    if options.material is not None:
        config_path("materials", options.material, "material")
    if options.suite is not None:
        return run_suite(options)
    if options.alone:
        raise ConfigError("--alone without --suite; accepted: with one, such as --suite wide")
    options.policy = find_network(options.policy, options.task)
    check_policy(options.policy)
    with options.settings.changed("tasks", options.task, options.out) as task:
        from robosim.studies.evaluation.evaluate import evaluate

        return evaluate(task, options.policy, options.out, episodes=options.episodes, seed=options.seed,
                        film=not options.no_video, nominal=options.nominal, material=options.material,
                        arm=options.arm, grasp=options.grasp, robot=options.robot, gripper=options.gripper,
                        changed=changed_keys(options))


def run_suite(options: argparse.Namespace) -> int:
    """Run a suite of episodes."""
    given = [name for name, value in (("--nominal", options.nominal), ("--arm", options.arm), ("--seed", options.seed))
             if value]
    if given:
        raise ConfigError(f"{', '.join(given)} with --suite {options.suite}; accepted: without, a suite has starts of "
                          f"its own for the tool alone")
    if not Path(options.policy).is_dir():
        options.policy = find_network(options.policy, options.task)
        check_policy(options.policy)
    with options.settings.changed("tasks", options.task, options.out) as task:
        from robosim.studies.evaluation.suite_run import evaluate_suite

        return evaluate_suite(task, options.policy, options.suite, options.out, episodes=options.episodes,
                              material=options.material, changed=changed_keys(options), alone=options.alone)


def changed_keys(options: argparse.Namespace) -> set[str]:
    """Return the top-level keys of the task's file that the command changes."""
    return {setting.path[0] for setting in options.settings}


def find_network(name: str, task: str) -> str:
    """Return the file of a task's bundled network for "network", any other name as it is.

    Raises ConfigError for a task without one, where others have one.
    """
    tasks = with_network()
    if name != NETWORK or not tasks:
        return name
    path = trained_network(task_name(task))
    if path is None:
        raise ConfigError(f"policy {NETWORK}: none is bundled for {task}; accepted: for {', '.join(tasks)}; "
                          f"`robosim train` learns one")
    return str(path)


def with_network() -> list[str]:
    """Return the sub-tasks that a network is bundled for."""
    return [task for task in config_names("tasks") if trained_network(task)]


def check_policy(name: str) -> None:
    """Raise UnknownName unless a policy is a name or a file."""
    if name not in POLICIES and not Path(name).is_file():
        raise UnknownName("policy", name, POLICIES, "or the path of a .npz file with an array `actions` or a network")
