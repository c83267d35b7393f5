"""`robosim view`: a run, a rehearsal or a recording in a browser."""

import argparse
from pathlib import Path
from typing import Any

from robosim.base.errors import ConfigError
from robosim.base.resources import config_names, config_path

EXAMPLE = """examples:
  robosim view out/sugar
  robosim view spoon --material sugar --out out/sugar
  robosim view lab.yaml --plan
  ssh -L 8080:127.0.0.1:8080 server robosim view out/sugar"""
PORT = 8080


def add_parser(commands: Any) -> None:
    """Add `view` to the command line."""
    parser = commands.add_parser("view", help="show a run, a rehearsal or a sub-task in a browser", epilog=EXAMPLE,
                                 description="Serve a page with robot, tool and grains: of a run that is finished or "
                                 "still goes on, or of a rehearsal that is begun here. Ctrl-C ends it.")
    parser.add_argument("what", metavar="RUN|REHEARSAL|TASK", help="folder of a run, a recording, or one of " +
                        ", ".join([*config_names("rehearsals"), *config_names("tasks")]) + "; or the .yaml file of a "
                        "rehearsal or a task")
    parser.add_argument("--plan", action="store_true", help="show the planned motion of a rehearsal, without grains; "
                        "waypoints can be dragged and saved back to its file")
    parser.add_material("the rehearsal's", "material of a rehearsal that is begun")
    parser.add_out("the results of a rehearsal that is begun (default: a temporary one, which is removed at the end)",
                   is_required=False)
    parser.add_number("--port", default=PORT, help="port that the page is served at, to this machine alone")
    parser.add_settings("rehearsal's file", "field.cell=0.004")
    parser.set_defaults(run=run, after_interrupt="")


def run(options: argparse.Namespace) -> int:
    """Check what is to be shown, then serve it until interrupted."""
    if options.plan:
        config_path("rehearsals", options.what, "rehearsal")
    elif Path(options.what).is_dir() or options.what.endswith((".rec", ".rec.part")):
        given = [name for name, value in (("--material", options.material), ("--out", options.out)) if value]
        if given or list(options.settings):
            raise ConfigError(f"{' '.join(given) or '--set'} with {options.what}: what was recorded does not change; "
                              f"accepted: with a rehearsal that is begun here")
    elif options.what not in config_names("tasks"):
        config_path("rehearsals", options.what, "run, recording, sub-task or rehearsal")
    from robosim.rehearsal.browser.view import view

    return view(options.what, plan=options.plan, material=options.material, out=options.out, port=options.port,
                settings=list(options.settings))
