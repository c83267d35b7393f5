"""What an environment observes: a layout of the published task, or terms that its user chooses."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, get_args

import gymnasium
import numpy as np

from robosim.base.errors import ConfigError, UnknownName
from robosim.senses.channel import DRAWN_TIMING
from robosim.senses.senses import Choice, Senses, TermOptions, describe, read_choices, reads_all_grains
from robosim.senses.term import NOTHING, SenseScene, Sight
from robosim.tasks.counting import observed_grains
from robosim.tasks.observation import DOSING_TERMS, SCOOPING_TERMS, Layout, Observer
from robosim.tasks.task import TaskConfig

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
        self._choices: list[Choice] | None = None
        if isinstance(options.obs, str):
            if options.obs not in get_args(Layout):
                raise UnknownName("obs", options.obs, get_args(Layout), "or a list of terms")
            if options.flatten or any(options.timing.values()):
                given = ", ".join(f"{name} = {value}" for name, value in options.timing.items())
                raise ConfigError(f"obs = {options.obs!r} with flatten = {options.flatten}, {given}; accepted: with a "
                                  f"list of terms, such as obs=['tool', 'grains']")
        else:
            self._choices = read_choices(options.obs, options.timing)
        self._privileged = read_choices(options.privileged, {}, "privileged") if options.privileged else []
        self.grains = self._choose_grains()
        """Indices of the grains that are read."""

    def _choose_grains(self) -> np.ndarray:
        every = np.arange(self._task.grains.count)
        if reads_all_grains([*(self._choices or []), *self._privileged]) or self.options.obs in ("all", "moments"):
            return every
        return every[:0] if self._choices is not None or self.options.obs == "none" else observed_grains(self._task)

    @property
    def reads_arm(self) -> bool:
        """Whether a term reads the arm's sensors of force."""
        return any(choice.kind.reads_sensors for choice in [*(self._choices or []), *self._privileged])

    def build(self, scene: SenseScene) -> None:
        """Build the terms for a scene; raises ConfigError for one that needs what the scene does not have."""
        if self._choices is None:
            layout: Any = self.options.obs
            self._observer: Observer | Senses = Observer(self._task, scene.solver, layout)
        else:
            self._observer = Senses(scene, self._choices, flat=self.options.flatten)
        self._teacher = Senses(scene, self._privileged) if self._privileged else None

    @property
    def space(self) -> gymnasium.Space[Any]:
        """The observation space."""
        return self._observer.space

    @property
    def slices(self) -> dict[str, slice]:
        """Name of each part of a flat observation -> its slice."""
        return self._observer.slices

    def describe(self) -> Any:
        """Return what a state of the environment depends on: plain values."""
        own = self.options.obs if self._choices is None else describe(self._choices)
        return own if not self._privileged else [own, describe(self._privileged)]

    @property
    def domains(self) -> dict[str, tuple[float, float]]:
        """Numbers of sensors that episodes may draw, "key.option", with their lowest and highest values."""
        return {f"{choice.key}.{name}": pair for choice in self._choices or []
                for name, pair in {**choice.kind.DRAWN, **DRAWN_TIMING}.items()
                if (choice.kind.name, name) != ("rgb", "noise")}

    def begin(self, sight: Sight, seed: int, drawn: Mapping[str, float] = NOTHING) -> Any:
        """Return the memory of an episode that starts now: arrays and plain values.

        seed: of what is random in it. drawn: numbers of `domains` that hold for it.
        """
        return [one.begin(sight, seed + k, drawn if k == 0 else NOTHING) if isinstance(one, Senses) else None
                for k, one in enumerate((self._observer, self._teacher))]

    def read(self, sight: Sight, memory: Any) -> Any:
        """Return an observation in arrays of its own, and advance the memory."""
        if isinstance(self._observer, Senses):
            return self._observer.read(sight, memory[0])
        chosen = sight.grains
        if len(chosen) != len(self._observer.grains):  # more are read for privileged terms
            chosen = chosen[self._observer.grains]
        return self._observer.read(chosen, sight.pose, sight.counts, sight.progress, sight.setting.place,
                                   sight.setting.target_mass)

    def read_info(self, sight: Sight, memory: Any) -> dict[str, Any]:
        """Return the entry `privileged` of an info, if there are such terms."""
        return {} if self._teacher is None else {"privileged": self._teacher.read(sight, memory[1])}

    def close(self) -> None:
        """Free what terms hold."""
        for one in (self._observer, self._teacher):
            if isinstance(one, Senses):
                one.close()
