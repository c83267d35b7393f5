"""`robosim export`: demonstrations as transitions in a dataset of Minari or of LeRobot."""

import argparse
from pathlib import Path
from typing import Any

from policies.commands.arguments import add_action_repeat, add_task
from policies.learning.names import check_task

EXAMPLE = """examples:
  robosim export SpoonPour --demos out/demo --out out/spoon_pour --obs moments
  robosim export SpoonPour --demos out/demo --out out/spoon_pour --obs moments --format lerobot"""


def add_parser(commands: Any) -> None:
    """Add `export` to the command line."""
    parser = commands.add_parser("export", help="write demonstrations as transitions, for other libraries",
                                 epilog=EXAMPLE, description="Replay demonstrations in the environment and write the "
                                 "transitions to a Minari dataset, to an HDF5 file in the same layout, or to a "
                                 "LeRobot dataset with pictures.")
    add_task(parser)
    parser.add_argument("--demos", type=Path, required=True, help="folder of `robosim demo`, or one .npz file")
    parser.add_out("the dataset, or a file that ends in .hdf5")
    parser.add_argument("--format", choices=["minari", "lerobot"], default="minari",
                        help="minari, or lerobot: parquet, mp4 and meta of version 3")
    parser.add_argument("--no-pictures", action="store_true", help="lerobot: without pictures of the task")
    parser.add_argument("--obs", default="flat", help="layout of the observations")
    add_action_repeat(parser)
    parser.add_settings("task's file", "grains.count=100")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Check the task's name, then export."""
    check_task(options.task)
    from policies.demonstrations.export import export, export_lerobot

    folder = options.out.with_suffix("") if options.out.suffix in (".hdf5", ".h5") else options.out
    given = {"obs": options.obs, "action_repeat": options.action_repeat}
    if options.format == "minari":  # names the task's file, with which its environment is made again
        with options.settings.changed("tasks", options.task, folder) as task:
            return export(task, options.demos, options.out, **given)
    with options.settings.changed("tasks", options.task, None) as task:
        return export_lerobot(task, options.demos, options.out, **given, with_pictures=not options.no_pictures)
