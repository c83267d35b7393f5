"""Accepted ranges of a rehearsal's figures."""

from typing import NamedTuple

import numpy as np

from robosim.config.rehearsal import RehearsalConfig


class Bound(NamedTuple):
    """Accepted range of one figure."""

    low: float
    high: float


BOUNDS = {
    "delivered_fraction": Bound(0.90, np.inf),
    "spilled_fraction": Bound(0, 0.05),
    "tool_container_contacts": Bound(0, 0),
    "robot_surroundings_contacts": Bound(0, 0),
    "wrist_payload_relative_error": Bound(0, 0.03),
    "momentum_residual": Bound(0, 1e-4),
    "velocity_limit_ratio_max": Bound(0, 1.0),
    "torque_limit_ratio_max": Bound(0, 1.0),
    "joint_limit_ratio_max": Bound(0, 1.0),
    "ik_position_error_max": Bound(0, 1e-5),
    "path_error_inside_max": Bound(0, 2e-3),
    "particles_lost": Bound(0, 0),
}
"""Bounds of every rehearsal (SI units)."""
PATH_ERROR_INSIDE = "path_error_inside_max"
"""The figure that is None where the tool was in no container."""
WRIST_ERROR = "wrist_payload_relative_error"
"""The figure that is None where nothing is weighed."""


def get_bounds(config: RehearsalConfig) -> dict[str, Bound]:
    """Return the bounds of one rehearsal.

    They include its least load, and no weighing where it weighs nothing.
    """
    return {"scooped_mass": Bound(config.least_load, np.inf),
            **{name: bound for name, bound in BOUNDS.items() if name != WRIST_ERROR or config.weigh_at}}


def find_missed(figures: dict[str, object], config: RehearsalConfig) -> list[str]:
    """Describe each figure outside its bound in one line.

    Returns an empty list where all are within.
    """
    lines = []
    for name, bound in get_bounds(config).items():
        value = figures[name]
        if name == PATH_ERROR_INSIDE and value is None:
            continue
        if not isinstance(value, (int, float)) or not bound.low <= value <= bound.high:
            lines.append(f"{name} = {value}; accepted: {bound.low:g} to {bound.high:g}")
    return lines
