"""`robosim explain`: what a scene is made of, what each part costs, and its cheapest setting."""

import argparse
from pathlib import Path
from typing import Any

from robosim.base.errors import UnknownName
from robosim.base.resources import config_names
from robosim.commands.arguments import one_of
from robosim.envs import BUNDLED

EXAMPLE = """examples:
  robosim explain SpoonPour
  robosim explain SpoonPour --tolerance 0.02 --out out/explain"""


def add_parser(commands: Any) -> None:
    """Add `explain` to the command line."""
    parser = commands.add_parser("explain", help="list the parts of a scene with their cost; find its cheapest setting",
                                 description="List the parts of a scene's simulation with the run time of each. With "
                                 "--tolerance, find the cheapest setting; exit status 0 only if there is one that is "
                                 "cheaper than the scene's own.", epilog=EXAMPLE)
    parser.add_argument("scene", help=one_of([*BUNDLED, *config_names("rehearsals")],
                                             "or the .yaml file of a task or a rehearsal"))
    parser.add_number("--tolerance",
                        help="also run the scene with settings from coarse to fine, and find "
                        "the cheapest one whose results differ from those of the finest by at most this: absolute for "
                        "fractions, relative for masses and forces")
    parser.add_number("--jobs", default=1, help="number of settings that run at the same time")
    parser.add_out("index.html and explain.json; settings that are finished there are not repeated", is_required=False)
    parser.add_settings("task's or rehearsal's file", "field.cell=0.01")
    parser.add_threads()
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Check the name, then explain the scene."""
    names = [*BUNDLED, *config_names("rehearsals")]
    if options.scene not in names and not Path(options.scene).is_file():
        raise UnknownName("scene", options.scene, names, "or the .yaml file of one")
    from robosim.tasks.task import is_task

    with options.settings.changed("tasks" if is_task(options.scene) else "rehearsals", options.scene,
                                  options.out) as scene:
        from robosim.studies.benchmarks.explain import explain

        return explain(scene, tolerance=options.tolerance, out=options.out, jobs=options.jobs)
