"""What an environment observes: a layout of the published tasks, or terms that its user chooses.

The layouts are lists of terms. flat: position and velocity (n, 6) of every `observe_every`-th grain, row by row, then
tool pose and time; all: the same of every grain; positions, velocities: only these (n, 3); none: no grains; dict: the
terms in a dictionary; moments: statistics of all grains, whose number of entries does not depend on the number of
grains. In a dosing task the mass to dose [kg], "target", stands before the time."""

from collections.abc import Mapping, Sequence
from typing import Any, Literal, get_args

import numpy as np

from robosim.base.errors import ConfigError, UnknownName
from robosim.senses.grains import GrainsTerm, ObservedGrains
from robosim.senses.motion import TargetTerm, TimeTerm, ToolTerm
from robosim.senses.senses import DRAWN_TIMING, TERMS, Choice, Senses, TermOptions, Timing, describe, read_choices
from robosim.senses.term import NOTHING, SenseScene, Sight, Term
from robosim.tasks.counting import observed_grains
from robosim.tasks.observation import dose_terms
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


def observation_options(text: str) -> dict[str, Any]:
    """Return an environment's options for the terms of a text, separated by commas, or else the layout it names."""
    names = text.split(",")
    return {"obs": names, "flatten": True} if set(names) & set(TERMS) else {"obs": text}


class Perception:
    """Reads the observations of one or more environments with the same task and options; complete after `build`.

    obs: None: "flat", or of a dosing task the terms that tell what has been poured. flatten: whether terms make up one
    array instead of a dictionary. privileged: terms of `info["privileged"]`, for a critic or a teacher. timing:
    latency, noise, dropout of all terms that do not say otherwise.
    Raises UnknownName, ConfigError for options that cannot be used."""

    def __init__(self, task: TaskConfig, obs: Terms | None = None, *, flatten: bool = False,
                 privileged: Sequence[TermOptions] = (), timing: Mapping[str, float] = NOTHING) -> None:
        if obs is None:
            obs = "flat" if task.dose is None else dose_terms(task)
        self._layout = obs if isinstance(obs, str) else ""
        if self._layout:
            if self._layout not in get_args(Layout):
                raise UnknownName("obs", obs, get_args(Layout), f"or a list of {', '.join(TERMS)}")
            if flatten or any(timing.values()):
                given = ", ".join(f"{name} = {value}" for name, value in timing.items())
                raise ConfigError(f"obs = {obs!r} with flatten = {flatten}, {given}; accepted: with a list of terms, "
                                  f"such as obs=['tool', 'grains']")
            kinds: dict[str, tuple[type[Term], dict[str, Any]]] = {"tool": (ExactTool, {}), "time": (TimeTerm, {})}
            if task.dose is not None:
                kinds = {"tool": (ExactTool, {}), "target": (TargetTerm, {}), "time": (TimeTerm, {})}
            if self._layout in GRAINS:
                kinds = {"particles": GRAINS[self._layout], **kinds}
            self._choices = [Choice(key, kind, own, Timing()) for key, (kind, own) in kinds.items()]
        else:
            self._choices = read_choices(obs, timing)
        self.names = self._layout or ",".join(choice.key for choice in self._choices)
        """The layout, or the terms separated by commas, as `observation_options` reads them."""
        self._privileged = read_choices(privileged, {}, "privileged") if privileged else []
        self._flat = flatten or self._layout not in ("", "dict")
        chosen, every = [one.kind for one in [*self._choices, *self._privileged]], np.arange(task.grains.count)
        self.reads_arm = any(kind.reads_sensors for kind in chosen)
        """Whether a term reads the arm's sensors of force."""
        self.grains = every if any(kind.all_grains for kind in chosen) else \
            observed_grains(task) if ObservedGrains in chosen else every[:0]
        """Indices of the grains that are read."""

    def build(self, scene: SenseScene) -> None:
        """Build the terms for a scene; raises ConfigError for one that needs what the scene does not have."""
        self._senses = Senses(scene, self._choices, flat=self._flat, is_layout=bool(self._layout))
        self._teacher = Senses(scene, self._privileged) if self._privileged else None
        self.space, self.slices = self._senses.space, self._senses.slices
        """The observation space; name of each part of a flat observation -> its slice."""

    def describe(self) -> Any:
        """Return what a state of the environment depends on: plain values."""
        own = self._layout or describe(self._choices)
        return own if not self._privileged else [own, describe(self._privileged)]

    @property
    def domains(self) -> dict[str, tuple[float, float]]:
        """Numbers of sensors that episodes may draw, "key.option", with their lowest and highest values."""
        return {f"{choice.key}.{name}": pair for choice in ([] if self._layout else self._choices)
                for name, pair in {**choice.kind.DRAWN, **DRAWN_TIMING}.items()
                if (choice.kind.name, name) != ("rgb", "noise")}

    def begin(self, sight: Sight, seed: int, drawn: Mapping[str, float] = NOTHING) -> Any:
        """Return the memory of an episode that starts now; seed: of its noise. drawn: its numbers of `domains`."""
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
        return np.concatenate(sight.pose) if self._turns else sight.pose.position
