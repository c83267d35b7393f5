"""The paper's rewards and scores (arXiv 2406.09178, section Problem Formulation, eqs. for pour, translate and scoop).

A term's name is the same in `info["reward_terms"]` and in the score (TCS), which leaves out distance and contact.
"""

import math

import numpy as np

from robosim.tasks.counting import TaskCounts
from robosim.tasks.task import TaskConfig

NOT_SCORED = ("distance", "contact")
"""Terms that lead the way and say nothing about the task's completion."""


class Reward:
    """Rewards of one episode, step by step of `step_dt`, from the counts of each step."""

    def __init__(self, task: TaskConfig) -> None:
        self.task, distance = task, task.reward.distance
        self.counted, self.seen = task.grains.counted, task.grains.count // task.grains.observe_every
        self.gamma = self.counted * distance.reference
        self.beta = distance.total / (task.steps * self.gamma)
        self.terms = _names(task)
        self.restart()

    def restart(self) -> None:
        """A new episode."""
        self.score = {name: 0.0 for name in self.terms if name not in NOT_SCORED}
        """Sums of the episode so far of the terms that make the TCS."""
        self.collisions, self.on_target = 0, 0
        turn = self.task.reward.turn
        self.turn_error = abs(math.radians(turn.angle_deg)) if turn is not None else 0.0
        self.poured_on_target = 0

    @property
    def tcs(self) -> float:
        """Task completion score so far; terms of the last step come with it."""
        return sum(self.score.values())

    def step(self, now: TaskCounts, turned: float, last: bool) -> dict[str, float]:
        """Terms of one step. turned: [rad] about the tool's lateral axis since the start; last: of the episode."""
        weights, n = self.task.reward, self.counted
        total, on_target = now.distance, now.on_target
        if now.grain_distances is not None and now.grain_on_target is not None:
            total, on_target = self._elites(now.grain_distances, now.grain_on_target)
        self.on_target = on_target
        values = {"distance": self.beta * (self.gamma - total)}
        if self.task.kind == "pour":
            self.poured_on_target += now.lost_on_target
            values["target"] = weights.target * (2 * now.lost_on_target - now.newly_lost)
            values["poured"] = weights.poured * (2 * now.lost - n) if last else 0.0
        else:
            values["lost"] = weights.lost * now.newly_lost
            values["target"] = weights.target * (2 * on_target - n) if last else 0.0
        if weights.turn is not None:
            values["contact"] = weights.contact * now.touching
            values["collision"] = weights.collision if now.wall_hits > 0 else 0.0
            self.collisions += now.wall_hits > 0
            off = math.remainder(turned - math.radians(weights.turn.angle_deg), 2 * math.pi)
            self.turn_error = abs(off)
            values["turn"] = weights.turn.scale * (weights.turn.margin - abs(off)) if last else 0.0
        for name in self.score:
            self.score[name] += values[name]
        return values

    def give_up(self, steps_left: int) -> dict[str, float]:
        """Terms of an episode that cannot go on, so that to diverge never pays: nothing on the target, the tool turned
        away, and for the steps that are left the distance term of grains at twice the reference."""
        worst = dict.fromkeys(self.terms, 0.0)
        worst["distance"] = -self.task.reward.distance.total * steps_left / self.task.steps
        worst["target"] -= self.task.reward.target * self.counted
        if "poured" in worst:
            worst["poured"] = -self.task.reward.poured * self.counted
        if self.task.reward.turn is not None:
            turn = self.task.reward.turn
            worst["turn"] = turn.scale * (turn.margin - math.pi)
        for name in self.score:
            self.score[name] += worst[name]
        return worst

    def _elites(self, distances: np.ndarray, on_target: np.ndarray) -> tuple[float, int]:
        """Distance [m] of the grains closest to the goal, and how many of them are on the target."""
        nearest = np.argpartition(distances, self.counted - 1)[: self.counted]
        return float(distances[nearest].sum(dtype=float)), int(on_target[nearest].sum())

    def readings(self, now: TaskCounts) -> dict[str, float]:
        """Physical readings that do not depend on the weights: fractions of N*; spilled, of the observed grains."""
        pours, n = self.task.kind == "pour", self.counted
        values = {
            "delivered": (self.poured_on_target if pours else self.on_target) / n,
            "spilled": (now.lost - self.poured_on_target if pours else now.lost) / self.seen,
            "retained": min(now.held / n, 1.0) if self.task.grains.elites else now.held / n,
        }
        if self.task.reward.turn is not None:
            values |= {"collisions": float(self.collisions), "turn_error_deg": math.degrees(self.turn_error)}
        return values

    def succeeded(self, now: TaskCounts) -> bool:
        """Whether the present state is a success."""
        values, wanted = self.readings(now), self.task.success
        level = wanted.turn_error_deg is None or values["turn_error_deg"] <= wanted.turn_error_deg
        return bool(values["delivered"] >= wanted.delivered and level)

    def extremes(self) -> tuple[float, float]:
        """TCS of a tool that never moves and of a perfect motion (all on target, nothing lost, no collision)."""
        weights, n = self.task.reward, self.counted
        if self.task.kind == "pour":
            return -weights.poured * n, (weights.poured + weights.target) * n
        worst, best = -weights.target * n, weights.target * n
        if weights.turn is not None:
            turn = weights.turn
            worst += turn.scale * (turn.margin - abs(math.radians(turn.angle_deg)))
            best += turn.scale * turn.margin
        return worst, best


def _names(task: TaskConfig) -> tuple[str, ...]:
    """Names of a task's terms."""
    if task.kind == "pour":
        return ("distance", "target", "poured")
    if task.kind == "scoop":
        return ("distance", "lost", "target", "contact", "collision", "turn")
    return ("distance", "lost", "target")
