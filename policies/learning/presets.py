"""What a method of learning is made of: files of configs/training."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal, get_args

import pydantic
import yaml
from pydantic import ConfigDict, Field, NonNegativeFloat, NonNegativeInt, PositiveFloat, PositiveInt

import mpm
from policies.learning.bundled import bundled_names, check_method

Learner = Literal["SAC", "TD3", "DDPG", "TQC", "CrossQ", "PPO", "BC", "GAIL", "CMA-ES", "GNN-CMA-ES", "replay"]
OFF_POLICY = ("SAC", "TD3", "DDPG", "TQC", "CrossQ")
"""Learners with a buffer that demonstrations can join."""
Change = Callable[[dict[str, Any]], dict[str, Any]]
"""Gives a changed copy of a table."""
IMITATE = ("BC", "GAIL", "replay")
"""Learners that have nothing but demonstrations."""


class Demonstrations(pydantic.BaseModel):
    """How demonstrations take part in batches."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)

    size: PositiveInt = 50_000
    """Transitions that their buffer has room for."""
    fraction: float = Field(0.5, ge=0.0, le=1.0)
    """Share of a batch, once there is experience of one's own."""
    updates: NonNegativeInt = 1
    """Updates for each demonstrated transition, as it enters."""


class Actor(pydantic.BaseModel):
    """How the actor of an actor-critic learns beside its critics."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)

    waits: NonNegativeInt = 0
    """Decisions before its first update."""
    rate: float = Field(1.0, gt=0.0)
    """Its learning rate over the critics'."""


class GraphSizes(pydantic.BaseModel):
    """How large a network is and how it learns."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)

    hidden: PositiveInt = 32
    message_steps: PositiveInt = 2
    history: PositiveInt = 3
    """Frames whose changes of place a node knows."""
    neighbours: PositiveInt = 10
    """Nearest nodes within reach that a grain hears."""
    updates: PositiveInt = 3000
    batch_size: PositiveInt = 8
    learning_rate: PositiveFloat = 1e-3
    decay: PositiveFloat = 0.1
    """Learning rate at the end over that at the start."""
    noise: NonNegativeFloat = 0.2
    """Standard deviation of the error that places are given in training, over that of what the network has to say: so
    that errors of its own do not grow."""


class Preset(pydantic.BaseModel):
    """A method."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)

    description: str
    learner: Learner
    demonstrations: Demonstrations | None = None
    """Null: no batch holds any."""
    obs: str = "flat"
    """Layout of the observation."""
    scaled: bool = True
    """Observations in units of the task (decimetres from its goal, and so on); false: metres, as the environment's."""
    episodes: PositiveInt = 150
    residual: float | None = Field(None, gt=0.0, le=1.0)
    """The policy corrects the first demonstration, by at most so much; null: it acts itself."""
    correction_cost: float = Field(0.0, ge=0.0)
    """Reward that a decision pays for the mean square of its correction, in units of `residual`; what is told and kept
    of an episode does not count it."""
    actor: Actor | None = None
    """Null: as its critics."""
    critic_layer_norm: bool = False
    encoder: Literal["pointnet", "deep_sets"] | None = None
    """What sees the grains as a set; null: a flat network."""
    graph: GraphSizes | None = None
    """Of a network that foresees what grains do; needs roll-outs to learn from."""
    discriminator_updates: PositiveInt = 1
    """Of GAIL, for each batch of the policy's transitions."""
    options: dict[str, Any] = {}  # noqa: RUF012
    """Arguments of the learner's class."""

    @property
    def shown(self) -> bool:
        """Whether it needs demonstrations."""
        return self.demonstrations is not None or self.residual is not None or self.learner in IMITATE

    @property
    def joins(self) -> bool:
        """Whether demonstrations can take part in its batches."""
        return self.learner in OFF_POLICY and self.residual is None

    @pydantic.model_validator(mode="after")
    def _check(self) -> "Preset":
        if self.encoder is not None and self.obs not in ("flat", "all"):
            raise ValueError(f"encoder {self.encoder} with obs {self.obs}; accepted: flat or all, which "
                             f"hold places and velocities")
        if self.demonstrations is not None and not self.joins:
            raise ValueError(f"demonstrations with learner {self.learner} and residual {self.residual}; accepted: with "
                             f"{', '.join(OFF_POLICY)}, without residual; others learn from them as they are, or not")
        if self.learner in ("BC", "GAIL") and self.obs == "dict":
            raise ValueError(f"learner {self.learner} with obs dict; accepted: any other, it sees one row of numbers")
        if self.critic_layer_norm and (self.obs == "dict" or self.learner != "SAC"):
            raise ValueError(f"critic_layer_norm with learner {self.learner} and obs {self.obs}; accepted: SAC, "
                             f"any obs but dict")
        needed = {"CMA-ES": ("population", "knots", "sigma")}.get(self.learner, ())
        missing = [name for name in needed if name not in self.options]
        if missing:
            raise ValueError(f"learner {self.learner} without options {', '.join(missing)}")
        if (self.graph is not None) != (self.learner == "GNN-CMA-ES"):
            raise ValueError(f"learner {self.learner} with graph {self.graph}; accepted: GNN-CMA-ES with one, others "
                             f"without")
        if self.correction_cost and self.residual is None:
            raise ValueError(f"correction_cost {self.correction_cost} without residual; accepted: with one, or 0")
        return self


def in_words(error: Exception, kind: type[pydantic.BaseModel]) -> str:
    """Describe what is wrong with a file in a line: key, value, reason; of an unknown key, the keys that exist."""
    if not isinstance(error, pydantic.ValidationError):
        return str(error)
    lines = []
    for one in error.errors():
        place = ".".join(map(str, one["loc"]))
        if one["type"] == "extra_forbidden":
            table = table_at(kind, one["loc"][:-1])
            renamed = getattr(table, "RENAMED", {}).get(one["loc"][-1])
            lines.append(f"key {place!r} is now called {renamed!r}; rename it" if renamed else
                         f"unknown key {place!r}; accepted: {', '.join(table.model_fields)}")
        else:
            given = f" (given: {one['input']!r})" if one["type"] not in ("missing", "value_error") else ""
            lines.append(f"{place or 'file'}: {one['msg'].removeprefix('Value error, ')}{given}")
    return "; ".join(lines)


def table_at(kind: type[pydantic.BaseModel], place: Sequence[int | str]) -> type[pydantic.BaseModel]:
    """Find the class of a table within another; a key holds a table or null."""
    for key in place:
        annotation = kind.model_fields[str(key)].annotation
        kind = next(one for one in (annotation, *get_args(annotation))
                    if isinstance(one, type) and issubclass(one, pydantic.BaseModel))
    return kind


def in_file(task: str) -> bool:
    """Whether a task is a file of the user's own, and no name."""
    return task.endswith((".yaml", ".yml"))


def strange(task: str) -> bool:
    """Whether a task is neither a sub-task, nor a file that is there, nor an id of Gymnasium such as Pendulum-v1."""
    return not Path(task).is_file() if in_file(task) else "-v" not in task and task not in bundled_names("tasks")


def known(preset: dict[str, Any]) -> dict[str, Any]:
    """A preset that an earlier version wrote down, with what it lacks as it was then and without numbers that did
    nothing; as it is where it is none."""
    try:
        idle = preset.get("residual") is not None or preset.get("learner") not in OFF_POLICY
        return Preset(**{**preset, **({"demonstrations": None} if idle else {})}).model_dump()
    except pydantic.ValidationError:
        return preset


def load_preset(name: str, change: Change | None = None) -> Preset:
    """Load a method by name or path; raises mpm.InvalidValue for one that cannot be used.

    change: of its table, before it is checked.
    """
    path = check_method(name)
    try:
        table = yaml.safe_load(path.read_text())
        return Preset(**(change(table) if change else table))
    except (pydantic.ValidationError, yaml.YAMLError, TypeError) as error:
        raise mpm.InvalidValue(f"{path}: {in_words(error, Preset)}") from error
