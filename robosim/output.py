"""Files of a run: written beside and renamed, so that what is there is always whole."""

import json
import os
from collections.abc import Callable
from pathlib import Path

import yaml

from robosim.errors import ConfigError


def aligned(lines: list[list[str]]) -> str:
    """Lines of words in columns, for a terminal."""
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return "\n".join("  ".join(map(str.ljust, line, widths)).rstrip() for line in lines)


class OutputFolder:
    """The folder given as `--out`, checked before any work."""

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            path.mkdir(parents=True, exist_ok=True)
            probe = path / ".writable"
            probe.write_text("")
            probe.unlink()
        except OSError as error:
            raise ConfigError(f"--out {path}: cannot be written ({error.strerror}); give another folder") from None

    def write(self, name: str, writer: Callable[[Path], object]) -> Path:
        """Let `writer` write a file beside its place, then rename it; a failure leaves the old file as it was."""
        final = self.path / name
        beside = final.with_name(f".{final.stem}.part{final.suffix}")
        try:
            writer(beside)
            os.replace(beside, final)
        finally:
            beside.unlink(missing_ok=True)
        return final

    def clear(self, names: tuple[str, ...]) -> None:
        """Take away what an earlier run left."""
        for name in names:
            (self.path / name).unlink(missing_ok=True)

    def write_yaml(self, name: str, value: dict) -> Path:
        """A table in the order given."""
        text = yaml.safe_dump(value, sort_keys=False)
        return self.write(name, lambda path: path.write_text(text))

    def write_json(self, name: str, value: object) -> Path:
        """Indented JSON; refuses numbers that JSON does not know."""
        text = json.dumps(value, indent=2, allow_nan=False)
        return self.write(name, lambda path: path.write_text(text + "\n"))
