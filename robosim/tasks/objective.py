"""A sub-task's reward as a loss that can be differentiated: distances, turn, and what draws a tool to its material.

As in the paper, terms that count grains are left out: they have no slope. Collisions are counted in the reward, too;
here they become depths.
"""

import math

import numpy as np

from mpm.rollout.losses import Above, Attraction, Clear, Loss, Sum, Turned, WeightedDistance
from robosim.shapes import tool_shape
from robosim.tasks.counting import container_points, observed_grains, whole_tool_sdf
from robosim.tasks.task import TaskConfig

DRAWN = 0.3
"""What the distance [in references] from a tool to its material costs, as a share of the reward's total."""
KEPT_OFF, DEEP = 0.004, 0.01
"""Distance [m] of a tool to a container from which on it costs, and how much nearer it costs what a collision does in
the reward: steeper, a brush with the wall outweighs every slope of the grains."""
LOOSE = 0.35
"""Share of an episode after which a tool that scoops is not drawn to what it leaves behind."""


def objective(task: TaskConfig) -> Loss:
    """The loss of an episode: minus the reward's distance term, up to its constant, and the error of the turn; the
    count of what was poured out becomes its height above the plane below which it counts."""
    distance, n = task.reward.distance, task.grains.counted
    scale = distance.total / (task.steps * n * distance.reference)
    chosen = None if task.grains.elites else observed_grains(task)
    parts: list[Loss] = [WeightedDistance(np.array(task.goal), np.array(distance.weights), chosen, scale,
                                          task.grains.elites)]
    if task.kind == "pour":
        plane = task.bounds.centre[2] - task.bounds.half[2]
        fallen = 2.0 * task.reward.poured / (task.steps * (task.start.position[2] - plane))
        parts.append(Above(plane, chosen, fallen))
    turn = task.reward.turn
    if turn is not None:
        parts.append(Turned(task.start.pose.matrix, math.radians(turn.angle_deg), task.steps, turn.scale))
    if not task.carried:
        interior = tool_shape(task.tool).interior
        drawn = np.full(task.steps, DRAWN * distance.total / (task.steps * distance.reference))
        if task.kind == "scoop":
            drawn[round(LOOSE * task.steps) :] = 0.0
        parts.append(Attraction(np.array(interior.centre), chosen, 0.0, drawn))
    points = container_points(task)
    if points is not None:
        parts.append(Clear(points, whole_tool_sdf(task), KEPT_OFF, -task.reward.collision / DEEP))
    return Sum(tuple(parts))
