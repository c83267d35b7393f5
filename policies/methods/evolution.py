"""CMA-ES (Hansen 2016) on a smooth motion, in the simulator itself; and the replay of demonstrations."""

from typing import Any

import cma
import numpy as np

import mpm
from policies.demonstrations.spline_search import fit_knots, sample_spline
from policies.runs.training import Training
from robosim.episode.play import play


def evolve(training: Training) -> None:
    """Search generation by generation for the motion of highest return; raises mpm.InvalidValue for less than one."""
    population, episodes = training.preset.options["population"], training.preset.episodes
    if episodes < population:
        raise mpm.InvalidValue(f"--episodes {episodes}; accepted: a generation or more, {population}")
    state = training.load_checkpoint()
    search: Any = state["search"] if state else make_search(training)
    if state:
        training.resume(state)
    while not training.is_over and training.env.count + population <= episodes:
        points = search.ask()
        search.tell(points, [-play(training.env, to_motion(training, point))[0] for point in points])
        training.save_checkpoint(search=search)


def make_search(training: Training) -> Any:
    """Return a new search for the knots of a motion, from the first demonstration, or from rest without one.
    Options of the preset: knots, sigma (initial standard deviation of the actions), population."""
    options, given = training.preset.options, training.demonstrations
    knots = fit_knots(given[0].actions, options["knots"]) if given else \
        np.zeros((options["knots"], training.dimensions))
    return cma.CMAEvolutionStrategy(knots.ravel(), options["sigma"], {
        "seed": training.seed + 1, "popsize": options["population"], "verbose": -9})  # seed 0 is the clock's


def to_motion(training: Training, point: np.ndarray) -> np.ndarray:
    """Return the motion (decisions, dimensions) of a search's point."""
    return sample_spline(point.reshape(-1, training.dimensions), training.decisions)


def replay(training: Training) -> None:
    """Play the demonstrations, one after the other."""
    if state := training.load_checkpoint():
        training.resume(state)
    for demonstration in training.demonstrations[training.env.count : training.preset.episodes]:
        play(training.env, demonstration.actions)
        training.keep_checkpoint()
