"""What a method of learning must offer, and the methods that there are."""

from collections.abc import Mapping
from typing import Protocol

from policies.methods.adversarial import imitate
from policies.methods.cloning import clone
from policies.methods.evolution import evolve, replay
from policies.methods.graph_search import plan
from policies.runs.training import Training


class Method(Protocol):
    """A method of learning: a function that brings a run (`Training`) to its end.

    A method

    - acts in `training.env` only, which seeds, counts and stores its episodes, and the actions of the best one;
    - ends when `training.is_over`, or earlier;
    - reads its settings from `training.preset` (`options` are the method's own) and draws random numbers from
      generators seeded with `training.seed`, or from the global ones of torch, numpy and random;
    - calls `training.save_checkpoint(**parts)` between two episodes, and begins, where `training.folder.checkpoint` is
      a file, with `checkpoint.load` and `training.resume`, so that an interrupted run continues to the same bits;
    - calls `training.save_if_best(policy)` after an episode, if it has a policy of Stable-Baselines3's kind.

    It may use `training.demonstrations` (motions and their starts), `training.demonstration_transitions()` and
    `training.rollouts`, which are there if the preset asks for them. A learner of Stable-Baselines3 needs no function
    of its own: `Training.learn` is its method.

    Example, a random search:

        def search_randomly(training: Training) -> None:
            rng = np.random.default_rng(training.seed)
            knots = training.preset.options["knots"]
            if training.folder.checkpoint.is_file():
                _, state = checkpoint.load(training.folder.checkpoint, None, None)
                rng.bit_generator.state = state["rng"]
                training.resume(state)
            while not training.is_over:
                motion = sample_spline(rng.uniform(-1, 1, (knots, training.dimensions)), training.decisions)
                play(training.env, motion)
                training.save_checkpoint(rng=rng.bit_generator.state)

    To add a method: (1) name its learner in `policies.learning.presets.Learner`, and in IMITATION or SEARCH there if it
    takes demonstrations; (2) add its function to METHODS below; (3) write configs/training/<method>.yaml with
    `description`, `learner` and `options`. Then `robosim train <method> TASK --out DIR` runs it.
    """

    def __call__(self, training: Training, /) -> None:
        """Run until `training.is_over`."""


METHODS: Mapping[str, Method] = {"BC": clone, "GAIL": imitate, "CMA-ES": evolve, "GNN-CMA-ES": plan, "replay": replay}
"""Learner of a preset -> method; learners of Stable-Baselines3 are not in it."""


def select_method(learner: str) -> Method:
    """Return the method of a preset's learner."""
    return METHODS.get(learner, Training.learn)
