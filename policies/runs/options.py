"""Options of a run of learning, whatever its method and task."""

from dataclasses import dataclass
from pathlib import Path

import mpm


@dataclass(frozen=True, kw_only=True)
class TrainingOptions:
    """How a run is made. Raises mpm.InvalidValue for numbers outside their range."""

    seed: int = 0
    demos: Path | None = None
    """Folder of demonstrations, or one file."""
    rollouts: Path | None = None
    """Folder of `robosim rollouts`, for methods with a graph network."""
    material: str | None = None
    """Material of the grains; None: the task's."""
    starts: str = "nominal"
    """"nominal", the task's own start in every episode as in the paper, or "random" within its ranges."""
    action_repeat: int = 10
    """Control steps for which an action is repeated."""
    n_envs: int = 1
    """Sub-tasks that are simulated together, with as many updates a transition as for one alone."""
    checkpoint_every: int = 10
    """Episodes between two checkpoints on the disk."""
    evaluate_every: int = 10
    """Episodes between two evaluations of the deterministic policy."""
    label: str | None = None
    """Name of the run's line in tables; None: the method."""
    force: bool = False
    """Whether a folder that holds another run is continued."""

    def __post_init__(self) -> None:
        for name, least in (("seed", 0), ("action_repeat", 1), ("n_envs", 1), ("checkpoint_every", 1),
                            ("evaluate_every", 1)):
            if getattr(self, name) < least:
                raise mpm.InvalidValue(f"--{name.replace('_', '-')} {getattr(self, name)}; accepted: {least} or more")
