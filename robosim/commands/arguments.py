"""What the parsers of all commands share: layout of help, form of errors, bounds of numbers, the option `--set`."""

import argparse
import contextlib
import os
import re
import tempfile
from collections.abc import Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

from robosim.base.errors import ConfigError
from robosim.base.resources import config_names, config_path, locate_paths
from robosim.config.settings import Setting, read_setting, with_settings


class Number(NamedTuple):
    """The numbers that an option accepts; argparse calls it with the text that is given."""

    least: float
    most: float
    is_whole: bool = True

    def __call__(self, text: str) -> float:
        """Read a number; raises ArgumentTypeError, which argparse reports with the option, for all others."""
        with contextlib.suppress(ValueError):
            value = int(text) if self.is_whole and re.fullmatch(r"-?[0-9]{1,20}", text) else float(text)
            if self.least <= value <= self.most and (isinstance(value, int) or not self.is_whole):
                return value
        given = text if len(text) < 40 else f"{text[:40]}..."
        raise argparse.ArgumentTypeError(f"{given!r}; accepted: {'a whole number' if self.is_whole else 'a number'} "
                                         f"from {self.least:.10g} to {self.most:.10g}")


CORES = os.cpu_count() or 1
NUMBERS = {
    "--episode": Number(0, 1_000_000),  # of a dataset
    "--episodes": Number(1, 1_000_000),  # of 100 actions at 0.6 s each: two years
    "--n": Number(1, 10_000),  # at 5 minutes each, a month
    "--expert": Number(1, 100_000),  # two days at 2 s each
    "--iterations": Number(1, 100_000),  # a day for each demonstration, at 1 s each
    "--choices": Number(1, 10_000),  # of 12 doses at 30 s each: six weeks
    "--rate-deg": Number(0.5, 30.0, False),  # [deg/s]; a curve of 120 deg takes 4 s to 4 minutes
    "--most-deg": Number(10.0, 180.0, False),  # [deg]; at 180 the tool is upside down
    "--checkpoint-every": Number(1, 1_000_000),  # as episodes
    "--n-envs": Number(1, 4096),  # such a batch of 300 grains each takes 1 GB
    "--evaluate-every": Number(1, 1_000_000),
    "--action-repeat": Number(1, 10_000),  # 20 s at steps of 2 ms, ten episodes
    "--model-errors": Number(1, 2**31 - 1),  # as seeds; 0 is the exact model
    "--perturb": Number(1, 1000),  # at a minute each, 17 hours
    "--runs": Number(1, 1000),  # a Gaussian process of more takes longer than they do
    "--seed": Number(0, 2**31 - 1),  # numpy takes up to 2^32 - 1; later episodes have larger seeds
    "--sizes": Number(1, 4_000_000),  # grains; with 250 bytes each, 1 GB
    # a process has 0.5 GB; more of them than cores do not finish earlier
    "--jobs": Number(1, max(16, 4 * CORES)),
    "--threads": Number(1, max(16, 4 * CORES)),
    "--port": Number(1, 65_535),
    "--frame-rate": Number(1, 1000),  # a picture of every step of 1 ms
    "--rate": Number(1e-6, 1.0, False),  # actions reach from -1 to 1; below, single precision does not change them
    "--height": Number(144, 1080),  # pixels; the largest picture that scenes are compiled for
    "--poster": Number(0.0, 600.0, False),  # [s], as the longest motion
    "--begin": Number(0.0, 1e6, False), "--end": Number(0.0, 1e6, False),  # [s]
    "--time": Number(0.0, 1e6, False),  # [s]
    "--until": Number(1e-4, 600.0, False),  # [s], as the episode of a task
    "--limit": Number(1e-30, 1e30, False),  # numbers of single precision reach from 1e-38 to 1e38
    "--arm-weight": Number(0.0, 1e6, False),  # as the weights of a task's reward
    "--tolerance": Number(1e-6, 1.0, False),  # relative; results are in single precision
}
"""Option -> the numbers that it accepts in every command, with the reason."""


class Settings(tuple[Setting, ...]):
    """The settings given to a command, in order; commands of other packages get them with their options."""

    def apply(self, table: dict[str, Any]) -> dict[str, Any]:
        """Copy a table with the settings in it; see `robosim.config.settings.with_settings`."""
        return with_settings(table, self)

    @property
    def arguments(self) -> list[str]:
        """The settings as arguments of a command."""
        return [word for setting in self for word in ("--set", setting.text)]

    @contextlib.contextmanager
    def changed(self, kind: str, name: str, folder: Path | None) -> Iterator[str]:
        """Give the path of a copy of a configuration with the settings in it, or the name itself without settings.
        kind: "tasks" or "rehearsals". The copy stays in the folder, as NAME.yaml, unless the command is refused;
        with None it is temporary. Raises ConfigError for a setting that does not fit, and UnknownName."""
        source = config_path(kind, name, kind[:-1])
        if not self:
            yield name
            return
        from robosim.base.output_folder import LOCK, STATUS, OutputFolder
        from robosim.config.table import read

        self.check(kind, name)
        with tempfile.TemporaryDirectory() as temporary:
            is_new, out = folder is not None and not folder.exists(), OutputFolder(folder or Path(temporary))
            copy = out.path / f"{source.stem}.yaml"
            if copy.resolve() == source.resolve():
                raise ConfigError(f"--out {folder}: {source.name} with the settings would replace {source}; give "
                                  f"another folder")
            out.write_yaml(copy.name, locate_paths(self.apply(locate_paths(read(source), source.parent)), Path.cwd()))  # pyright: ignore[reportArgumentType]
            out.release()  # the command itself locks its folder
            try:
                yield str(copy)
            except BaseException:
                if not (out.path / STATUS).exists():  # refused before any work
                    copy.unlink(missing_ok=True)
                    if is_new and [one.name for one in out.path.iterdir()] == [LOCK]:
                        (out.path / LOCK).unlink()
                        out.path.rmdir()
                raise

    def check(self, kind: str, name: str) -> None:
        """Raise ConfigError unless a configuration is valid with the settings. kind: "tasks" or "rehearsals"."""
        from robosim.config.rehearsal import load_rehearsal
        from robosim.tasks.task import load_task

        (load_task if kind == "tasks" else load_rehearsal)(name, settings=self)


class AddSetting(argparse.Action):
    """Collects the values of `--set`."""

    def __call__(self, parser: argparse.ArgumentParser, namespace: argparse.Namespace, values: Any,
                 option_string: str | None = None) -> None:
        """Append one."""
        try:
            setting = read_setting(values)
        except ConfigError as error:
            parser.error(str(error))
        setattr(namespace, self.dest, Settings((*getattr(namespace, self.dest), setting)))


class CommandParser(argparse.ArgumentParser):
    """A parser that keeps the lines of its example, and whose errors are one line with the way to the help."""

    def __init__(self, **options: Any) -> None:
        layout = partial(argparse.RawDescriptionHelpFormatter, max_help_position=28)
        super().__init__(**{"formatter_class": layout, **options})

    def add_number(self, option: str, **more: Any) -> None:
        """Add an option that takes a number within the bounds of NUMBERS; more: as of `add_argument`."""
        self.add_argument(option, type=NUMBERS[option], **more)

    def add_argument(self, *names: Any, **more: Any) -> argparse.Action:
        """Add an argument as argparse does; its help ends in its default, if it says none."""
        if more.get("default") not in (None, argparse.SUPPRESS, ()) and "(default" not in more.get("help", "(default"):
            more["help"] += " (default: %(default)s)"
        return super().add_argument(*names, **more)

    def add_material(self, default: str = "the task's", what: str = "material") -> None:
        """Add the option `--material`, whose value `robosim` checks; default, what: in words."""
        self.add_argument("--material", help=f"{what}: {one_of(config_names('materials'))} (default: {default})")

    def add_out(self, files: str, is_required: bool = True) -> None:
        """Add the option `--out`: a folder for some files."""
        self.add_argument("--out", type=Path, required=is_required, help=f"folder for {files}")

    def add_threads(self) -> None:
        """Add the option `--threads`: of the field, which the command starts with them."""
        self.add_argument("--threads", dest="field_threads", type=NUMBERS["--threads"], default=1,
                          help="threads that the field is computed with (default: 1); results are the same to rounding")

    def add_launch(self, source: str = "the table `launch` of the file") -> None:
        """Add `--launch`; source: of the cluster's numbers, for the help."""
        from robosim.studies.clusters import LAUNCHERS

        self.add_argument("--launch", choices=LAUNCHERS, default="local", help="where the runs are made: here, or as "
                          f"jobs of SLURM, as {source} says (default: local)")

    def add_launcher(self) -> None:
        """Add `--launch` and `--launch-file` for a study; `options.find_launcher(options)` runs jobs, or is None."""

        def find_launcher(options: argparse.Namespace) -> Any:
            """Return what runs jobs elsewhere, or None."""
            from robosim.studies.clusters.slurm import find_launcher as find

            return find(options.launch, options.launch_file)

        self.add_launch("--launch-file")
        self.add_argument("--launch-file", type=Path, metavar="FILE", help="YAML file for --launch: partition, hours, "
                          "memory_gb, ... as in the table `launch` of a sweep")
        self.set_defaults(find_launcher=find_launcher)

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


def refuse(options: argparse.Namespace, why: str, **defaults: Any) -> None:
    """Raise ConfigError where one of these options has another value than its default; why: and what is accepted."""
    for name, default in defaults.items():
        if (value := getattr(options, name)) != default:
            given = "" if value is True else f"{value} "
            raise ConfigError(f"--{name.removeprefix('field_').replace('_', '-')} {given}{why}")
