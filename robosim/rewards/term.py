"""What a reward term is, and what it is computed from."""

from typing import Any, ClassVar, NamedTuple, TypeVar

import pydantic

import mpm
from robosim.config.table import Table

KINDS: dict[str, type["RewardTerm"]] = {}
"""Name -> class of each term, in the order of their definition, in which terms are summed."""


class RewardScene(NamedTuple):
    """The task that terms are computed for."""

    steps: int
    """Steps of an episode."""
    counted: int
    """Grains that the reward counts."""
    goal: tuple[float, float, float]
    """Point [m] to which the distances of the grains are measured."""
    ranks: bool = False
    """Whether the grains closest to the goal are counted, instead of those that are observed."""
    pours: bool = False
    """Whether grains shall leave the bounds, over the target."""


class Step(NamedTuple):
    """One step of `step_dt` of an episode."""

    counts: "mpm.Counts"  # not loaded where a task is only read
    """Readings of the field at its end."""
    distance: float
    """Sum over the counted grains of their weighted Manhattan distance to the goal [m]."""
    on_target: int
    """Counted grains inside the target region."""
    rotation: float
    """Rotation [rad] of the tool about its lateral axis since the start."""
    last: bool
    """Whether the episode has its full length."""
    dosed: float = 0.0
    """Dosed mass as a share of the target mass; 0 in tasks without a dose."""
    spilled: float = 0.0
    """Spilled mass as a share of the target mass; 0 in tasks without a dose."""


class RewardTerm(Table):
    """One part of a reward: its keys in the task's file, its value in each step, and its row on the task's page.

    A subclass with a `name` is known by it. Where `weight` is its only field, the file gives the number alone. Terms
    are summed in the order of their classes. A term keeps nothing from step to step; what it has to remember of an
    episode, `begin` returns for the other methods."""

    name: ClassVar[str]
    is_scored: ClassVar[bool] = True
    """Whether it is part of the task completion score; terms that only guide learning are not."""
    reads_contact: ClassVar[bool] = False
    """Whether it reads `counts.near`, which is counted only where somebody asks for it."""
    of_dose: ClassVar[bool] = False
    """Whether it needs a task with a dose."""
    PER: ClassVar[str] = "step"
    """When or for what it is given."""

    @classmethod
    def __pydantic_init_subclass__(cls, **_: Any) -> None:
        if "name" in vars(cls):
            KINDS[cls.name] = cls

    @pydantic.model_validator(mode="before")
    @classmethod
    def _read_number(cls, given: Any) -> Any:
        return given if isinstance(given, dict | RewardTerm) or not cls.is_number() else {"weight": given}

    @pydantic.model_serializer(mode="wrap")
    def _write_number(self, standard: pydantic.SerializerFunctionWrapHandler) -> Any:
        return standard(self)["weight"] if self.is_number() else standard(self)

    @classmethod
    def is_number(cls) -> bool:
        """Return whether a file gives the term as a number, its weight."""
        return list(cls.model_fields) == ["weight"]

    @classmethod
    def __get_pydantic_json_schema__(cls, schema: Any, handler: pydantic.GetJsonSchemaHandler) -> Any:
        table = handler(schema)
        return handler.resolve_ref_schema(table)["properties"]["weight"] if cls.is_number() else table

    def begin(self) -> dict[str, float]:
        """Return the memory of an episode that starts now; the other methods may change it."""
        return {}

    def step(self, step: Step, scene: RewardScene, memory: dict[str, float]) -> float:
        """Return the value of one step."""
        raise NotImplementedError

    def worst(self, steps_left: int, scene: RewardScene, memory: dict[str, float]) -> float:
        """Return the lowest value that the steps left can have, for an episode whose simulation diverged."""
        return self.extremes(scene)[0]

    def extremes(self, scene: RewardScene) -> tuple[float, float]:
        """Return the sum over an episode of a tool that never moves, and that of a perfect motion."""
        return 0.0, 0.0

    def readings(self, memory: dict[str, float]) -> dict[str, float]:
        """Return physical readings of the episode so far that do not depend on the weights."""
        return {}

    def row(self, scene: RewardScene) -> tuple[str, object]:
        """Return when or for what it is given, and its value, for the page of the task."""
        return self.PER, getattr(self, "weight", None)


Kind = TypeVar("Kind", bound=RewardTerm)


def find_term(terms: dict[str, RewardTerm], kind: type[Kind]) -> Kind | None:
    """Return the term of a class among those of a reward, or None."""
    term = terms.get(kind.name)
    return term if isinstance(term, kind) else None
