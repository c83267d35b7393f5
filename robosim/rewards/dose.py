"""Terms of a dosed mass: its error, the time that it takes, and what is spilled."""

from robosim.config.bounds import PositiveWeight
from robosim.rewards.term import RewardScene, RewardTerm, Step

WORST_ERROR = 2.0
"""Largest error that the reward tells from a smaller one, as a share of the target."""


class Error(RewardTerm):
    """For the error, as a share of the target: what reduces it by a share earns that share."""

    name, of_dose = "error", True

    weight: PositiveWeight

    def begin(self) -> dict[str, float]:
        return {"error": 1.0}

    def step(self, step: Step, scene: RewardScene, memory: dict[str, float]) -> float:
        before, memory["error"] = memory["error"], min(abs(step.dosed - 1.0), WORST_ERROR)
        return self.weight * (before - memory["error"])

    def worst(self, steps_left: int, scene: RewardScene, memory: dict[str, float]) -> float:
        before, memory["error"] = memory["error"], WORST_ERROR
        return self.weight * (before - WORST_ERROR)

    def extremes(self, scene: RewardScene) -> tuple[float, float]:
        return 0.0, self.weight

    def row(self, scene: RewardScene) -> tuple[str, object]:
        return "step", f"{self.weight:g} x decrease of abs(m / target - 1), which counts up to 2"


class Time(RewardTerm):
    """Cost of an episode of full length."""

    name, of_dose = "time", True

    weight: PositiveWeight

    def step(self, step: Step, scene: RewardScene, memory: dict[str, float]) -> float:
        return -self.weight / scene.steps

    def worst(self, steps_left: int, scene: RewardScene, memory: dict[str, float]) -> float:
        return -self.weight * steps_left / scene.steps

    def extremes(self, scene: RewardScene) -> tuple[float, float]:
        return -self.weight, 0.0

    def row(self, scene: RewardScene) -> tuple[str, object]:
        return "step", f"{-self.weight / scene.steps:.3g}"


class Spill(RewardTerm):
    """Cost of spilling as much as the target."""

    name, of_dose = "spill", True

    weight: PositiveWeight

    def begin(self) -> dict[str, float]:
        return {"spilled": 0.0}

    def step(self, step: Step, scene: RewardScene, memory: dict[str, float]) -> float:
        before, memory["spilled"] = memory["spilled"], min(step.spilled, 1.0)
        return self.weight * (before - memory["spilled"])

    def worst(self, steps_left: int, scene: RewardScene, memory: dict[str, float]) -> float:
        before, memory["spilled"] = memory["spilled"], 1.0
        return self.weight * (before - 1.0)

    def row(self, scene: RewardScene) -> tuple[str, object]:
        return "step", f"-{self.weight:g} x increase of the spilled mass / target, which counts up to 1"
