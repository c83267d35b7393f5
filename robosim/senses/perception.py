"""What an environment observes: a layout of the published tasks, or terms that its user chooses.

The layouts are lists of terms. flat: position and velocity (n, 6) of every `observe_every`-th grain, row by row, then
tool pose and time; all: the same of every grain; positions, velocities: only these (n, 3); none: no grains; dict: the
terms in a dictionary; moments: statistics of all grains, whose number of entries does not depend on the number of
grains. In a dosing task the mass to dose [kg], "target", stands before the time.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Literal, NamedTuple, get_args

import gymnasium
import numpy as np

from robosim.base.errors import ConfigError, UnknownName
from robosim.senses.channel import DRAWN_TIMING, Timing
from robosim.senses.grains import GrainsTerm, ObservedGrains
from robosim.senses.motion import TargetTerm, TimeTerm, ToolTerm
from robosim.senses.senses import Choice, Senses, TermOptions, describe, read_choices
from robosim.senses.term import NOTHING, SenseScene, Sight, Term
from robosim.tasks.counting import observed_grains
from robosim.tasks.observation import DOSING_TERMS, SCOOPING_TERMS
from robosim.tasks.task import TaskConfig

Layout = Literal["flat", "dict", "moments", "positions", "velocities", "none", "all"]
GRAINS: dict[str, tuple[type[Term], dict[str, Any]]] = {
    "flat": (ObservedGrains, {}), "dict": (ObservedGrains, {}), "all": (GrainsTerm, {"every": True}),
    "positions": (ObservedGrains, {"layout": "positions"}), "velocities": (ObservedGrains, {"layout": "velocities"}),
    "moments": (GrainsTerm, {"layout": "moments"}),
}
"""Layout -> term of the grains, and its options."""
Terms = Layout | Sequence[TermOptions]
"""A layout of the published task, or a list of terms."""


class PerceptionOptions(NamedTuple):
    """The options of an environment that concern its observations."""

    obs: Terms | None = None
    """None: "flat", or of a dosing task the terms that tell what has been poured."""
    flatten: bool = False
    """Whether terms make up one array instead of a dictionary."""
    privileged: Sequence[TermOptions] = ()
    """Terms of `info["privileged"]`, for a critic or a teacher."""
    latency: float = 0.0
    noise: float = 0.0
    dropout: float = 0.0

    @property
    def timing(self) -> Mapping[str, float]:
        """What holds for all terms that do not say otherwise."""
        return {"latency": self.latency, "noise": self.noise, "dropout": self.dropout}


class Perception:
    """Reads the observations of one or more environments with the same task and options.

    It is complete after `build`. Raises UnknownName, ConfigError for options that cannot be used.
    """

    def __init__(self, task: TaskConfig, options: PerceptionOptions) -> None:
        if options.obs is None:
            dosing = "flat" if task.dose is None else DOSING_TERMS if task.receiver is not None else SCOOPING_TERMS
            options = options._replace(obs=dosing)
        assert options.obs is not None
        self._task, self.options = task, options
        self._is_layout = isinstance(options.obs, str)
        if isinstance(options.obs, str):
            if options.obs not in get_args(Layout):
                raise UnknownName("obs", options.obs, get_args(Layout), "or a list of terms")
            if options.flatten or any(options.timing.values()):
                given = ", ".join(f"{name} = {value}" for name, value in options.timing.items())
                raise ConfigError(f"obs = {options.obs!r} with flatten = {options.flatten}, {given}; accepted: with a "
                                  f"list of terms, such as obs=['tool', 'grains']")
            self._choices = choose_layout(options.obs, task)
        else:
            self._choices = read_choices(options.obs, options.timing)
        self._privileged = read_choices(options.privileged, {}, "privileged") if options.privileged else []
        self.grains = self._choose_grains()
        """Indices of the grains that are read."""

    def _choose_grains(self) -> np.ndarray:
        every, kinds = np.arange(self._task.grains.count), [one.kind for one in [*self._choices, *self._privileged]]
        if any(kind.all_grains for kind in kinds):
            return every
        return observed_grains(self._task) if ObservedGrains in kinds else every[:0]

    @property
    def reads_arm(self) -> bool:
        """Whether a term reads the arm's sensors of force."""
        return any(choice.kind.reads_sensors for choice in [*self._choices, *self._privileged])

    def build(self, scene: SenseScene) -> None:
        """Build the terms for a scene; raises ConfigError for one that needs what the scene does not have."""
        flat = self.options.flatten or (self._is_layout and self.options.obs != "dict")
        self._senses = Senses(scene, self._choices, flat=flat, is_layout=self._is_layout)
        self._teacher = Senses(scene, self._privileged) if self._privileged else None

    @property
    def space(self) -> gymnasium.Space[Any]:
        """The observation space."""
        return self._senses.space

    @property
    def slices(self) -> dict[str, slice]:
        """Name of each part of a flat observation -> its slice."""
        return self._senses.slices

    def describe(self) -> Any:
        """Return what a state of the environment depends on: plain values."""
        own = self.options.obs if self._is_layout else describe(self._choices)
        return own if not self._privileged else [own, describe(self._privileged)]

    @property
    def domains(self) -> dict[str, tuple[float, float]]:
        """Numbers of sensors that episodes may draw, "key.option", with their lowest and highest values."""
        return {f"{choice.key}.{name}": pair for choice in ([] if self._is_layout else self._choices)
                for name, pair in {**choice.kind.DRAWN, **DRAWN_TIMING}.items()
                if (choice.kind.name, name) != ("rgb", "noise")}

    def begin(self, sight: Sight, seed: int, drawn: Mapping[str, float] = NOTHING) -> Any:
        """Return the memory of an episode that starts now: arrays and plain values.

        seed: of what is random in it. drawn: numbers of `domains` that hold for it.
        """
        teacher = None if self._teacher is None else self._teacher.begin(sight, seed + 1)
        return [self._senses.begin(sight, seed, drawn), teacher]

    def read(self, sight: Sight, memory: Any) -> Any:
        """Return an observation in arrays of its own, and advance the memory."""
        return self._senses.read(sight, memory[0])

    def read_info(self, sight: Sight, memory: Any) -> dict[str, Any]:
        """Return the entry `privileged` of an info, if there are such terms."""
        return {} if self._teacher is None else {"privileged": self._teacher.read(sight, memory[1])}

    def close(self) -> None:
        """Free what terms hold."""
        self._senses.close()
        if self._teacher is not None:
            self._teacher.close()


class ExactTool(ToolTerm):
    """Where the tool is, whatever the robot takes it for."""

    def measure(self, sight: Sight, memory: Any, rng: np.random.Generator) -> np.ndarray:
        """Return the pose (7,), or the position (3,)."""
        return np.concatenate(sight.pose) if self._turns else sight.pose.position


def choose_layout(layout: str, task: TaskConfig) -> list[Choice]:
    """Return the terms of a layout."""
    kinds: dict[str, tuple[type[Term], dict[str, Any]]] = {"tool": (ExactTool, {}), "time": (TimeTerm, {})}
    if task.dose is not None:
        kinds = {"tool": (ExactTool, {}), "target": (TargetTerm, {}), "time": (TimeTerm, {})}
    if layout in GRAINS:
        kinds = {"particles": GRAINS[layout], **kinds}
    return [Choice(key, kind, options, Timing()) for key, (kind, options) in kinds.items()]
