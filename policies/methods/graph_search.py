"""CMA-ES on a smooth motion whose outcome a graph network predicts.
The best motion of each generation is played in the simulator. Source: the baseline that arXiv 2406.09178 takes from
Tuomainen et al. 2022."""

import math
from functools import partial
from typing import Any

import cma
import numpy as np

from mpm.files import write
from mpm.geometry.rigid_motion import rotation_matrix
from policies.demonstrations.action_repeat import ActionRepeat
from policies.demonstrations.spline_search import FAILED, fit_knots, sample_spline
from policies.dynamics.graph_model import GraphModel
from policies.dynamics.graph_network import sample_surfaces
from policies.dynamics.rollouts import grain_positions
from policies.runs.training import Training
from robosim.base.files import write_json
from robosim.episode.play import play


def plan(training: Training) -> None:
    """Train the graph model, then search with it."""
    env, sizes, rollouts = training.base.unwrapped, training.preset.graph, training.rollouts
    assert sizes is not None and rollouts is not None
    model = GraphModel(sizes, rollouts, sample_surfaces(env), float(env.solver.grid.lower[2]), training.seed)
    if state := training.load_checkpoint():
        model.load(state["graph_model"])
        training.resume(state)
    if state.get("search") is None:
        model.train(lambda: training.save_checkpoint(graph_model=model.state(), search=None))
        write(training.folder.path / "network.npz", partial(np.savez, **model.network.weights()))
        write_json(training.folder.path / "network.json", {
            "sizes": sizes.model_dump(), "rollouts": len(rollouts.grains), "updates": model.updates,
            "loss": float(np.mean(model.losses)), "errors": model.test_errors()})
    search_with(training, model, state.get("search"))


def search_with(training: Training, model: GraphModel, search: Any) -> None:
    """Evaluate each generation in the model and play its best motion in the simulator, until the run is over."""
    env = training.base.unwrapped
    env.reset(seed=0, options={"nominal": True})
    grains, start = grain_positions(env).astype(float), env.solver.collider_pose(0)
    converter = ActionRepeat(env.task, training.action_repeat)
    search = make_search(training) if search is None else search
    while not training.is_over:
        points = search.ask()
        motions = [sample_spline(point.reshape(-1, training.dimensions), training.decisions) for point in points]
        costs = []
        for actions in motions:
            frames = list(model.predict_rollout(grains, model.tool_points(start, converter, actions)))
            costs.append(FAILED if len(frames) != converter.decisions else
                         cost(env.task, frames[-1], turn_angle(start.matrix, converter, actions)))
        search.tell(points, costs)
        play(training.env, motions[int(np.argmin(costs))])
        training.save_checkpoint(graph_model=model.state(), search=search)


def make_search(training: Training) -> Any:
    """Return a new search for the knots of a motion, from the first demonstration, or from rest without one.
    Options of the preset: knots, sigma (initial standard deviation of the actions), population."""
    options, given = training.preset.options, training.demonstrations
    knots = fit_knots(given[0].actions, options["knots"]) if given else \
        np.zeros((options["knots"], training.dimensions))
    return cma.CMAEvolutionStrategy(knots.ravel(), options["sigma"], {
        "seed": training.seed + 1, "popsize": options["population"], "verbose": -9})  # seed 0 is the clock's


def cost(task: Any, grains: np.ndarray, angle: float) -> float:
    """Return what the reward subtracts for grains (n, 3) [m] away from the goal and a tool off its angle [rad]."""
    distance = task.reward["distance"]
    away = np.sort(np.abs(grains - np.array(task.goal)) @ np.array(distance.weights))
    counted = max(1, task.grains.counted // task.grains.observe_every) if task.grains.elites else len(away)
    total = distance.total / distance.reference * float(away[:counted].mean())
    if (turn := task.reward.get("turn")) is not None:
        total += turn.scale * abs(math.remainder(angle - math.radians(turn.angle_deg), 2.0 * math.pi))
    return total


def turn_angle(start: np.ndarray, converter: ActionRepeat, actions: np.ndarray) -> float:
    """Return the angle [rad] about its lateral axis that actions turn a tool by, from a rotation matrix (3, 3)."""
    matrix = start
    for step in rotation_matrix(converter.dt * converter.to_twists(actions)[1]):
        matrix = step @ matrix
    R = start.T @ matrix
    return math.atan2(R[0, 2], R[0, 0])
