"""Options of a run of learning and of a search for demonstrations, whatever the task."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mpm

RATE = 0.05
"""Largest step of a search where no other is given, in actions of -1 to 1."""


def check_at_least(least: int, numbers: dict[str, int]) -> None:
    """Raise mpm.InvalidValue for the first of numbers by option that is below the least."""
    for name, number in numbers.items():
        if number < least:
            raise mpm.InvalidValue(f"{name} {number}; accepted: {least} or more")


def to_words(**options: Any) -> list[str]:
    """Return options as arguments of a command; None and False are left out, True is an option without a value."""
    return [word for name, value in options.items() if value is not None and value is not False
            for word in (f"--{name.replace('_', '-')}", *([] if value is True else [str(value)]))]


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
    randomize: str | None = None
    """What the episodes draw, from random starts: "wide", "hard" or a .yaml file of ranges; None: the task's."""
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
    trust: bool = False
    """Whether another user's checkpoint, which may execute code, is continued."""

    def __post_init__(self) -> None:
        check_at_least(0, {"--seed": self.seed})
        check_at_least(1, {"--action-repeat": self.action_repeat, "--n-envs": self.n_envs,
                           "--checkpoint-every": self.checkpoint_every, "--evaluate-every": self.evaluate_every})


@dataclass(frozen=True, kw_only=True)
class SearchOptions:
    """How demonstrations are searched for. Raises mpm.InvalidValue for numbers outside their range."""

    method: str = "descent"
    """"descent", gradient descent through the field, or "cmaes", CMA-ES on a spline."""
    material: str | None = None
    """Material of the search; None: a fluid, or clay where the tool is empty at the start."""
    iterations: int = 150
    """Largest number of iterations of a demonstration."""
    rate: float = RATE
    """Largest step of an iteration, in actions of -1 to 1."""
    action_repeat: int = 10
    """Control steps for which an action is repeated."""
    start: str | Path | None = None
    """Where the search begins: None (at rest), "script" (the task's script) or a .npz file with `actions`."""
    until: float | None = None
    """With the script, time [s] up to which its actions are followed and not changed."""
    limit: float | None = None
    """Bound on the entries of the state's adjoint in every substep; None: no bound."""
    arm_weight: float = 0.0
    """Weight of the penalty on motions beyond the arm's limits; 0: no penalty."""
    seed: int = 0
    """Seed of demonstration 0's start; demonstration k has seed + k."""
    nominal: bool = False
    """Whether demonstration 0 begins at the task's own start instead."""

    def __post_init__(self) -> None:
        check_at_least(1, {"--iterations": self.iterations, "--action-repeat": self.action_repeat})
        if self.seed < 0 or not 0 < self.rate <= 1 or not 0 <= self.arm_weight < math.inf:
            raise mpm.InvalidValue(f"--seed {self.seed}, --rate {self.rate}, --arm-weight {self.arm_weight}; accepted: "
                                   f"0 or more, above 0 up to 1, 0 or more")
