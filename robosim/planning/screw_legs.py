"""Screws between waypoints, and corners where the twist blends from one screw to the next."""

from typing import NamedTuple

import numpy as np

from mpm.geometry.rigid_motion import Pose, Twist, exponential, logarithm
from robosim.base.errors import ConfigError
from robosim.config.motion import PathConfig

SMOOTHSTEP_SLOPE = 1.875
"""Largest slope of the quintic smoothstep: the peak of the acceleration, in units of the mean."""
SMOOTHSTEP_CUT = 0.078125
"""Distance by which a blended corner is cut, in units of (velocity change) x (blend time)."""
MIN_BLEND = 0.02
"""Shortest blend time [s]."""


class Leg(NamedTuple):
    """One screw from a pose."""

    begin: Pose
    twist: Twist
    """In the tool's axes [m/s], [rad/s]."""
    duration: float
    """[s]"""


class Corner(NamedTuple):
    """Passage of a waypoint."""

    time: float
    """Nominal time [s] of the passage."""
    blend: float
    """Blend time [s], half of it before the passage."""
    before: Leg | None
    """Leg that ends here; None: at rest."""
    after: Leg | None
    """Leg that begins here; None: at rest."""
    pose: Pose
    name: str

    def evaluate(self, t: float) -> Pose:
        """Return the pose at a time t [s] from the nominal passage.

        The time is within half a blend time. With S the integral of the smoothstep, the tool follows P exp(before (t -
        S)) exp(after S): it leaves the first screw and joins the second with continuous acceleration.
        """
        u = t / self.blend + 0.5
        S = self.blend * (u**6 - 3.0 * u**5 + 2.5 * u**4)
        pose = self.pose
        if self.before is not None:
            pose = exponential(pose, self.before.twist, t - S)
        if self.after is not None:
            pose = exponential(pose, self.after.twist, S)
        return pose


def make_leg(a: Pose, b: Pose, speed: float, angular_speed: float) -> Leg:
    """Make the screw from a to b at speeds [m/s], [rad/s].

    The slower of the two decides. Raises ConfigError where both poses are the same.
    """
    unit = logarithm(a, b)
    duration = max(np.linalg.norm(unit.linear) / speed, np.linalg.norm(unit.angular) / angular_speed)
    if duration == 0:
        raise ConfigError(f"two waypoints share the pose at {tuple(a.position)}: leave one out, or use dwell")
    return Leg(a, Twist(unit.linear / duration, unit.angular / duration), float(duration))


def compute_blend_time(before: Leg | None, after: Leg | None, path: PathConfig, acceleration: float | None) -> float:
    """Compute the time [s] of a change of twist within the acceleration limits.

    acceleration [m/s^2]: the waypoint's own; None: the path's.
    """
    zero = Twist(np.zeros(3), np.zeros(3))
    a, b = (before.twist if before else zero), (after.twist if after else zero)
    linear = np.linalg.norm(np.subtract(b.linear, a.linear)) / (acceleration or path.acceleration)
    angular = np.linalg.norm(np.subtract(b.angular, a.angular)) / path.angular_acceleration
    return float(max(SMOOTHSTEP_SLOPE * max(linear, angular), MIN_BLEND))


def compute_corner_cut(corner: Corner, tip: np.ndarray) -> float:
    """Compute the distance [m] by which a corner between two legs misses its waypoint.

    The larger one of the tool's origin and of a point `tip` (3,) [m] of its frame.
    """
    assert corner.before is not None and corner.after is not None
    linear = np.subtract(corner.after.twist.linear, corner.before.twist.linear)
    angular = np.subtract(corner.after.twist.angular, corner.before.twist.angular)
    changes = np.linalg.norm([linear, linear + np.cross(angular, tip)], axis=1)
    return SMOOTHSTEP_CUT * corner.blend * float(changes.max())
