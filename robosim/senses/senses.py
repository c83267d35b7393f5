"""The observation of an environment: terms that its user chooses, each with rate, latency, noise and dropout."""

import inspect
from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import Any, NamedTuple

import gymnasium
import numpy as np

from robosim.base.errors import ConfigError, UnknownName
from robosim.senses.term import NOTHING, SenseScene, Sight, Term, check_option

TIMING = ("rate", "latency", "noise", "dropout")
"""Options that every term has besides its own."""
DRAWN_TIMING = {"latency": (0.0, 10.0), "noise": (0.0, 1e6), "dropout": (0.0, 0.999)}
"""Those that episodes may draw, with their lowest and highest values; a latency of 10 s is half an episode."""
ROUNDING = 1e-9
"""Tolerance [s] of times that are sums of steps."""
TERMS = {
    "grains": "grains.GrainsTerm", "goal_frame": "grains.GoalFrameTerm",
    "tool": "motion.ToolTerm", "goal": "motion.GoalTerm", "time": "motion.TimeTerm", "pending": "motion.PendingTerm",
    "joints": "arm.JointsTerm", "torques": "arm.TorquesTerm", "wrist": "arm.WristTerm", "scale": "scale.ScaleTerm",
    "height_map": "height_map.HeightMapTerm", "depth": "pictures.DepthTerm", "rgb": "pictures.RgbTerm",
    "point_cloud": "pictures.PointCloudTerm", "target": "motion.TargetTerm",
}
"""Name -> class in robosim.senses, imported when it is chosen: cameras need MuJoCo, an environment does not."""
NOT_DELAYED = ("grains", "time", "goal", "target", "pending")
"""Terms that an environment's own latency, noise and dropout leave as they are; options of their own hold."""
MOST_TERMS = 32

TermOptions = str | Mapping[str, Any]
"""A term's name, or {"name": name, "key": its name in the observation, options of the term and of its timing}."""


class Timing(NamedTuple):
    """How a sensor's values reach the policy."""

    rate: float | None = None
    """Values per second; None: one for each action. Between two values the last one is repeated."""
    latency: float = 0.0
    """Age [s] that a value has when it is delivered; the first of an episode is delivered at once."""
    noise: float = 0.0
    """Standard deviation of white noise, in the term's units."""
    dropout: float = 0.0
    """Probability that a value is lost; the one before is repeated."""


def read_timing(term: str, options: dict[str, Any]) -> Timing:
    """Take the options TIMING out of a term's options; raises ConfigError for numbers that cannot be used."""
    rate = options.pop("rate", None)
    return Timing(None if rate is None else check_option(term, "rate", rate, 1e-3, 1e6),
                  *(check_option(term, name, options.pop(name, 0.0), *pair) for name, pair in DRAWN_TIMING.items()))


class Channel:
    """A term with its timing; is_exact: whether values beyond the space's bounds are passed on and not cut there."""

    def __init__(self, term: Term, timing: Timing, is_exact: bool = False) -> None:
        if timing.noise > 0.0 and term.space.dtype == np.uint8:
            raise ConfigError(f"obs: {term.name}: noise = {timing.noise}; accepted: 0, or a term of real numbers")
        self.term, self.space, self.timing, self._is_exact = term, term.space, timing, is_exact

    def begin(self, sight: Sight, drawn: Mapping[str, float] = NOTHING) -> dict[str, Any]:
        """Return the memory of an episode that starts now; drawn: options of timing and term that hold for it."""
        timing = self.timing._replace(**{name: drawn[name] for name in DRAWN_TIMING if name in drawn})
        of_term = {name: value for name, value in drawn.items() if name in self.term.DRAWN}
        return {"term": self.term.begin(sight, of_term), "line": [], "delivered": None, "next": sight.time,
                "timing": timing._asdict()}

    def read(self, sight: Sight, memory: dict[str, Any], rng: np.random.Generator) -> np.ndarray:
        """Return the value that the policy gets now, in an array of its own."""
        timing, line = Timing(**memory["timing"]), memory["line"]
        if sight.time >= memory["next"] - ROUNDING:
            line.append((sight.time, self._measure(sight, memory, timing.noise, rng)))
            memory["next"] = sight.time if timing.rate is None else memory["next"] + 1.0 / timing.rate
        while len(line) > 1 and line[1][0] <= sight.time - timing.latency + ROUNDING:
            line.pop(0)
        lost = timing.dropout > 0.0 and memory["delivered"] is not None and rng.uniform() < timing.dropout
        if not lost:
            memory["delivered"] = line[0][1]
        return np.array(memory["delivered"])

    def _measure(self, sight: Sight, memory: dict[str, Any], noise: float, rng: np.random.Generator) -> np.ndarray:
        value = np.asarray(self.term.measure(sight, memory["term"], rng))
        if noise > 0.0:
            value = value + noise * rng.standard_normal(value.shape)
        if value.dtype != self.space.dtype:
            value = value if self._is_exact else np.clip(value, self.space.low, self.space.high)
            value = value.astype(self.space.dtype)
        return value


class Choice(NamedTuple):
    """A term as it was chosen, not yet built."""

    key: str
    """Its name in the observation."""
    kind: type[Term]
    options: dict[str, Any]
    timing: Timing


def read_choices(terms: Sequence[TermOptions], common: Mapping[str, Any], what: str = "obs") -> list[Choice]:
    """Return the terms that a list chooses; common: latency, noise, dropout of all terms.
    Raises UnknownName for a term that does not exist, ConfigError for a list or options that cannot be used."""
    if isinstance(terms, str) or not 1 <= len(terms) <= MOST_TERMS:
        raise ConfigError(f"{what} = {terms!r}; accepted: a list of 1 to {MOST_TERMS} terms of: "
                          f"{', '.join(sorted(TERMS))}")
    choices: list[Choice] = []
    for given in terms:
        options = dict(given) if isinstance(given, Mapping) else {"name": given}
        name = options.pop("name", None)
        if not isinstance(name, str) or name not in TERMS:
            raise UnknownName(f"term in {what}", name, TERMS)
        key = options.pop("key", name)
        if any(key == choice.key for choice in choices):
            raise ConfigError(f"{what}: two terms are named {key!r}; accepted: another \"key\" for one of them")
        shared = {} if name in NOT_DELAYED else {k: v for k, v in common.items() if v}
        options = shared | options
        timing = read_timing(name, options)
        choices.append(Choice(str(key), find_term(name), options, timing))
    return choices


def find_term(name: str) -> type[Term]:
    """Return the class of a term by its name."""
    module, _, kind = TERMS[name].partition(".")
    return getattr(import_module(f"robosim.senses.{module}"), kind)


def accepted_options(kind: type[Term]) -> list[str]:
    """Return the names of the options of a term, those of its timing included."""
    names: list[str] = []
    for base in kind.__mro__:
        if "__init__" in vars(base) and issubclass(base, Term):
            parameters = inspect.signature(vars(base)["__init__"]).parameters.values()
            named = [one.name for one in parameters if one.kind != one.VAR_KEYWORD]
            names += [one for one in named if one not in ("self", "scene")]
            if len(named) == len(parameters):
                break
    return [*names, *TIMING, "key"]


class Senses:
    """Observations of chosen terms: a dictionary of their values, or one array of single-precision numbers.

    flat: whether it is one array. is_layout: values are not cut at the bounds of the space, and parts of a term have
    slices of their own. Raises ConfigError for a term that needs what the scene does not have, and for its options."""

    def __init__(self, scene: SenseScene, choices: Sequence[Choice], *, flat: bool = False,
                 is_layout: bool = False) -> None:
        self.channels = {choice.key: Channel(build_term(scene, choice), choice.timing, is_layout) for choice in choices}
        self._flat = flat
        self.slices: dict[str, slice] = {}
        """Name of each term in a flat observation -> its slice."""
        spaces: dict[str, gymnasium.Space[Any]] = {key: channel.space for key, channel in self.channels.items()}
        self.space: gymnasium.Space[Any] = gymnasium.spaces.Dict(spaces)
        if flat:
            begin, lows, highs = 0, [], []
            for key, channel in self.channels.items():
                lows.append(channel.space.low.ravel())
                highs.append(channel.space.high.ravel())
                parts = channel.term.parts if is_layout and channel.term.parts else {key: len(lows[-1])}
                for name, length in parts.items():
                    self.slices[name] = slice(begin, begin + length)
                    begin += length
            low, high = (np.concatenate(bounds).astype(np.float32) for bounds in (lows, highs))
            self.space = gymnasium.spaces.Box(low, high, dtype=np.float32)

    def begin(self, sight: Sight, seed: int, drawn: Mapping[str, float] = NOTHING) -> dict[str, Any]:
        """Return the memory of an episode that starts now; seed: of its noise. drawn: "key.option" -> its value."""
        own = {key: {name.removeprefix(f"{key}."): value for name, value in drawn.items() if name.startswith(f"{key}.")}
               for key in self.channels}
        memory: dict[str, Any] = {key: channel.begin(sight, own[key]) for key, channel in self.channels.items()}
        return {"seed": seed, "reads": 0, "terms": memory}

    def read(self, sight: Sight, memory: dict[str, Any]) -> Any:
        """Return an observation in arrays of its own, and advance the memory."""
        rng = np.random.default_rng((memory["seed"], memory["reads"]))  # no state but a number
        memory["reads"] += 1
        values = {key: channel.read(sight, memory["terms"][key], rng) for key, channel in self.channels.items()}
        if not self._flat:
            return values
        return np.concatenate([value.ravel() for value in values.values()], dtype=np.float32)

    def close(self) -> None:
        """Free what terms hold."""
        for channel in self.channels.values():
            channel.term.close()


def valid_terms(scene: SenseScene) -> list[str]:
    """Return the names of the terms that a scene has all for."""
    return [name for name in TERMS if not find_term(name).missing(scene)]


def build_term(scene: SenseScene, choice: Choice) -> Term:
    """Build a term for a scene; raises ConfigError for one that needs what there is not, and for unknown options."""
    name, missing = choice.kind.name, choice.kind.missing(scene)
    if missing:
        raise ConfigError(f"obs: {name!r} needs {missing}; accepted here: {', '.join(valid_terms(scene))}")
    accepted = accepted_options(choice.kind)
    for option in choice.options:
        if option not in accepted:
            raise UnknownName(f"option of {name!r} in obs", option, accepted)
    return choice.kind(scene, **choice.options)  # pyright: ignore[reportCallIssue]


def describe(choices: Sequence[Choice]) -> list[dict[str, Any]]:
    """Return the chosen terms as plain values."""
    return [{"key": choice.key, "name": choice.kind.name, **choice.options, **choice.timing._asdict()}
            for choice in choices]
