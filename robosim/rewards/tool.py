"""Terms of the tool's motion: collisions with the container, and its rotation at the end.
Source: arXiv 2406.09178, section Problem Formulation."""

import math
from typing import Annotated

from pydantic import Field

from robosim.config.bounds import Angle, PositiveWeight
from robosim.rewards.term import RewardScene, RewardTerm, Step


class Collision(RewardTerm):
    """Per step in which the tool touches the container; beta^i in arXiv 2406.09178."""

    name, PER = "collision", "step in which the tool hits the container"

    weight: Annotated[float, Field(ge=-1e6, le=0.0)]

    def begin(self) -> dict[str, float]:
        return {"collisions": 0}

    def step(self, step: Step, scene: RewardScene, memory: dict[str, float]) -> float:
        is_hit = step.counts.probed > 0
        memory["collisions"] += is_hit
        return self.weight if is_hit else 0.0

    def readings(self, memory: dict[str, float]) -> dict[str, float]:
        return {"collisions": float(memory["collisions"])}


class Turn(RewardTerm):
    """Rotation of the tool, in the last step: scale (margin - |rotation - angle|), about the tool's lateral axis."""

    name = "turn"

    scale: PositiveWeight
    """Reward per rad."""
    margin: PositiveWeight
    """Error [rad] at which the reward is zero."""
    angle_deg: Angle
    """Required rotation [deg] from the orientation at the start."""

    def begin(self) -> dict[str, float]:
        return {"error": abs(math.radians(self.angle_deg))}

    def step(self, step: Step, scene: RewardScene, memory: dict[str, float]) -> float:
        memory["error"] = abs(math.remainder(step.rotation - math.radians(self.angle_deg), 2 * math.pi))
        return self.scale * (self.margin - memory["error"]) if step.last else 0.0

    def worst(self, steps_left: int, scene: RewardScene, memory: dict[str, float]) -> float:
        return self.scale * (self.margin - math.pi)

    def extremes(self, scene: RewardScene) -> tuple[float, float]:
        return self.scale * (self.margin - self.begin()["error"]), self.scale * self.margin

    def readings(self, memory: dict[str, float]) -> dict[str, float]:
        return {"turn_error_deg": math.degrees(memory["error"])}

    def row(self, scene: RewardScene) -> tuple[str, object]:
        return "last step", f"{self.scale:g} ({self.margin:g} - abs(rotation - {self.angle_deg:g} deg)), in rad"
