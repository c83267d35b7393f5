"""Reward of one episode, the sum of its terms, and its task completion score (TCS), without those that only guide."""

import copy
from typing import Any

from robosim.rewards.term import RewardScene, RewardTerm, Step


class Reward:
    """Terms of each step, and their sums over the episode so far."""

    def __init__(self, terms: dict[str, RewardTerm], scene: RewardScene) -> None:
        self.terms, self.scene = terms, scene
        self.restart()

    def restart(self) -> None:
        """Begin a new episode."""
        self._memory = {name: term.begin() for name, term in self.terms.items()}
        self.score = {name: 0.0 for name, term in self.terms.items() if term.is_scored}
        """Sums over the episode of the terms that make up the score."""

    def state(self) -> dict[str, Any]:
        """Return what terms remember, and the sums over the episode so far."""
        return copy.deepcopy({"memory": self._memory, "score": self.score})

    def load(self, state: dict[str, Any]) -> None:
        """Take over what `state` returned."""
        self._memory, self.score = copy.deepcopy(state["memory"]), dict(state["score"])

    def step(self, step: Step) -> dict[str, float]:
        """Return the terms of one step and add them to the score."""
        return self._add({name: term.step(step, self.scene, self._memory[name]) for name, term in self.terms.items()})

    def diverge(self, steps_left: int) -> dict[str, float]:
        """Return the terms of an episode whose simulation diverged, the worst there are, and add them to the score."""
        return self._add({name: term.worst(steps_left, self.scene, self._memory[name])
                          for name, term in self.terms.items()})

    def _add(self, values: dict[str, float]) -> dict[str, float]:
        for name in self.score:
            self.score[name] += values[name]
        return values

    @property
    def tcs(self) -> float:
        """Task completion score so far; the last step adds the terms of the end."""
        return sum(self.score.values())

    def readings(self) -> dict[str, float]:
        """Return physical readings that the terms have taken."""
        return {name: value for key, term in self.terms.items()
                for name, value in term.readings(self._memory[key]).items()}

    def extremes(self) -> tuple[float, float]:
        """Return the score of a tool that never moves, and of a motion that brings all grains to the target."""
        pairs = [self.terms[name].extremes(self.scene) for name in self.score]
        return sum(worst for worst, _ in pairs), sum(best for _, best in pairs)
