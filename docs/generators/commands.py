"""The command reference, from the parsers of the command line."""

import argparse
import re

from generators.markdown import table
from robosim.commands.main import parser


def option(action: argparse.Action, form: argparse.HelpFormatter) -> str:
    """How an argument is written on the command line."""
    if not action.option_strings:
        return f"`{form._format_args(action, action.metavar or action.dest)}`"
    name = ", ".join(action.option_strings)
    if action.nargs == 0:
        return f"`{name}`"
    return f"`{name} {form._format_args(action, (action.metavar or action.dest).upper())}`"


def meaning(action: argparse.Action) -> str:
    """The help of an argument with its default filled in."""
    text = action.help or ""
    values = {**vars(action), "prog": "robosim"}
    return re.sub(r"%\((\w+)\)s", lambda m: str(values.get(m[1], "")), text).replace("%%", "%")


def section(name: str, summary: str, command: argparse.ArgumentParser) -> str:
    """One command: summary, arguments, example."""
    form = argparse.HelpFormatter(prog="robosim")
    rows = [[option(a, form), meaning(a)] for a in command._actions
            if not isinstance(a, argparse._HelpAction) and a.help is not argparse.SUPPRESS]
    parts = [f"## `robosim {name}`\n", f"{summary[:1].upper()}{summary[1:]}.\n"]
    if rows:
        parts.append(table(["argument", "meaning"], rows))
    if command.epilog:
        parts.append(f"```text\n{command.epilog.strip()}\n```\n")
    return "\n".join(parts)


def page() -> str:
    """All commands in the order of `robosim --help`."""
    action = next(a for a in parser()._actions if isinstance(a, argparse._SubParsersAction))
    lines = {choice.dest: choice.help or "" for choice in action._choices_actions}
    overview = table(["command", "what it does"],
                     [[f"[`{name}`](#robosim-{name})", lines.get(name, "")] for name in action.choices])
    return overview + "\n" + "\n".join(section(name, lines.get(name, name), one)
                                       for name, one in action.choices.items())
