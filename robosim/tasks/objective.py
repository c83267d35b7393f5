"""Differentiable counterpart of a sub-task's reward, for demonstrations by gradient descent.
Terms that count grains have no gradient and are left out (arXiv 2406.09178, Algorithm 2). Two terms are added: the
distance from the tool to its material, and the depth by which the tool enters a container's clearance."""

import math

import numpy as np

from mpm.rollout.losses import Above, Attraction, Clear, Loss, Sum, Turned, WeightedDistance
from robosim.base.errors import ConfigError
from robosim.rewards.grains import Distance, Poured
from robosim.rewards.term import find_term
from robosim.rewards.tool import Collision, Turn
from robosim.shapes import tool_shape
from robosim.tasks.counting import container_points, observed_grains, whole_tool_sdf
from robosim.tasks.task import TaskConfig

ATTRACTION = 0.3
"""Weight of the tool's distance to its material, as a share of the reward's total per reference distance."""
ATTRACTION_SHARE = 0.35
"""Share of an episode in which a scooping tool is attracted; later it would follow the grains it leaves behind."""
POURING = 6.0
"""Weight of the height that replaces the count of poured grains. With 2, a full tool that waits above the goal loses
less than one whose content spreads on the floor, and the search ends there."""
CLEARANCE, COLLISION_DEPTH = 0.004, 0.01
"""Distance [m] from tool to container below which the loss grows, and depth [m] below that which costs as much as a
collision does in the reward. A steeper slope would let a brush with the wall outweigh every gradient of the grains."""


def build_objective(task: TaskConfig) -> Loss:
    """Build the loss of an episode: minus the reward's distance up to a constant, plus the error of the tool's turn.
    Where grains are poured, the height of each grain above the bounds' lower plane replaces the count of poured grains.
    Raises ConfigError for a task whose reward has no distance."""
    distance, n = find_term(task.reward, Distance), task.grains.counted
    if distance is None:
        raise ConfigError("objective: a reward without distance, such as that of a dose, has no gradient; accepted: a "
                          "task with reward.distance")
    scale = distance.total / (task.steps * n * distance.reference)
    counted = None if task.grains.elites else observed_grains(task)
    terms: list[Loss] = [WeightedDistance(np.array(task.goal), np.array(distance.weights), counted, scale,
                                          task.grains.elites)]
    poured = find_term(task.reward, Poured)
    if poured is not None:
        plane = task.bounds.centre[2] - task.bounds.half[2]
        per_metre = POURING * poured.weight / (task.steps * (task.start.position[2] - plane))
        terms.append(Above(plane, counted, per_metre))
    turn = find_term(task.reward, Turn)
    if turn is not None:
        terms.append(Turned(task.start.pose.matrix, math.radians(turn.angle_deg), task.steps, turn.scale))
    if not task.carried:
        interior = tool_shape(task.tool).interior
        weights = np.full(task.steps, ATTRACTION * distance.total / (task.steps * distance.reference))
        if task.container is not None:
            weights[round(ATTRACTION_SHARE * task.steps) :] = 0.0
        terms.append(Attraction(np.array(interior.centre), counted, 0.0, weights))
    points = container_points(task)
    if points is not None:
        collision = find_term(task.reward, Collision)
        cost = 0.0 if collision is None else -collision.weight
        terms.append(Clear(points, whole_tool_sdf(task), CLEARANCE, cost / COLLISION_DEPTH))
    return Sum(tuple(terms))
