"""The demonstrations of a run: their motions and starts, checked against what the method uses them for."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

import mpm
from policies.demonstrations.reading import demonstration_paths, read_demonstrations, read_start
from policies.learning.presets import Preset
from robosim.base.digests import digest


class DemonstrationSet(NamedTuple):
    """Demonstrations by file name; empty for a method without."""

    motions: dict[str, np.ndarray]
    """Actions (decisions, dimensions)."""
    starts: dict[str, tuple[int, dict[str, bool]]]
    """Seed and options of the reset that a motion begins with."""

    @property
    def first(self) -> np.ndarray | None:
        """The first motion, None where there is none."""
        return next(iter(self.motions.values()), None)

    def digests(self) -> dict[str, str]:
        """Return a digest of each motion."""
        return {name: digest(actions.tolist()) for name, actions in self.motions.items()}


def load_demonstrations(preset: Preset, folder: Path | None, decisions: int, action_repeat: int, dimensions: int,
                        task: str) -> DemonstrationSet:
    """Load the demonstrations of a folder, or of one file, for a method.

    Raises:
        mpm.InvalidValue: the method needs demonstrations and there are none, or the other way round, or a file does
            not fit the task.
    """
    if folder is None:
        if preset.needs_demonstrations:
            raise mpm.InvalidValue("this method learns from demonstrations; give their folder as --demos")
        return DemonstrationSet({}, {})
    if not preset.accepts_demonstrations:
        raise mpm.InvalidValue(f"--demos {folder}: this method takes no demonstrations; leave it out")
    return DemonstrationSet(read_demonstrations(folder, decisions, action_repeat, dimensions, task),
                            {path.name: read_start(path) for path in demonstration_paths(folder)})


def select_replayable(demonstrations: DemonstrationSet, preset: Preset, starts: str) -> DemonstrationSet:
    """Return the demonstrations without those that a replay could not begin at the episodes' start.

    A method that plays motions as they are (replay: all; residual: the first) needs those made for its start.

    Raises:
        mpm.InvalidValue: none is left.
    """
    is_replay = preset.learner == "replay"
    count = len(demonstrations.starts) if is_replay else int(preset.residual is not None)
    played = list(demonstrations.starts)[:count]
    elsewhere = [name for name in played if not demonstrations.starts[name][1]["nominal"]] if starts == "nominal" \
        else []
    if elsewhere and len(elsewhere) == len(played):
        raise mpm.InvalidValue(f"--demos: {', '.join(elsewhere)}: made for another start than the task's own, where "
                               f"this method plays it; accepted: the first of `robosim demo --nominal`")
    if not is_replay:
        return demonstrations
    return demonstrations._replace(motions={name: actions for name, actions in demonstrations.motions.items()
                                            if name not in elsewhere})
