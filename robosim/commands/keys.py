"""`robosim keys`: the keys of a configuration file, or its JSON Schema."""

import argparse
import json
from importlib import import_module
from typing import Any

from robosim.base.errors import UnknownName
from robosim.commands.arguments import one_of
from robosim.config.laws import MATERIAL_CLASSES

EXAMPLE = """examples:
  robosim keys rehearsal
  robosim keys task --schema > task.json"""
KINDS = {
    "rehearsal": "robosim.config.rehearsal:RehearsalConfig", "task": "robosim.tasks.task:TaskConfig",
    "dosing": "robosim.dosing.numbers:DosingNumbers", "arm": "robosim.config.arm:ArmConfig",
    "gripper": "robosim.config.arm:GripperConfig", "tool": "robosim.config.tool:ToolConfig",
    **{f"material.{law}": f"robosim.config.materials:{name}" for law, name in MATERIAL_CLASSES.items()},
    "measurements": "robosim.studies.calibration.measurements:MeasurementsConfig",
    **{f"experiment.{kind}": f"robosim.studies.calibration.measurements:{kind.capitalize()}Experiment"
       for kind in ("heap", "pour", "tilt", "shear", "cup", "scoop")},
}
"""Kind of file -> module and class of its schema."""


def add_parser(commands: Any) -> None:
    """Add `keys` to the command line."""
    parser = commands.add_parser("keys", help="list the keys of a configuration file", epilog=EXAMPLE,
                                 description="List the keys of a kind of configuration file: accepted values, default "
                                 "and meaning.")
    parser.add_argument("kind", help=f"kind of file: {one_of(KINDS, '')}")
    parser.add_argument("--schema", action="store_true", help="print the JSON Schema instead, with which editors "
                        "complete and check files")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Print the keys, or the schema."""
    if options.kind not in KINDS:
        raise UnknownName("kind", options.kind, KINDS)
    schema = import_name(KINDS[options.kind]).model_json_schema()
    if options.schema:
        print(json.dumps(schema, indent=2))
        return 0
    from robosim.base.output_folder import aligned
    from robosim.commands.description import keys_of

    rows = [list(key) for key in keys_of(schema, schema)]
    print(schema["description"], aligned([["key", "accepts", "default", "meaning"], *rows]), sep="\n\n")
    return 0


def import_name(place: str) -> Any:
    """Import what is at "module:name"."""
    module, _, name = place.partition(":")
    return getattr(import_module(module), name)
