"""What the parsers of all commands share: layout of help, form of errors, types of arguments."""

import argparse
from collections.abc import Iterable
from functools import partial
from typing import Any, NoReturn

from robosim.commands.settings import AddSetting, Settings


class CommandParser(argparse.ArgumentParser):
    """A parser that keeps the lines of its example, and whose errors are one line with the way to the help."""

    def __init__(self, **options: Any) -> None:
        layout = partial(argparse.RawDescriptionHelpFormatter, max_help_position=28)
        super().__init__(**{"formatter_class": layout, **options})

    def add_settings(self, what: str, example: str) -> None:
        """Add the option `--set` for the keys of a file; `options.settings` are those given, see `Settings`."""
        self.add_argument("--set", dest="settings", metavar="KEY=VALUE", action=AddSetting, default=Settings(),
                          help=f"replace a value of the {what}, such as {example}; may be given several times")

    def error(self, message: str) -> NoReturn:
        """Print what is wrong and exit with status 2."""
        self.exit(2, f"{self.prog}: {message}; see `{self.prog} --help`\n")


def one_of(names: Iterable[str], also: str = "or the path of a .yaml file") -> str:
    """The help of an argument that takes a name."""
    return f"one of {', '.join(names)}; {also}" if also else f"one of {', '.join(names)}"


def positive(text: str) -> int:
    """Read a whole number from 1 on."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r}; accepted: a whole number from 1 on")
    return int(text)


def seed(text: str) -> int:
    """Read a whole number from 0 on."""
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text!r}; accepted: a whole number from 0 on")
    return int(text)
