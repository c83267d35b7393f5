"""Arguments that several commands of learning have, and the options that functions take from them."""

import argparse
from dataclasses import fields
from typing import Any

from robosim.base.resources import config_names
from robosim.commands.arguments import one_of


def add_task(parser: Any, also: str = "or a task's .yaml file") -> None:
    """Add the argument `task`; also: what it accepts besides bundled names, for the help."""
    parser.add_argument("task", help=one_of(config_names("tasks"), also))


def add_action_repeat(parser: Any, more: str = "") -> None:
    """Add `--action-repeat`; more: for the help."""
    parser.add_number("--action-repeat", default=10, help=f"steps of 2 ms for which an action is repeated{more}")


def take_options(kind: Any, options: argparse.Namespace) -> Any:
    """Return a dataclass of options with the values that were given under its fields' names."""
    return kind(**{field.name: getattr(options, field.name) for field in fields(kind)})
