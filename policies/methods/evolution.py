"""CMA-ES (Hansen 2016) on a smooth motion, in the simulator itself: no gradient, no model of the grains."""

import pickle
from typing import Any

import cma
import numpy as np

import mpm
from policies.demonstrations.spline_search import fitted, motion
from policies.runs import checkpoint
from policies.runs.training import Training


def evolve(training: Training) -> None:
    """Run the search to its end; it begins with the first demonstration if there is one, at rest otherwise."""
    options, n = training.preset.options, training.base.action_space.shape[0]
    if training.preset.episodes < options["population"]:
        raise mpm.InvalidValue(f"--episodes {training.preset.episodes}; accepted: a generation or more, "
                               f"{options['population']}")
    first = np.zeros((options["knots"], n))
    for actions in training.sequences.values():
        first = fitted(actions, options["knots"])
        break
    search: Any
    if training.folder.checkpoint.is_file():
        _, state = checkpoint.load(training.folder.checkpoint, None, None)
        search = pickle.loads(state["search"])
        training.start_again(state)
    else:
        search = cma.CMAEvolutionStrategy(first.ravel(), options["sigma"], {
            "seed": training.seed + 1, "popsize": options["population"], "verbose": -9})  # 0 is a seed by the clock
    while not training.over and training.env.count + options["population"] <= training.preset.episodes:
        points = search.ask()
        search.tell(points, [-played(training, motion(point.reshape(first.shape), training.decisions))
                             for point in points])
        training.keep(search=pickle.dumps(search))


def played(training: Training, actions: np.ndarray) -> float:
    """Return of an episode with these actions."""
    training.env.reset()
    total = 0.0
    for action in actions:
        _, reward, terminated, truncated, _ = training.env.step(action)
        total += float(reward)
        if terminated or truncated:
            break
    return total


def replay(training: Training) -> None:
    """The demonstrations one after the other, as a method among others."""
    for actions in training.sequences.values():
        if training.env.count < training.preset.episodes:
            played(training, actions)
