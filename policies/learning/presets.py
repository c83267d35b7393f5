"""Presets: the settings of a method, as files of configs/training hold them."""

from collections.abc import Sequence
from typing import Annotated, Any, Literal

import pydantic
from pydantic import Field

from mpm.files import quote, show
from robosim.base.resources import config_path
from robosim.config.bounds import Text
from robosim.config.settings import Setting
from robosim.config.table import Table, load

Learner = Literal["SAC", "TD3", "DDPG", "TQC", "CrossQ", "PPO", "BC", "GAIL", "GNN-CMA-ES", "replay", "DAgger"]
OFF_POLICY = ("SAC", "TD3", "DDPG", "TQC", "CrossQ")
"""Learners with a replay buffer, which demonstrations can be mixed into."""
IMITATION = ("BC", "GAIL", "replay")
"""Learners that learn from demonstrations alone."""
SEARCH = ("GNN-CMA-ES",)
"""Learners that search for one motion; they may begin at a demonstration."""
# A million episodes of 100 actions take two years at 0.6 s each.
Episodes = Annotated[int, Field(ge=1, le=1_000_000)]
# Ten million updates of a small network take 3 hours on one core, and none of the methods needs more.
Updates = Annotated[int, Field(ge=1, le=10_000_000)]
# Ten million transitions of 100 numbers take 8 GB.
Transitions = Annotated[int, Field(ge=1, le=10_000_000)]
# Adam diverges above 1; below 1e-8 single-precision weights do not change any more.
Rate = Annotated[float, Field(ge=1e-8, le=1.0)]

MAX_OPTIONS = 1000
"""Values of `options`, in tables and lists, too."""
MAX_UNITS = 8192
"""Units of a layer: two such layers have 270 MB of weights."""
OPTION_BOUNDS: dict[str, tuple[float, float]] = {
    "learning_rate": (1e-8, 1.0), "gamma": (0.0, 1.0), "tau": (0.0, 1.0), "gae_lambda": (0.0, 1.0),
    "sigma": (1e-6, 100.0),  # of actions of -1 to 1
    "batch_size": (1, 1_000_000), "buffer_size": (1, 10_000_000), "learning_starts": (0, 10_000_000),
    "n_steps": (1, 1_000_000), "updates": (1, 10_000_000), "gradient_steps": (-1, 10_000), "n_epochs": (1, 10_000),
    "train_freq": (1, 1_000_000), "policy_delay": (1, 10_000), "target_update_interval": (1, 1_000_000),
    "knots": (2, 1000), "population": (2, 10_000), "net_arch": (1, MAX_UNITS), "n_critics": (1, 100),
    "n_quantiles": (1, 1000), "top_quantiles_to_drop_per_net": (0, 1000)}
"""Options of learners that decide on memory or time, or have a range by definition: least and largest value."""
WHOLE = {name for name, (least, most) in OPTION_BOUNDS.items() if isinstance(most, int)}
WITH_TEXT = ("train_freq",)
"""Options of these that take a unit, as in [1, episode]."""
REQUIRED = {"GNN-CMA-ES": ("population", "knots", "sigma"),
            "BC": ("learning_rate", "updates", "batch_size", "net_arch"),
            "DAgger": ("learning_rate", "updates", "batch_size", "net_arch", "expert_episodes", "noise",
                       "closing")}
"""Learner -> options that it needs."""
ANY_OPTION = (-1e9, 1e9)
"""The same for every other number."""


class Demonstrations(Table):
    """How demonstrations are mixed into batches."""

    size: Transitions = 50_000
    """Capacity of the demonstration buffer, in transitions."""
    fraction: float = Field(0.5, ge=0.0, le=1.0)
    """Fraction of a batch, once the agent has transitions of its own."""
    updates: int = Field(1, ge=0, le=10_000)
    """Gradient updates after each demonstrated transition, as it enters the buffer."""


class Actor(Table):
    """How the actor of an actor-critic method learns, compared with its critics."""

    waits: int = Field(0, ge=0, le=10_000_000)
    """Number of actions before the actor's first update."""
    rate: float = Field(1.0, ge=1e-6, le=1e3)
    """The actor's learning rate divided by the critics'."""
    every: int = Field(1, ge=1, le=10_000)
    """Updates of the critics for one of the actor."""
    imitation: float = Field(0.0, ge=0.0, le=1e3)
    """Weight of the actor's distance from the actions of the best episode so far, a demonstration at first (compare
    Oh et al. 2018), in units of the mean value; 0 with random starts, whose returns do not compare."""
    imitation_growth: float = Field(1.0, ge=1.0, le=1e6)
    """Its factor at the end of the run, which it reaches geometrically: first the policy explores, then it keeps."""


class Critics(Table):
    """An ensemble of critics (Chen et al. 2021, Ball et al. 2023)."""

    count: int = Field(10, ge=2, le=100)
    subset: int = Field(2, ge=1, le=100)
    """Critics, drawn for each update, whose minimum is the target; the actor follows the mean of all."""

    def check(self) -> None:
        if self.subset > self.count:
            raise ValueError(f"subset {self.subset} of {self.count} critics; accepted: up to {self.count}")


class GraphSizes(Table):
    """Size and training of a graph network."""

    hidden: int = Field(32, ge=1, le=MAX_UNITS)
    message_steps: int = Field(2, ge=1, le=100)
    history: int = Field(3, ge=1, le=100)
    """Past frames whose displacements are features of a node."""
    neighbours: int = Field(10, ge=1, le=1000)
    """Largest number of nearest nodes within the connectivity radius that send to a grain."""
    updates: Updates = 3000
    batch_size: int = Field(8, ge=1, le=10_000)
    learning_rate: Rate = 1e-3
    decay: float = Field(0.1, ge=1e-6, le=1.0)
    """Learning rate at the end divided by that at the start."""
    noise: float = Field(0.2, ge=0.0, le=100.0)
    """Standard deviation of the noise on training positions, in units of the targets' standard deviation: the network
    learns to correct errors of its own."""


class Preset(Table):
    """A method of learning: a learner and its settings.

    Raises pydantic.ValidationError for settings that do not fit each other."""

    description: Text
    learner: Learner
    demonstrations: Demonstrations | None = None
    """How demonstrations are mixed into batches; null: not at all."""
    obs: Annotated[str, Field(max_length=100)] = "flat"
    """Layout of the observation, or terms separated by commas."""
    scaled: bool = True
    """Whether observations are scaled to about 1 (positions from the goal in decimetres, ...); false: SI units."""
    grains_as_one: bool = False
    """Whether the columns of n observed grains are divided by sqrt(n), so that together they weigh as much as one part
    of the observation."""
    episodes: Episodes = 150
    """Largest number of episodes."""
    residual: float | None = Field(None, ge=1e-6, le=1.0)
    """Largest correction of the first demonstration, or of an expert, by the policy, as a fraction of the action range;
    null: the policy corrects nothing but gives the action."""
    expert: Literal["knowing", "pi"] | None = None
    """What `residual` corrects: the task's script that knows the target's place, or the pulses of a dosing controller;
    null: the first demonstration."""
    correction_cost: float = Field(0.0, ge=0.0, le=1e6)
    """Penalty per mean square of the correction, in units of `residual`; it is not part of reported returns."""
    actor: Actor | None = None
    """How the actor learns; null: like its critics."""
    critic_layer_norm: bool = False
    """Layer normalisation in the critics."""
    critics: Critics | None = None
    """Ensemble of critics; null: two, whose minimum is the target and what the actor follows."""
    encoder: Literal["pointnet", "parts"] | None = None
    """Encoder of the grains: permutation-invariant (pointnet), or one that embeds the grains, the rest of
    the observation and the critic's action apart before it joins them (parts); null: no encoder."""
    graph: GraphSizes | None = None
    """Graph network that predicts the motion of the grains, trained on rollouts; null: none."""
    discriminator_updates: int = Field(1, ge=1, le=100_000)
    """Updates of GAIL's discriminator for each batch of the policy's transitions."""
    decay: float = Field(1.0, ge=1e-6, le=1.0)
    """Learning rate at the end of the run divided by that at the start; it falls linearly."""
    options: dict[str, Any] = {}  # noqa: RUF012
    """Arguments of the learner's class."""

    @property
    def needs_demonstrations(self) -> bool:
        """Whether the method cannot run without demonstrations."""
        is_over_motion = self.residual is not None and self.expert is None
        return self.demonstrations is not None or is_over_motion or self.learner in IMITATION

    @property
    def needs_rollouts(self) -> bool:
        """Whether the method learns from rollouts of the simulator."""
        return self.graph is not None

    @pydantic.field_validator("options")
    @classmethod
    def _check_options(cls, options: dict[str, Any]) -> dict[str, Any]:
        pending: list[tuple[str, Any]] = [("", options)]
        for place, value in pending:  # grows while it is read
            if isinstance(value, dict):
                pending += [(f"{place}.{name}" if place else str(name), inner) for name, inner in value.items()]
            elif isinstance(value, list | tuple):
                pending += [(place, inner) for inner in value]
            elif isinstance(value, int | float) and not isinstance(value, bool):
                name = "net_arch" if place.startswith("policy_kwargs.net_arch") else place.rsplit(".", 1)[-1]
                least, most = OPTION_BOUNDS.get(name, ANY_OPTION)
                if not least <= value <= most or (name in WHOLE and value != int(value)):
                    raise ValueError(f"{show(place)} = {quote(value)}; accepted: {least:g} to {most:g}")
            elif isinstance(value, str) and (len(value) > 1000 or (place in OPTION_BOUNDS and place not in WITH_TEXT)):
                raise ValueError(f"{show(place)} = {quote(value)}; accepted: a number, or a text of up to 1000 "
                                 f"characters")
            if len(pending) > MAX_OPTIONS:
                raise ValueError(f"more than {MAX_OPTIONS} values")
        return options

    def check(self) -> None:
        if self.encoder is not None and self.obs not in ("flat", "all"):
            raise ValueError(f"encoder {self.encoder} with obs {self.obs}; accepted: flat or all, which "
                             f"contain positions and velocities")
        if self.demonstrations is not None and (self.learner not in OFF_POLICY or self.residual is not None):
            raise ValueError(f"demonstrations with learner {self.learner} and residual {self.residual}; accepted: with "
                             f"{', '.join(OFF_POLICY)}, without residual; remove `demonstrations`")
        if self.learner in ("BC", "GAIL") and self.obs == "dict":
            raise ValueError(f"learner {self.learner} with obs dict; accepted: any layout that is one array")
        if self.grains_as_one and not self.scaled:
            raise ValueError("grains_as_one with scaled: false; accepted: with scaled observations")
        for name, is_given in (("critic_layer_norm", self.critic_layer_norm), ("critics", self.critics is not None),
                               ("actor.every", self.actor is not None and self.actor.every > 1),
                               ("actor.imitation", self.actor is not None and self.actor.imitation > 0),
                               ("encoder parts", self.encoder == "parts")):
            if is_given and self.learner != "SAC":
                raise ValueError(f"{name} with learner {self.learner}; accepted: SAC")
        if self.expert == "pi" and self.learner != "SAC":
            raise ValueError(f"expert pi with learner {self.learner}; accepted: SAC, whose critics see more")
        if self.decay != 1.0 and (self.learner not in (*OFF_POLICY, "PPO") or "learning_rate" not in self.options):
            raise ValueError(f"decay {self.decay} with learner {self.learner}; accepted: one of "
                             f"{', '.join((*OFF_POLICY, 'PPO'))} with options.learning_rate")
        required = REQUIRED.get(self.learner, ())
        missing = [name for name in required if self.options.get(name) is None]
        if missing:
            raise ValueError(f"learner {self.learner} without options {', '.join(missing)}")
        if (self.graph is not None) != (self.learner == "GNN-CMA-ES"):
            raise ValueError(f"learner {self.learner} with graph {self.graph}; accepted: GNN-CMA-ES with one, others "
                             f"without")
        for name, value in (("correction_cost", self.correction_cost), ("expert", self.expert)):
            if value and self.residual is None:
                raise ValueError(f"{name} {value} without residual; accepted: with one, or none")


def load_preset(name: str, settings: Sequence[Setting] = ()) -> Preset:
    """Load a method by name, or from a .yaml file; raises robosim.ConfigError where either is wrong."""
    return load(config_path("training", name, "method"), Preset, settings=settings)
