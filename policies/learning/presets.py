"""Presets: the settings of a method, as files of configs/training hold them."""

from typing import Any, Literal

import pydantic
from pydantic import ConfigDict, Field, NonNegativeFloat, NonNegativeInt, PositiveFloat, PositiveInt

Learner = Literal["SAC", "TD3", "DDPG", "TQC", "CrossQ", "PPO", "BC", "GAIL", "CMA-ES", "GNN-CMA-ES", "replay"]
OFF_POLICY = ("SAC", "TD3", "DDPG", "TQC", "CrossQ")
"""Learners with a replay buffer, which demonstrations can be mixed into."""
IMITATION = ("BC", "GAIL", "replay")
"""Learners that learn from demonstrations alone."""
SEARCH = ("CMA-ES", "GNN-CMA-ES")
"""Learners that search for one motion; they may begin at a demonstration."""


class Demonstrations(pydantic.BaseModel):
    """How demonstrations are mixed into batches."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)

    size: PositiveInt = 50_000
    """Capacity of the demonstration buffer, in transitions."""
    fraction: float = Field(0.5, ge=0.0, le=1.0)
    """Fraction of a batch, once the agent has transitions of its own."""
    updates: NonNegativeInt = 1
    """Gradient updates after each demonstrated transition, as it enters the buffer."""


class Actor(pydantic.BaseModel):
    """How the actor of an actor-critic method learns, compared with its critics."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)

    waits: NonNegativeInt = 0
    """Number of actions before the actor's first update."""
    rate: float = Field(1.0, gt=0.0)
    """The actor's learning rate divided by the critics'."""


class GraphSizes(pydantic.BaseModel):
    """Size and training of a graph network."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)

    hidden: PositiveInt = 32
    message_steps: PositiveInt = 2
    history: PositiveInt = 3
    """Past frames whose displacements are features of a node."""
    neighbours: PositiveInt = 10
    """Largest number of nearest nodes within the connectivity radius that send to a grain."""
    updates: PositiveInt = 3000
    batch_size: PositiveInt = 8
    learning_rate: PositiveFloat = 1e-3
    decay: PositiveFloat = 0.1
    """Learning rate at the end divided by that at the start."""
    noise: NonNegativeFloat = 0.2
    """Standard deviation of the noise on training positions, in units of the targets' standard deviation: the network
    learns to correct errors of its own."""


class Preset(pydantic.BaseModel):
    """A method of learning: a learner and its settings.

    Raises pydantic.ValidationError for settings that do not fit each other.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)

    description: str
    learner: Learner
    demonstrations: Demonstrations | None = None
    """How demonstrations are mixed into batches; null: not at all."""
    obs: str = "flat"
    """Layout of the observation."""
    scaled: bool = True
    """Whether observations are scaled to about 1 (positions from the goal in decimetres, ...); false: SI units."""
    episodes: PositiveInt = 150
    """Largest number of episodes."""
    residual: float | None = Field(None, gt=0.0, le=1.0)
    """Largest correction of the first demonstration by the policy, as a fraction of the action range; null: the policy
    does not correct a demonstration but gives the action."""
    correction_cost: float = Field(0.0, ge=0.0)
    """Penalty per mean square of the correction, in units of `residual`; it is not part of reported returns."""
    actor: Actor | None = None
    """How the actor learns; null: like its critics."""
    critic_layer_norm: bool = False
    """Layer normalisation in the critics."""
    encoder: Literal["pointnet", "deep_sets"] | None = None
    """Permutation-invariant encoder of the grains; null: no encoder."""
    graph: GraphSizes | None = None
    """Graph network that predicts the motion of the grains, trained on rollouts; null: none."""
    discriminator_updates: PositiveInt = 1
    """Updates of GAIL's discriminator for each batch of the policy's transitions."""
    options: dict[str, Any] = {}  # noqa: RUF012
    """Arguments of the learner's class."""

    @property
    def needs_demonstrations(self) -> bool:
        """Whether the method cannot run without demonstrations."""
        return self.demonstrations is not None or self.residual is not None or self.learner in IMITATION

    @property
    def accepts_demonstrations(self) -> bool:
        """Whether the method uses demonstrations if there are some."""
        return self.needs_demonstrations or self.learner in SEARCH

    @property
    def mixes_demonstrations(self) -> bool:
        """Whether demonstrations can be mixed into the method's batches."""
        return self.learner in OFF_POLICY and self.residual is None

    @property
    def needs_rollouts(self) -> bool:
        """Whether the method learns from rollouts of the simulator."""
        return self.graph is not None

    @pydantic.model_validator(mode="after")
    def _check(self) -> "Preset":
        if self.encoder is not None and self.obs not in ("flat", "all"):
            raise ValueError(f"encoder {self.encoder} with obs {self.obs}; accepted: flat or all, which "
                             f"contain positions and velocities")
        if self.demonstrations is not None and not self.mixes_demonstrations:
            raise ValueError(f"demonstrations with learner {self.learner} and residual {self.residual}; accepted: with "
                             f"{', '.join(OFF_POLICY)}, without residual; remove `demonstrations`")
        if self.learner in ("BC", "GAIL") and self.obs == "dict":
            raise ValueError(f"learner {self.learner} with obs dict; accepted: any layout that is one array")
        if self.critic_layer_norm and (self.obs == "dict" or self.learner != "SAC"):
            raise ValueError(f"critic_layer_norm with learner {self.learner} and obs {self.obs}; accepted: SAC, "
                             f"any obs but dict")
        required = {"CMA-ES": ("population", "knots", "sigma")}.get(self.learner, ())
        missing = [name for name in required if name not in self.options]
        if missing:
            raise ValueError(f"learner {self.learner} without options {', '.join(missing)}")
        if (self.graph is not None) != (self.learner == "GNN-CMA-ES"):
            raise ValueError(f"learner {self.learner} with graph {self.graph}; accepted: GNN-CMA-ES with one, others "
                             f"without")
        if self.correction_cost and self.residual is None:
            raise ValueError(f"correction_cost {self.correction_cost} without residual; accepted: with one, or 0")
        return self
