"""What a method of learning must offer, and the methods that there are."""

from collections.abc import Mapping
from typing import Protocol

from policies.methods.adversarial import imitate
from policies.methods.cloning import clone, replay
from policies.methods.dagger import aggregate
from policies.methods.graph_search import plan
from policies.runs.training import Training


class Method(Protocol):
    """A method of learning: a function that executes a training run (`Training`) up to its end.

    A method must

    - act in `training.env` only, which seeds, counts and stores the episodes, and stores the actions of the best one;
    - end when `training.is_over` is True, or earlier;
    - read its settings from `training.preset` (its own are in `options`), and draw random numbers from generators with
      the seed `training.seed`, or from the global ones of torch, numpy and random;
    - call `training.keep_checkpoint(**parts)` between two episodes, which writes a checkpoint when one is due or the
      run is interrupted, or `training.save_checkpoint(**parts)`, which writes it at once. At the start it must call
      `training.load_checkpoint` and, if that returns parts, `training.resume`, so that results are bitwise identical to
      those of a run without interruption;
    - call `training.evaluate(policy)` after an episode, if it has a policy of Stable-Baselines3.

    It can use `training.demonstrations` (motions and their starts), `training.demonstration_transitions()` and
    `training.rollouts`, if the preset asks for them. A learner of Stable-Baselines3 needs no function: `Training.learn`
    is its method.

    Example, a random search:

        def search_randomly(training: Training) -> None:
            rng = np.random.default_rng(training.seed)
            knots = training.preset.options["knots"]
            if state := training.load_checkpoint():
                rng.bit_generator.state = state["rng"]
                training.resume(state)
            while not training.is_over:
                motion = sample_spline(rng.uniform(-1, 1, (knots, training.dimensions)), training.decisions)
                play(training.env, motion)
                training.save_checkpoint(rng=rng.bit_generator.state)

    To add a method: (1) add its learner to `policies.learning.presets.Learner`, and to IMITATION or SEARCH there if it
    takes demonstrations; (2) add its function to METHODS below; (3) write configs/training/<method>.yaml with
    `description`, `learner` and `options`. Then `robosim train <method> TASK --out DIR` runs it."""

    def __call__(self, training: Training, /) -> None:
        """Run until `training.is_over`."""


METHODS: Mapping[str, Method] = {"BC": clone, "GAIL": imitate, "GNN-CMA-ES": plan, "replay": replay,
                                "DAgger": aggregate}
"""Learner of a preset -> method; learners of Stable-Baselines3 are not in it."""


def select_method(learner: str) -> Method:
    """Return the method of a preset's learner."""
    return METHODS.get(learner, Training.learn)
