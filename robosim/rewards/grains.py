"""Terms of the grains: their distance to the goal, and where they end.
Source: arXiv 2406.09178, section Problem Formulation, equations for pour, translate and scoop."""

from typing import Annotated

from pydantic import Field

from robosim.config.bounds import PositiveWeight, Weight
from robosim.rewards.term import RewardScene, RewardTerm, Step


class Distance(RewardTerm):
    """Distance of the counted grains to the goal, every step.

    Each step earns beta (gamma - sum of weighted Manhattan distances), with gamma = N* reference and
    beta = total / (steps gamma). An episode in which nothing moves earns total (1 - start distance / reference)."""

    name, is_scored = "distance", False

    weights: tuple[Weight, Weight, Weight]
    """Weights of the distances along x, y and z."""
    total: PositiveWeight
    """Reward of an episode in which all grains are at the goal in every step."""
    reference: PositiveWeight
    """Weighted distance [m] at which the reward is zero."""

    def scale(self, scene: RewardScene) -> tuple[float, float]:
        """Return beta, the reward per step and metre, and gamma, the summed distance [m] at which it is zero."""
        gamma = scene.counted * self.reference
        return self.total / (scene.steps * gamma), gamma

    def step(self, step: Step, scene: RewardScene, memory: dict[str, float]) -> float:
        beta, gamma = self.scale(scene)
        return beta * (gamma - step.distance)

    def worst(self, steps_left: int, scene: RewardScene, memory: dict[str, float]) -> float:
        """Return the value of grains at twice the reference distance in all steps left."""
        return -self.total * steps_left / scene.steps

    def row(self, scene: RewardScene) -> tuple[str, object]:
        counted = "grains closest to the goal" if scene.ranks else "observed grains"
        beta, gamma = self.scale(scene)
        return "step", (f"{beta:.4g} ({gamma:.4g} - sum over the {scene.counted} {counted} of "
                        f"{self.weights} . abs(x - {scene.goal}))")


class Lost(RewardTerm):
    """Per grain that leaves the bounds; beta^n in arXiv 2406.09178."""

    name, PER = "lost", "grain that leaves the bounds"

    weight: Annotated[float, Field(ge=-1e6, le=0.0)]

    def step(self, step: Step, scene: RewardScene, memory: dict[str, float]) -> float:
        return self.weight * step.counts.newly_exited


class Target(RewardTerm):
    """Per grain: + on the target, - elsewhere; beta^t in arXiv 2406.09178.

    In the last step; where grains are poured, in the step in which each leaves the bounds."""

    name = "target"

    weight: PositiveWeight

    def step(self, step: Step, scene: RewardScene, memory: dict[str, float]) -> float:
        if scene.pours:
            return self.weight * (2 * step.counts.exited_from_region - step.counts.newly_exited)
        return self.weight * (2 * step.on_target - scene.counted) if step.last else 0.0

    def worst(self, steps_left: int, scene: RewardScene, memory: dict[str, float]) -> float:
        """Return the value of no grain on the target."""
        return -self.weight * scene.counted

    def extremes(self, scene: RewardScene) -> tuple[float, float]:
        return 0.0 if scene.pours else -self.weight * scene.counted, self.weight * scene.counted

    def row(self, scene: RewardScene) -> tuple[str, object]:
        if scene.pours:
            return "grain that leaves the bounds", f"+{self.weight} over the target, else -{self.weight}"
        return f"grain of the {scene.counted}, last step", f"+{self.weight} on the target, else -{self.weight}"


class Poured(RewardTerm):
    """Per grain in the last step: + poured out, - not; beta^p in arXiv 2406.09178."""

    name = "poured"

    weight: Annotated[float, Field(ge=0.0, le=1e6)]

    def step(self, step: Step, scene: RewardScene, memory: dict[str, float]) -> float:
        return self.weight * (2 * step.counts.exited - scene.counted) if step.last else 0.0

    def extremes(self, scene: RewardScene) -> tuple[float, float]:
        return -self.weight * scene.counted, self.weight * scene.counted

    def row(self, scene: RewardScene) -> tuple[str, object]:
        return "grain, last step", f"+{self.weight} outside the bounds, else -{self.weight}"


class Contact(RewardTerm):
    """Per grain in contact with the tool, in every step; beta^c in arXiv 2406.09178."""

    name, is_scored, reads_contact = "contact", False, True

    weight: Annotated[float, Field(ge=0.0, le=1e6)]

    def step(self, step: Step, scene: RewardScene, memory: dict[str, float]) -> float:
        return self.weight * step.counts.near

    def row(self, scene: RewardScene) -> tuple[str, object]:
        return "grain that touches the tool, step", f"+{self.weight}"
