"""Waypoints that were moved, written back into a rehearsal's file."""

import io
from pathlib import Path
from typing import Any

import numpy as np
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedSeq
from ruamel.yaml.error import YAMLError

from mpm.files import write
from robosim.base.errors import ConfigError
from robosim.base.input_files import read_text
from robosim.base.resources import config_path
from robosim.config.rehearsal import RehearsalConfig, load_rehearsal
from robosim.config.settings import Setting

DIGITS = 4
"""Of a position in a file: a tenth of a millimetre."""


class WaypointFile:
    """A rehearsal's file, whose comments, order and layout stay when waypoints are saved."""

    def __init__(self, name: str, settings: list[Setting]) -> None:
        self.source = config_path("rehearsals", name, "rehearsal")
        self.is_bundled = self.source.suffix and not Path(name).is_file()
        self._settings = settings
        self.config: RehearsalConfig = load_rehearsal(name, settings=settings)

    def save(self, config: RehearsalConfig, names: list[str]) -> Path:
        """Write the positions of these waypoints; return the file.
        A bundled rehearsal becomes NAME.yaml in the working directory. Raises ConfigError where that exists, where the
        file has changed and no longer has these waypoints, or would not be accepted: it stays as it was then."""
        target = Path(f"{self.source.stem}.yaml") if self.is_bundled else self.source
        if self.is_bundled and target.exists():
            raise ConfigError(f"{target.resolve()}: exists; accepted: `robosim view {target} --plan` to edit it, or "
                              f"another working directory")
        text = replace_positions(read_text(self.source), self.source, config, names)

        def write_checked(path: Path) -> None:
            path.write_text(text, encoding="utf-8")
            try:
                load_rehearsal(str(path), settings=self._settings)
            except ConfigError as error:
                raise ConfigError(str(error).replace(str(path), str(target))) from None

        write(target, write_checked)
        self.source, self.is_bundled = target, False
        self.config = load_rehearsal(str(target), settings=self._settings)
        return target.resolve()


def replace_positions(text: str, source: Path, config: RehearsalConfig, names: list[str]) -> str:
    """Return the text of a rehearsal's file with the positions of some waypoints replaced by those of a configuration.
    Raises ConfigError where the file has no such waypoint."""
    editor: Any = YAML()
    editor.preserve_quotes, editor.width = True, 4096
    editor.indent(mapping=2, sequence=4, offset=2)
    try:
        table = editor.load(text)
        entries = {str(entry["name"]): entry for entry in table["waypoints"]}
    except (YAMLError, KeyError, TypeError) as error:
        raise ConfigError(f"{source}: cannot be read as a rehearsal: {error}") from None
    for waypoint in config.waypoints:
        if waypoint.name in names:
            if waypoint.name not in entries:
                raise ConfigError(f"{source}: has no waypoint {waypoint.name!r} any more; accepted: "
                                  f"{', '.join(entries)}; load it again")
            position = CommentedSeq([round(float(x), DIGITS) for x in waypoint.position])
            position.fa.set_flow_style()
            entries[waypoint.name]["position"] = position
    out = io.StringIO()
    editor.dump(table, out)
    return out.getvalue()


def move_waypoint(config: RehearsalConfig, name: str, position: np.ndarray) -> RehearsalConfig:
    """Return a configuration with a waypoint at a world position (3,) [m], given in the waypoint's own frame."""
    waypoints = []
    for waypoint in config.waypoints:
        if waypoint.name == name:
            local = position if waypoint.frame == "world" else \
                config.containers[waypoint.frame].pose.inverse().apply(position[None])[0]
            waypoint = waypoint.model_copy(update={"position": tuple(round(float(x), DIGITS) for x in local)})
        waypoints.append(waypoint)
    return config.model_copy(update={"waypoints": tuple(waypoints)})
