"""CMA-ES on a smooth motion whose outcome a network foresees; the best motion of each generation is tried among grains.
The baseline that arXiv 2406.09178 takes from Tuomainen et al. 2022."""

import math
import pickle
from typing import Any

import cma
import numpy as np

from mpm.geometry.rigid_motion import rotation_matrix
from policies.demonstrations.action_repeat import Hold
from policies.demonstrations.spline_search import FAILED, fitted, motion
from policies.dynamics import rollouts as frames
from policies.dynamics.graph_model import GraphModel
from policies.dynamics.graph_network import arrays
from policies.learning.files import write, write_json
from policies.methods.evolution import played
from policies.runs import checkpoint
from policies.runs.training import Training


def foresee(training: Training) -> None:
    """Let the network learn, then search; goes on where an earlier call was cut."""
    env, preset = training.base.unwrapped, training.preset
    assert preset.graph is not None and training.rollouts is not None
    rollouts = training.rollouts
    model = GraphModel(preset.graph, rollouts, frames.solids(env), float(env.solver.grid.lower[2]), training.seed)
    state: dict[str, Any] = {}
    if training.folder.checkpoint.is_file():
        _, state = checkpoint.load(training.folder.checkpoint, None, None)
        model.load(state["foreseen"])
        training.start_again(state)
    if state.get("search") is None:
        model.learn(lambda: training.keep(foreseen=model.state(), search=None))
        write(training.folder.path / "network.npz", lambda path: np.savez(path, **arrays(model.network)))  # pyright: ignore[reportArgumentType]
        write_json(training.folder.path / "network.json", {
            "sizes": preset.graph.model_dump(), "roll_outs": len(rollouts.grains), "updates": model.updates,
            "loss": float(np.mean(model.losses)), "errors": model.errors()})
    search(training, model, state.get("search"))


def search(training: Training, model: GraphModel, kept: bytes | None) -> None:
    """A generation in the network, its best among grains, and so on."""
    options, env = training.preset.options, training.base.unwrapped
    env.reset(seed=0, options={"nominal": True})
    grains, start, hold = frames.seen(env).astype(float), env.solver.collider_pose(0), Hold(env.task, training.hold)
    first = np.zeros((options["knots"], hold.dimensions))
    for actions in training.sequences.values():
        first = fitted(actions, options["knots"])
        break
    found: Any = pickle.loads(kept) if kept is not None else cma.CMAEvolutionStrategy(
        first.ravel(), options["sigma"], {"seed": training.seed + 1, "popsize": options["population"], "verbose": -9})
    while not training.over:
        points = found.ask()
        motions = [motion(point.reshape(first.shape), training.decisions) for point in points]
        costs = []
        for actions in motions:
            seen = list(model.foreseen(grains, model.way(start, hold, actions)))
            whole = len(seen) == hold.n
            costs.append(cost(env.task, seen[-1], turned(start.matrix, hold, actions)) if whole else FAILED)
        found.tell(points, costs)
        played(training, motions[int(np.argmin(costs))])
        training.keep(foreseen=model.state(), search=pickle.dumps(found))


def cost(task: Any, grains: np.ndarray, angle: float) -> float:
    """What the reward takes for where grains (n, 3) are at the end, and for the angle [rad] that a tool that scoops has
    turned by."""
    distance = task.reward.distance
    away = np.sort(np.abs(grains - np.array(task.goal)) @ np.array(distance.weights))
    counted = max(1, task.grains.counted // task.grains.observe_every) if task.grains.elites else len(away)
    total = distance.total / distance.reference * float(away[:counted].mean())
    turn = task.reward.turn
    if turn is not None:
        total += turn.scale * abs(math.remainder(angle - math.radians(turn.angle_deg), 2.0 * math.pi))
    return total


def turned(start: np.ndarray, hold: Hold, actions: np.ndarray) -> float:
    """Angle [rad] about the tool's lateral axis that actions turn it by, from a matrix (3, 3)."""
    matrix = start
    for turn in rotation_matrix(hold.dt * hold.twists(actions)[1]):
        matrix = turn @ matrix
    R = start.T @ matrix
    return math.atan2(R[0, 2], R[0, 0])
