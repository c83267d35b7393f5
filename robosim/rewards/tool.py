"""Terms of the tool's motion: collisions with the container, and its rotation at the end.

Source: arXiv 2406.09178, section Problem Formulation.
"""

import math
from typing import Annotated

from pydantic import Field

from robosim.config.bounds import Angle, PositiveWeight
from robosim.rewards.term import RewardScene, RewardTerm, Step


class Collision(RewardTerm):
    """Per step in which the tool touches the container; beta^i in arXiv 2406.09178."""

    name = "collision"

    weight: Annotated[float, Field(ge=-1e6, le=0.0)]

    def begin(self) -> dict[str, float]:
        """Return no collision."""
        return {"collisions": 0}

    def step(self, step: Step, scene: RewardScene, memory: dict[str, float]) -> float:
        """Return the weight where a point of the container is at the tool."""
        is_hit = step.counts.probed > 0
        memory["collisions"] += is_hit
        return self.weight if is_hit else 0.0

    def readings(self, memory: dict[str, float]) -> dict[str, float]:
        """Return the number of steps with a collision."""
        return {"collisions": float(memory["collisions"])}

    def row(self, scene: RewardScene) -> tuple[str, object]:
        """Return the weight."""
        return "step in which the tool hits the container", self.weight


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
        """Return the error [rad] at the start."""
        return {"error": abs(math.radians(self.angle_deg))}

    def step(self, step: Step, scene: RewardScene, memory: dict[str, float]) -> float:
        """Return the value of the present rotation in the last step."""
        memory["error"] = abs(math.remainder(step.rotation - math.radians(self.angle_deg), 2 * math.pi))
        return self.scale * (self.margin - memory["error"]) if step.last else 0.0

    def worst(self, steps_left: int, scene: RewardScene, memory: dict[str, float]) -> float:
        """Return the value of an error of half a turn."""
        return self.scale * (self.margin - math.pi)

    def extremes(self, scene: RewardScene) -> tuple[float, float]:
        """Return the values of no rotation and of the required one."""
        return self.scale * (self.margin - self.begin()["error"]), self.scale * self.margin

    def readings(self, memory: dict[str, float]) -> dict[str, float]:
        """Return the present error."""
        return {"turn_error_deg": math.degrees(memory["error"])}

    def row(self, scene: RewardScene) -> tuple[str, object]:
        """Return the formula with its numbers."""
        return "last step", f"{self.scale:g} ({self.margin:g} - abs(rotation - {self.angle_deg:g} deg)), in rad"
