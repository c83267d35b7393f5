"""A tool's motion from a constant twist a step, and its adjoint.
Each step adds dt * linear to the tool's position and turns it by dt * angular, in world axes; within the step the tool
follows the screw between. The rows are differentiated by complex steps (Squire and Trapp 1998), exact to rounding."""

from typing import NamedTuple

import numpy as np

from mpm.geometry.rigid_motion import Pose, left_jacobian, quaternion_of, rotation_matrix

STEP = 1e-30
"""Imaginary step; its square underflows beside one."""


class ToolPath(NamedTuple):
    """Poses at the beginning of every step and at the end of the last: positions (n + 1, 3), matrices (n + 1, 3, 3)."""

    positions: np.ndarray
    matrices: np.ndarray

    def pose(self, step: int) -> Pose:
        """Return the tool's pose after so many steps."""
        return Pose(self.positions[step].copy(), quaternion_of(self.matrices[step]))


def integrate_twists(start: Pose, linear: np.ndarray, angular: np.ndarray, dt: float) -> ToolPath:
    """Return the poses of a tool with constant twists (n, 3) [m/s], [rad/s] for dt [s] each."""
    positions = np.concatenate([[start.position], dt * linear]).cumsum(0)
    matrices = np.empty((len(linear) + 1, 3, 3))
    matrices[0] = start.matrix
    for k, turn in enumerate(rotation_matrix(dt * angular)):
        matrices[k + 1] = turn @ matrices[k]
    return ToolPath(positions, matrices)


def motion_rows(position: np.ndarray, matrix: np.ndarray, shift: np.ndarray, turn: np.ndarray, dt: float,
         n: int) -> np.ndarray:
    """Return the rows (..., n, COLUMNS) of the motion table in the n substeps of a step of dt [s].
    The step begins at position (..., 3) and matrix (..., 3, 3); shift [m] (..., 3) and turn [rad] (..., 3) are in world
    axes."""
    u = (np.arange(1, n + 1) / n)[:, None]
    screw = np.linalg.solve(left_jacobian(turn), shift[..., None])[..., None, :, :]
    part = u * turn[..., None, :]
    turned = rotation_matrix(part)
    places = position[..., None, :] + (u[..., None] * left_jacobian(part) @ screw)[..., 0]
    axes = turned @ matrix[..., None, :, :]
    linear = (turned @ screw)[..., 0] / dt
    angular = np.broadcast_to(turn[..., None, :] / dt, linear.shape)
    return np.concatenate([places, axes.reshape(*axes.shape[:-2], 9), linear, angular], -1)


class TwistGradient(NamedTuple):
    """Derivatives by the twists, linear (n, 3) and angular (n, 3), and by the start's position (3,) and a turn of the
    start in world axes (3,)."""

    linear: np.ndarray
    angular: np.ndarray
    start_position: np.ndarray
    start_turn: np.ndarray


def differentiate_twists(path: ToolPath, linear: np.ndarray, angular: np.ndarray, dt: float, table_bar: np.ndarray,
                         pose_bar: np.ndarray) -> TwistGradient:
    """Return the derivatives with respect to the twists.
    table_bar: adjoint of the motion table (steps, n, COLUMNS). pose_bar: adjoint of the poses after every step (steps,
    6): by position, and by a turn in world axes."""
    steps, n, _ = table_bar.shape
    shift, turn = dt * np.asarray(linear, complex), dt * np.asarray(angular, complex)
    direct = np.empty((2, steps, 3))
    for which in range(2):
        for axis in range(3):
            arguments = [shift.copy(), turn.copy()]
            arguments[which][:, axis] += 1j * STEP
            slopes = motion_rows(path.positions[:-1], path.matrices[:-1], *arguments, dt, n).imag / STEP
            direct[which, :, axis] = np.sum(slopes * table_bar, axis=(1, 2))
    # a turn w of the pose at the beginning of a step turns its rows' axes: dR = exp(u turn) [w] R_begin
    part = rotation_matrix((np.arange(1, n + 1) / n)[None, :, None] * turn.real[:, None])
    axes_bar = table_bar[..., 3:12].reshape(steps, n, 3, 3)
    S = np.sum(np.swapaxes(part, -1, -2) @ axes_bar, axis=1) @ np.swapaxes(path.matrices[:-1], -1, -2)
    begin_turn = np.stack([S[:, 2, 1] - S[:, 1, 2], S[:, 0, 2] - S[:, 2, 0], S[:, 1, 0] - S[:, 0, 1]], -1)
    begin_place = table_bar[..., :3].sum(1)
    V, turned = left_jacobian(turn.real), rotation_matrix(turn.real)
    place_bar, turn_bar = np.zeros(3), np.zeros(3)
    bars = np.empty((2, steps, 3))
    for k in reversed(range(steps)):
        place_bar, turn_bar = place_bar + pose_bar[k, :3], turn_bar + pose_bar[k, 3:]
        bars[0, k] = dt * (direct[0, k] + place_bar)
        bars[1, k] = dt * (direct[1, k] + V[k].T @ turn_bar)
        place_bar, turn_bar = place_bar + begin_place[k], turned[k].T @ turn_bar + begin_turn[k]
    return TwistGradient(bars[0], bars[1], place_bar, turn_bar)
