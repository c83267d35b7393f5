"""Loss of a motion through the differentiable field, its derivatives, and their check by finite differences."""

import sys
from functools import cached_property
from typing import Any

import numpy as np

import mpm
from policies.demonstrations.action_repeat import ActionRepeat

DIRECTIONS = 3
"""Random directions of the check."""
DIFFERENCE = 1e-3
"""Step of the finite differences, in actions of -1 to 1; with a smaller one single precision's rounding dominates."""


class MotionLoss:
    """The loss of actions (decisions, dimensions) that a sub-task's environment is driven with.

    env: the unwrapped environment. arm_weight: weight of the penalty on motions beyond the arm's limits. rollout:
    options of `mpm.Rollout`."""

    def __init__(self, env: Any, action_repeat: int, *, arm_weight: float = 0.0, **rollout: Any) -> None:
        self.env, self.actions = env, ActionRepeat(env.task, action_repeat)
        self._options, self._arm_weight, self._objective = rollout, arm_weight, env.objective()
        self._start_pose: Any = None

    @cached_property
    def rollout(self) -> Any:
        """The differentiable rollout of a whole episode; its memory is allocated at first use."""
        return self.env.rollout(**self._options)

    @cached_property
    def reach(self) -> Any:
        """The arm that would carry the tool."""
        return self.env.reach()

    def set_start(self) -> None:
        """Take the environment's present state as the start of every motion."""
        self.rollout.restart()
        self._start_pose = self.env.solver.collider_pose(0)
        self.actions.set_start(self._start_pose.position)

    def value(self, actions: np.ndarray) -> float:
        """Return the loss. Raises mpm.SimulationDiverged."""
        twists = self.actions.to_twists(actions)
        loss = self.rollout.value(*twists, self._objective)
        if self._arm_weight:
            loss += self._arm_weight * self.reach.penalty(self._start_pose, *twists)[0]
        return loss

    def value_and_grad(self, actions: np.ndarray) -> tuple[float, np.ndarray]:
        """Return the loss and its derivatives (decisions, dimensions).
        Raises mpm.SimulationDiverged and mpm.GradientDiverged."""
        twists = self.actions.to_twists(actions)
        loss, twist_bars = self.rollout.value_and_grad(*twists, self._objective)
        if self._arm_weight:
            penalty, penalty_bars = self.reach.penalty(self._start_pose, *twists)
            loss += self._arm_weight * penalty
            twist_bars = tuple(a + self._arm_weight * b for a, b in zip(twist_bars, penalty_bars))
        return loss, self.actions.pull_back(*twist_bars)

    def check_gradient(self, actions: np.ndarray) -> np.ndarray:
        """Return derivatives and central differences along the gradient and random directions (1 + DIRECTIONS, 2).
        They are taken at 0.99 x the actions, away from their bounds; (0, 2) where the motion there diverges."""
        actions, rng, rows = 0.99 * actions, np.random.default_rng(0), []
        try:
            _, gradient = self.value_and_grad(actions)
            for direction in (gradient, *(rng.standard_normal(gradient.shape) for _ in range(DIRECTIONS))):
                largest = np.abs(direction).max()
                unit = direction / largest if largest > 0 else direction
                rows.append((float(np.sum(gradient * unit)), self.difference(actions, unit, DIFFERENCE)))
            return np.array(rows)
        except (mpm.SimulationDiverged, mpm.GradientDiverged) as error:
            print(f"the gradient of the best motion is not checked: {error}", file=sys.stderr)
            return np.zeros((0, 2))

    def difference(self, actions: np.ndarray, direction: np.ndarray, step: float) -> float:
        """Return the central difference of the loss along a direction. Raises mpm.SimulationDiverged."""
        above, below = (self.value(actions + s * direction) for s in (step, -step))
        return (above - below) / (2.0 * step)
