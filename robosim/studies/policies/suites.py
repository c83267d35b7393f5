"""Suites: the starts and materials that policies are scored from, the same for all of them.

nominal: the task's own material and random starts. wide: what `robosim.randomization.ranges.wide_ranges` draws, all at
once: materials, fills, places, starts, frictions, and where the tool sits in the hand. materials: the task's own random
starts in thirteen materials. hard: what `hard_ranges` draws, in materials that "wide" and "hard" do not train in, with
half the target, a delay and noise."""

from typing import Any, NamedTuple

from robosim.base.errors import ConfigError, UnknownName
from robosim.envs.grain_env import GrainEnv
from robosim.randomization.materials import MATERIALS
from robosim.studies.policies import SUITES
from robosim.tasks.task import TaskConfig

HELD_OUT = 1_000_000
"""Seed of the first episode of a suite; training draws its seeds from all 32-bit numbers, so that one in four thousand
million is one of these, and selects its best policy on seeds from 2 000 000 on."""


class Start(NamedTuple):
    """How one episode of a suite begins."""

    seed: int
    material: str
    numbers: tuple[tuple[str, float], ...] = ()
    """Of the material, in place of its own."""
    label: str = ""
    """Name of the material with these numbers."""
    randomize: str = "nominal"
    """Preset of what the seed draws."""

    @property
    def world(self) -> tuple[Any, ...]:
        """What starts share that one environment can make."""
        return self.material, self.numbers, self.randomize


def plan_starts(suite: str, task: TaskConfig, episodes: int, material: str | None = None) -> list[Start]:
    """Return the starts of a suite, the same for every policy.
    material: in place of the task's own, in the suite "nominal". A shorter suite is the beginning of a longer one.
    Raises UnknownName for a suite that does not exist."""
    if suite not in SUITES:
        raise UnknownName("suite", suite, SUITES)
    own, labels = material or task.material, list(MATERIALS)
    starts = []
    for k in range(episodes):
        if suite == "materials":
            label = labels[k % len(labels)]
            base, numbers = MATERIALS[label]
            starts.append(Start(HELD_OUT + k, base, tuple(numbers.items()), label))
        else:
            starts.append(Start(HELD_OUT + k, own, label=own, randomize="hard_unseen" if suite == "hard" else suite))
    return starts


def make_environment(task: TaskConfig, start: Start, **options: Any) -> GrainEnv:
    """Make the environment that episodes with a start's material and ranges run in.
    Raises ConfigError for ranges that it cannot draw, by the name of the suite."""
    try:
        return GrainEnv(task=task, material=start.material, randomize=start.randomize, **dict(start.numbers), **options)
    except ConfigError as error:
        raise ConfigError(f"suite {start.randomize.removesuffix('_unseen')}: {error}") from None


def begin_episode(env: GrainEnv, start: Start) -> dict[str, Any]:
    """Reset the environment to a start; return what a row of results says of it."""
    _, info = env.reset(seed=start.seed)
    draw = info["draw"]
    return {"seed": start.seed, "material": draw["material"] or start.label,
            **{name: round(value, 5) for name, value in draw["numbers"].items()}}
