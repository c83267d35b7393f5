"""The demonstrations of a run, checked against what the method uses them for."""

from pathlib import Path

import mpm
from policies.demonstrations.reading import Demonstration, read_demonstrations
from policies.learning.presets import SEARCH, Preset


def load_demonstrations(preset: Preset, folder: Path | None, decisions: int, action_repeat: int, dimensions: int,
                        task: str) -> list[Demonstration]:
    """Load the demonstrations of a folder, or of one file, for a method; none for a method without.

    Raises mpm.InvalidValue where the method needs demonstrations and there are none, or the other way round, or a file
    does not fit the task.
    """
    if folder is None:
        if preset.needs_demonstrations:
            raise mpm.InvalidValue("this method learns from demonstrations; give their folder as --demos")
        return []
    if not preset.needs_demonstrations and preset.learner not in SEARCH:
        raise mpm.InvalidValue(f"--demos {folder}: this method takes no demonstrations; leave it out")
    return read_demonstrations(folder, decisions, action_repeat, dimensions, task)


def select_replayable(demonstrations: list[Demonstration], preset: Preset, starts: str) -> list[Demonstration]:
    """Return the demonstrations without those that a replay could not begin at the episodes' start.

    A method that plays motions as they are (replay: all; residual: the first) needs those made for its start; raises
    mpm.InvalidValue where none is left.
    """
    is_replay = preset.learner == "replay"
    played = demonstrations if is_replay else demonstrations[: int(preset.residual is not None)]
    elsewhere = [one.name for one in played if starts == "nominal" and not one.options["nominal"]]
    if elsewhere and len(elsewhere) == len(played):
        raise mpm.InvalidValue(f"--demos: {', '.join(elsewhere)}: made for another start than the task's own, where "
                               f"this method plays it; accepted: the first of `robosim demo --nominal`")
    return [one for one in demonstrations if one.name not in elsewhere] if is_replay else demonstrations
