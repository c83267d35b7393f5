"""Errors of a robot's model: what a real arm differs by from the one that plans and controls.
Ranges: payload, friction and tool pose as a laboratory identifies them by hand; latency of a controller that is given
joint commands over a network; gains of joint impedance control, which is calibrated to about a tenth."""

from typing import Any, NamedTuple

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from robosim.robot.mjspec import body_ids_below
from robosim.robot.model import Gains

PAYLOAD, FRICTION, GAINS = 0.2, 0.5, 0.1
"""Largest relative errors."""
LATENCY = (0.002, 0.010)
"""[s]"""
SHIFT, TURN_DEG = 1e-3, 0.5
"""Largest error of the tool's place in the hand: along each axis [m], and about it [deg]."""


class ModelErrors(NamedTuple):
    """By what the simulated robot differs from the model of planner and controller."""

    payload: float
    """Factor on mass and inertia of hand and tool."""
    friction: np.ndarray
    """Factor (n,) on friction and damping of each joint."""
    latency: float
    """Time [s] by which commands arrive late."""
    tool_shift: np.ndarray
    """Of the tool in the hand (3,) [m]."""
    tool_turn_deg: np.ndarray
    """Of the tool in the hand, as a rotation vector (3,) [deg]."""
    stiffness: float
    """Factor on the servo's stiffness."""
    damping: float
    """Factor on the servo's damping."""

    def figures(self) -> dict[str, Any]:
        """Return the errors as JSON values; a name ends in the unit, if there is one."""
        return {"payload": self.payload, "friction": self.friction.tolist(), "latency_s": self.latency,
                "tool_shift_m": self.tool_shift.tolist(), "tool_turn_deg": self.tool_turn_deg.tolist(),
                "stiffness": self.stiffness, "damping": self.damping}

    def place_tool(self, spec: mujoco.MjSpec, tool: str) -> None:
        """Displace the tool in the hand."""
        body = spec.body(tool)
        turn = Rotation.from_rotvec(self.tool_turn_deg, degrees=True)
        body.pos = np.asarray(body.pos) + self.tool_shift
        body.quat = (Rotation.from_quat(body.quat, scalar_first=True) * turn).as_quat(scalar_first=True)

    def change_model(self, model: mujoco.MjModel, hand: int, dofs: np.ndarray) -> None:
        """Change masses of a hand's body with all that hangs at it, and friction of joints with these dofs (n,)."""
        carried = body_ids_below(model, hand)
        model.body_mass[carried] *= self.payload
        model.body_inertia[carried] *= self.payload
        model.dof_frictionloss[dofs] *= self.friction
        model.dof_damping[dofs] *= self.friction
        mujoco.mj_setConst(model, mujoco.MjData(model))

    def change_gains(self, gains: Gains) -> Gains:
        """Return a servo's gains as the joints have them."""
        return gains._replace(stiffness=self.stiffness * gains.stiffness, damping=self.damping * gains.damping)


def draw_model_errors(seed: int, joints: int) -> ModelErrors:
    """Draw errors, uniform within their ranges."""
    rng = np.random.default_rng(seed)
    return ModelErrors(payload=1.0 + PAYLOAD * rng.uniform(-1, 1),
                       friction=1.0 + FRICTION * rng.uniform(-1, 1, joints), latency=rng.uniform(*LATENCY),
                       tool_shift=SHIFT * rng.uniform(-1, 1, 3), tool_turn_deg=TURN_DEG * rng.uniform(-1, 1, 3),
                       stiffness=1.0 + GAINS * rng.uniform(-1, 1), damping=1.0 + GAINS * rng.uniform(-1, 1))
