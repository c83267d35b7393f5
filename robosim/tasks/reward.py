"""Rewards and scores of a sub-task.

Source: arXiv 2406.09178, section Problem Formulation, equations for pour, translate and scoop. A term has the same name
in `info["reward_terms"]` and in the task completion score (TCS), which leaves out distance and contact.
"""

import copy
import math
from typing import Any, ClassVar

import numpy as np

from robosim.tasks.counting import TaskCounts
from robosim.tasks.task import TaskConfig

NOT_SCORED = ("distance", "contact")
"""Terms that guide learning and are no part of the task completion score."""


class EpisodeSums:
    """What a reward adds up over an episode, the terms of the score among it."""

    SUMS: ClassVar[tuple[str, ...]] = ()
    """Attributes that the steps of an episode change, `score` among them."""
    score: dict[str, float]
    """Sums over the episode of the terms that make up the score."""

    def state(self) -> dict[str, Any]:
        """Return the sums and numbers over the episode so far."""
        return {name: copy.copy(getattr(self, name)) for name in self.SUMS}

    def load(self, state: dict[str, Any]) -> None:
        """Take over what `state` returned."""
        for name, value in {name: copy.copy(state[name]) for name in self.SUMS}.items():
            setattr(self, name, value)

    @property
    def tcs(self) -> float:
        """Task completion score so far; the last step adds the terms of the end."""
        return sum(self.score.values())

    def add_to_score(self, values: dict[str, float]) -> None:
        """Add the scored ones among the terms of a step."""
        for name in self.score:
            self.score[name] += values[name]


class Reward(EpisodeSums):
    """Reward terms and score of one episode, from the counts of each step of `step_dt`."""

    SUMS = ("score", "collisions", "on_target", "poured_on_target", "turn_error")

    def __init__(self, task: TaskConfig) -> None:
        self.task, distance = task, task.reward.distance
        self.counted, self.observed = task.grains.counted, task.grains.count // task.grains.observe_every
        self.gamma = self.counted * distance.reference
        """Weighted distance [m] of all counted grains at which the distance term is zero."""
        self.beta = distance.total / (task.steps * self.gamma)
        """Reward per step and metre."""
        self.terms = task.reward.terms
        self.restart()

    def restart(self) -> None:
        """Begin a new episode."""
        self.score = {name: 0.0 for name in self.terms if name not in NOT_SCORED}
        self.collisions, self.on_target, self.poured_on_target = 0, 0, 0
        turn = self.task.reward.turn
        self.turn_error = abs(math.radians(turn.angle_deg)) if turn is not None else 0.0
        """Difference [rad] between the tool's rotation and the one that the task asks for."""

    @property
    def is_over(self) -> bool:
        """Whether the episode ends before its time: never."""
        return False

    def step(self, counts: TaskCounts, angle: float, last: bool) -> dict[str, float]:
        """Return the terms of one step and add them to the score.

        angle [rad]: rotation of the tool about its lateral axis since the start. last: whether the episode ends here.
        """
        weights, n = self.task.reward, self.counted
        total, self.on_target = counts.distance, counts.on_target
        if counts.grain_distances is not None and counts.grain_on_target is not None:
            total, self.on_target = self._elites(counts.grain_distances, counts.grain_on_target)
        values = {"distance": self.beta * (self.gamma - total)}
        if weights.pours:
            self.poured_on_target += counts.lost_on_target
            values["target"] = weights.target * (2 * counts.lost_on_target - counts.newly_lost)
            values["poured"] = weights.poured * (2 * counts.lost - n) if last else 0.0
        else:
            values["lost"] = weights.lost * counts.newly_lost
            values["target"] = weights.target * (2 * self.on_target - n) if last else 0.0
        if weights.contact:
            values["contact"] = weights.contact * counts.touching
        if weights.collision:
            values["collision"] = weights.collision if counts.wall_hits > 0 else 0.0
            self.collisions += counts.wall_hits > 0
        if weights.turn is not None:
            self.turn_error = abs(math.remainder(angle - math.radians(weights.turn.angle_deg), 2 * math.pi))
            values["turn"] = weights.turn.scale * (weights.turn.margin - self.turn_error) if last else 0.0
        self.add_to_score(values)
        return values

    def diverge(self, steps_left: int) -> dict[str, float]:
        """Return the terms of an episode whose simulation diverged, and add them to the score.

        They are the worst there are, so that divergence never pays: nothing on the target, the tool rotated by half a
        turn off, and for each step left the distance term of grains at twice the reference distance.
        """
        worst = dict.fromkeys(self.terms, 0.0)
        worst["distance"] = -self.task.reward.distance.total * steps_left / self.task.steps
        worst["target"] -= self.task.reward.target * self.counted
        if "poured" in worst:
            worst["poured"] = -self.task.reward.poured * self.counted
        if self.task.reward.turn is not None:
            turn = self.task.reward.turn
            worst["turn"] = turn.scale * (turn.margin - math.pi)
        self.add_to_score(worst)
        return worst

    def _elites(self, distances: np.ndarray, on_target: np.ndarray) -> tuple[float, int]:
        """Return the summed distance [m] of the grains closest to the goal and how many of them are on the target."""
        nearest = np.argpartition(distances, self.counted - 1)[: self.counted]
        return float(distances[nearest].sum(dtype=float)), int(on_target[nearest].sum())

    def readings(self, counts: TaskCounts) -> dict[str, float]:
        """Return physical readings that do not depend on the weights.

        delivered, retained: shares of the counted grains; spilled: share of the observed grains. Those with the terms
        have collisions, a number of steps, and turn_error_deg.
        """
        pours, n = self.task.reward.pours, self.counted
        values = {
            "delivered": (self.poured_on_target if pours else self.on_target) / n,
            "spilled": (counts.lost - self.poured_on_target if pours else counts.lost) / self.observed,
            "retained": min(counts.held / n, 1.0) if self.task.grains.elites else counts.held / n,
        }
        if self.task.reward.collision:
            values["collisions"] = float(self.collisions)
        if self.task.reward.turn is not None:
            values["turn_error_deg"] = math.degrees(self.turn_error)
        return values

    def is_success(self, counts: TaskCounts) -> bool:
        """Return whether the present state is a success."""
        values, success = self.readings(counts), self.task.success
        is_level = success.turn_error_deg is None or values["turn_error_deg"] <= success.turn_error_deg
        return bool(values["delivered"] >= success.delivered and is_level)

    def extremes(self) -> tuple[float, float]:
        """Return the score of a tool that never moves and of a perfect motion.

        A perfect motion brings all grains to the target, loses none and never collides.
        """
        weights, n = self.task.reward, self.counted
        worst, best = -weights.target * n, weights.target * n
        if weights.pours:
            worst, best = -weights.poured * n, (weights.poured + weights.target) * n
        if weights.turn is not None:
            turn = weights.turn
            worst += turn.scale * (turn.margin - abs(math.radians(turn.angle_deg)))
            best += turn.scale * turn.margin
        return worst, best
