"""The command line: `robosim COMMAND`, with the commands of other packages from the entry points of a group."""

import argparse
import errno
import io
import re
import signal
import sys
import threading
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from importlib.metadata import entry_points, version
from typing import Any

import mpm
from mpm.files import quote
from robosim.base.errors import RobosimError, RobosimWarning, RobotDiverged
from robosim.base.files import describe_end
from robosim.base.jobs import SIGNALS
from robosim.base.resources import config_path
from robosim.commands.arguments import CommandParser

COMMANDS = {"rehearse": "runs.rehearse", "evaluate": "runs.evaluate", "view": "runs.view",
            "film": "runs.film", "convert": "runs.convert",
            "materials": "runs.materials", "chain": "runs.chain", "tune": "runs.tune", "calibrate": "runs.calibrate",
            "explain": "checks.explain", "report": "checks.report", "stability": "checks.stability",
            "bench": "checks.bench", "keys": "keys", "new": "new"}
"""Command -> the module of this package that adds it."""
GROUP = "robosim.commands"
"""Entry points of other packages' commands: functions that are given the parsers and add their own."""
REPEAT = 1.0
"""Time [s] after which an interrupt that was discarded is raised again. Signals within it are one interrupt: a process
may get SIGTERM with its group and from its parent, and the second would cut off what the first has written."""
LONG = re.compile(r"(\S{100})\S{100,}(\S{100})")
"""A path that is shortened in a message, like the values of others."""
EXAMPLE = """examples:
  robosim rehearse spoon --material sugar --out out/sugar
  robosim evaluate SpoonPour --policy scripted
  robosim COMMAND --help"""


def parser() -> argparse.ArgumentParser:
    """The commands and their options."""
    top = CommandParser(prog="robosim", usage="robosim COMMAND ... [--help] [--version]", epilog=EXAMPLE,
                        description="Simulate robot arms that handle granular material; train and evaluate policies.")
    top.add_argument("--version", action="version", version=f"robosim {version('robosim')}",
                     help="print the version and exit")
    # the metavar is as long as the longest name, on a line of its own otherwise
    commands = top.add_subparsers(dest="command", required=True, metavar="COMMAND ...", title="commands",
                                  prog="robosim")
    for module in COMMANDS.values():
        import_module(f"robosim.commands.{module}").add_parser(commands)
    for entry in entry_points(group=GROUP):
        try:
            entry.load()(commands)
        except (ImportError, AttributeError) as error:  # the other commands work without it
            print(f"robosim: the command {entry.name} ({entry.value}) cannot be loaded: {error}; install the package "
                  f"that offers it again", file=sys.stderr)
    return top


def main(arguments: list[str] | None = None) -> int:
    """Run a command; 0 when all is well, 1 for a run that failed, 2 for wrong input, 128 + n for signal n.
    Ctrl-C, SIGTERM and SIGHUP end a command alike: it raises KeyboardInterrupt, whose argument is the signal's name."""
    for stream in (sys.stdout, sys.stderr):  # a name of a model may be none of the terminal's characters
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    with interrupts() as received:
        try:
            return run_command(arguments)
        except KeyboardInterrupt:
            return 128 + (received[0] if received else signal.SIGINT)
        except Exception as error:  # an import that was cut off may leave half a module
            if not received:
                raise
            name = SIGNALS[signal.Signals(received[0]).name]
            print(f"robosim: stopped by {name} ({type(error).__name__}: {error})", file=sys.stderr)
            return 128 + received[0]


@contextmanager
def interrupts() -> Iterator[list[int]]:
    """Raise KeyboardInterrupt on each of SIGNALS that is not ignored or handled by others; give those received.
    It is raised again every REPEAT seconds unless it is being handled: a bare `except` of a library, or a finalizer,
    may have discarded it. Compiled code prints what it discards: not this, which is raised again."""
    received, began, hooks = list[int](), list[float](), (sys.excepthook, sys.unraisablehook)

    def interrupt(number: int, frame: object) -> None:
        now = time.monotonic()
        if received and now - began[-1] < REPEAT:
            return
        received.append(number)
        began.append(now)
        repeat(number, frame)
        raise KeyboardInterrupt(SIGNALS[signal.Signals(number).name])

    def repeat(number: int, frame: object) -> None:
        error = sys.exc_info()[1]
        while error is not None and not isinstance(error, KeyboardInterrupt):
            error = error.__context__
        if alarm in handlers:
            signal.setitimer(signal.ITIMER_REAL, REPEAT)
            if number == alarm and error is None:
                raise KeyboardInterrupt(SIGNALS[signal.Signals(received[-1]).name])

    alarm, handlers = getattr(signal, "SIGALRM", None), {}
    if threading.current_thread() is threading.main_thread():  # no other thread may set handlers
        for number in (getattr(signal, name) for name in SIGNALS if hasattr(signal, name)):
            if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):
                handlers[number] = signal.signal(number, interrupt)
        if alarm is not None and signal.getsignal(alarm) == signal.SIG_DFL:
            handlers[alarm] = signal.signal(alarm, repeat)
    sys.excepthook = lambda kind, error, trace: None if kind is KeyboardInterrupt else hooks[0](kind, error, trace)
    sys.unraisablehook = lambda lost: None if lost.exc_type is KeyboardInterrupt else hooks[1](lost)
    try:
        yield received
    finally:
        sys.excepthook, sys.unraisablehook = hooks
        if alarm in handlers:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
        for number, handler in handlers.items():
            signal.signal(number, handler)


def is_disk_full(error: BaseException | None) -> bool:
    """Return whether an error was raised because a disk, a quota or the largest size of a file was reached."""
    while error is not None and getattr(error, "errno", None) not in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
        error = error.__context__
    return error is not None


def run_command(arguments: list[str] | None) -> int:
    """Run a command; an error becomes a line on stderr and an exit status, a KeyboardInterrupt a line alone."""
    arguments = sys.argv[1:] if arguments is None else arguments
    top, usual = parser(), warnings.formatwarning
    for word in arguments:
        if re.search("[\ud800-\udfff]", word):  # no file of results can hold them
            top.error(f"{quote(word)}: not text in the encoding {sys.getfilesystemencoding()} of this terminal; "
                      f"accepted: text in it, or LC_ALL=C.UTF-8 for all characters")
    options = top.parse_args(arguments)

    def format_note(message: Warning | str, category: type[Warning], *place: Any) -> str:
        """Write our warnings as errors are written, in a line without a place in the code."""
        is_ours = issubclass(category, RobosimWarning)
        return f"robosim {options.command}: note: {message}\n" if is_ours else usual(message, category, *place)

    warnings.formatwarning = format_note
    try:
        if getattr(options, "field_threads", 1) > 1:
            mpm.init(threads=options.field_threads)
        if getattr(options, "material", None) is not None:
            config_path("materials", options.material, "material")
        return options.run(options)
    except (RobosimError, mpm.MpmError, OSError) as error:  # after an OSError files under their names are whole
        print(f"robosim {options.command}:", LONG.sub(r"\1...\2", str(error)), file=sys.stderr)
        if isinstance(error, OSError) and error.errno == errno.ENAMETOOLONG:
            return 2
        is_run = isinstance(error, (mpm.SimulationDiverged, mpm.GradientDiverged, RobotDiverged, OSError))
        return 1 if is_run or is_disk_full(error) else 2
    except KeyboardInterrupt as error:
        after = getattr(options, "after_interrupt", "")
        print(f"robosim {options.command}: {describe_end(error)}{'; ' if after else ''}{after}", file=sys.stderr)
        raise
    finally:
        warnings.formatwarning = usual


if __name__ == "__main__":
    sys.exit(main())
