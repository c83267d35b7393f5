"""The option `--set KEY=VALUE` of commands that take a configuration file."""

import argparse
import contextlib
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from robosim.config.settings import Setting, read_setting, with_settings
from robosim.errors import ConfigError


class Settings(tuple[Setting, ...]):
    """The settings given to a command, in order; commands of other packages get them with their options."""

    def apply(self, table: dict[str, Any]) -> dict[str, Any]:
        """Copy a table with the settings in it; see `robosim.config.settings.with_settings`."""
        return with_settings(table, self)

    @contextlib.contextmanager
    def changed(self, kind: str, name: str, folder: Path | None) -> Iterator[str]:
        """Give the path of a copy of a configuration with the settings in it, or the name itself without settings.

        kind: "tasks" or "rehearsals". The copy stays in the folder, as NAME.yaml; with None it is temporary. Raises
        ConfigError for a setting that does not fit.
        """
        if not self:
            yield name
            return
        from robosim.config.loader import read
        from robosim.config.output import OutputFolder
        from robosim.config.resources import config_path

        source = config_path(kind, name, kind[:-1])
        self._check(kind, name)
        with tempfile.TemporaryDirectory() as temporary:
            out = OutputFolder(folder or Path(temporary))
            copy = out.path / f"{source.stem}.yaml"
            if copy.resolve() == source.resolve():
                raise ConfigError(f"--out {folder}: {source.name} with the settings would replace {source}; give "
                                  f"another folder")
            yield str(out.write_yaml(copy.name, self.apply(read(source))))  # pyright: ignore[reportArgumentType]

    def _check(self, kind: str, name: str) -> None:
        """Raise ConfigError unless the configuration is valid with the settings."""
        if kind == "tasks":
            from robosim.tasks.task import load_task

            load_task(name, self)
        else:
            from robosim.config.rehearsal import load_rehearsal

            load_rehearsal(name, settings=self)


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
