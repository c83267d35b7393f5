"""Smoothing of joint motions that are commanded step by step."""

import numpy as np
from ruckig import ControlInterface, InputParameter, OutputParameter, Result, Ruckig, Synchronization

from robosim.config.robot import RobotConfig
from robosim.errors import RobotDiverged
from robosim.robot.model import SPEED_LIMITS, Arm
from robosim.robot.timing import JointState

CATCH_UP = 20.0
"""Rate [1/s] at which the smoothed motion closes the gap to its goal."""


class JointSmoother:
    """Follows moving joint angles within the limits of speed, acceleration and jerk.

    Ruckig is given target velocities: the goal's, plus what closes the gap to it. With target positions that move
    from step to step it takes long ways around a goal that is near.
    """

    def __init__(self, robot: RobotConfig, dt: float, arm: Arm) -> None:
        self._otg, self._request, self._output = Ruckig(7, dt), InputParameter(7), OutputParameter(7)
        self._speed = SPEED_LIMITS * robot.limits.velocity_fraction
        self._lower, self._upper = arm.lower, arm.upper
        self._request.control_interface = ControlInterface.Velocity
        self._request.synchronization = Synchronization.No
        self._request.max_velocity = list(self._speed)
        self._request.max_acceleration = list(robot.limits.acceleration)
        self._request.max_jerk = list(robot.limits.jerk)

    def restart(self, q: np.ndarray) -> None:
        """Begin at rest at joint angles q [rad] (7,)."""
        self._q, self._time = np.array(q), 0.0
        self._request.current_position = list(q)
        self._request.current_velocity = self._request.current_acceleration = [0.0] * 7

    def step(self, q: np.ndarray, qd: np.ndarray) -> JointState:
        """Advance by one step towards moving joint angles.

        q [rad] (7,): the angles; qd [rad/s] (7,): their speeds. Raises RobotDiverged where no motion is within the
        limits.
        """
        velocity = qd + CATCH_UP * (np.clip(q, self._lower, self._upper) - self._q)
        self._request.target_velocity = list(np.clip(velocity, -self._speed, self._speed))
        self._time += self._otg.delta_time
        if self._otg.update(self._request, self._output) not in (Result.Working, Result.Finished):
            raise RobotDiverged(self._time, ["the smoother found no motion within the joints' limits"])
        self._output.pass_to_input(self._request)
        self._q = np.array(self._output.new_position)
        return JointState(self._q, np.array(self._output.new_velocity), np.array(self._output.new_acceleration))
