"""`robosim chain`: a rehearsal's recorded sub-tasks one after the other, without the arm."""

import argparse
from pathlib import Path
from typing import Any

from robosim.base.resources import config_names
from robosim.commands.arguments import one_of

EXAMPLE = """example:
  robosim chain spoon --material sugar --out out/chain"""


def add_parser(commands: Any) -> None:
    """Add `chain` to the command line."""
    parser = commands.add_parser("chain", help="replay a rehearsal's recorded sub-tasks in sequence, without the arm",
                                 description="Replay the recorded motions of a rehearsal's sub-tasks; each starts with "
                                 "the grains that the one before left in the tool. Exit status 0 only if the whole "
                                 "sequence could be replayed.", epilog=EXAMPLE)
    parser.add_argument("rehearsal", help=one_of(config_names("rehearsals")))
    parser.add_out("chain.json and chain.mp4")
    parser.add_material("the rehearsal's")
    parser.add_argument("--motions", type=Path, help="folder with a motion of each sub-task as TASK.npz (default: the "
                        "bundled motions)")
    parser.add_argument("--no-video", action="store_true", help="make no video")
    parser.add_settings("rehearsal's file", "recorded=[SpoonScoop,SpoonTranslate]")
    parser.add_threads()
    parser.set_defaults(run=run, after_interrupt="chain.json has the finished sub-tasks; the same command begins again")


def run(options: argparse.Namespace) -> int:
    """Check the names, then replay."""
    with options.settings.changed("rehearsals", options.rehearsal, options.out) as rehearsal:
        from robosim.studies.evaluation.motion_chain import run_chain

        return run_chain(rehearsal, options.out, material=options.material, motions=options.motions,
                         film=not options.no_video)
