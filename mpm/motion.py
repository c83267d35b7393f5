"""Rigid motion: poses, twists and wrenches with named parts, and the screw between two poses."""

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation


class Pose(NamedTuple):
    """Where a frame is: `T_wt` as position [m] (3,) and unit quaternion (w, x, y, z) (4,)."""

    position: np.ndarray
    quaternion: np.ndarray

    @classmethod
    def identity(cls) -> "Pose":
        return cls(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))

    @classmethod
    def from_matrix(cls, position: np.ndarray, matrix: np.ndarray) -> "Pose":
        """Pose of a frame whose axes are the columns of matrix (3, 3)."""
        return cls(np.array(position, float), Rotation.from_matrix(matrix).as_quat(scalar_first=True))

    @property
    def matrix(self) -> np.ndarray:
        """Rotation matrix (3, 3): tool axes in world coordinates."""
        return Rotation.from_quat(self.quaternion, scalar_first=True).as_matrix()

    def __matmul__(self, other: "Pose") -> "Pose":  # type: ignore[override]
        matrix = self.matrix
        return Pose.from_matrix(self.position + matrix @ other.position, matrix @ other.matrix)

    def inverse(self) -> "Pose":
        matrix = self.matrix.T
        return Pose.from_matrix(-matrix @ self.position, matrix)

    def apply(self, points: np.ndarray) -> np.ndarray:
        """World coordinates of points (n, 3) given in this frame."""
        return points @ self.matrix.T + self.position


class Twist(NamedTuple):
    """Velocity in world axes about the frame's origin: linear [m/s] (3,), angular [rad/s] (3,)."""

    linear: np.ndarray
    angular: np.ndarray


class Wrench(NamedTuple):
    """Force [N] (3,) and torque [N m] (3,) in world axes about the frame's origin; an impulse has the same shape."""

    force: np.ndarray
    torque: np.ndarray


class ScrewSamples(NamedTuple):
    """A screw motion at evenly spaced times: positions (n, 3), matrices (n, 3, 3), linear (n, 3), angular (n, 3)."""

    positions: np.ndarray
    matrices: np.ndarray
    linear: np.ndarray
    angular: np.ndarray


def skew(vectors: np.ndarray) -> np.ndarray:
    """Cross-product matrices (..., 3, 3) of vectors (..., 3)."""
    x, y, z = np.moveaxis(np.asarray(vectors, float), -1, 0)
    zero = np.zeros_like(x)
    rows = [[zero, -z, y], [z, zero, -x], [-y, x, zero]]
    return np.stack([np.stack(row, -1) for row in rows], -2)


def left_jacobian(rotation: np.ndarray) -> np.ndarray:
    """V of SE(3): exp(rho, phi) translates by V(phi) rho; phi = rotation [rad] (3,). (Barfoot 2017, eq. 7.77)"""
    angle = float(np.linalg.norm(rotation))
    K = skew(rotation)
    if angle < 1e-6:
        return np.eye(3) + K / 2 + K @ K / 6
    return np.eye(3) + (1 - np.cos(angle)) / angle**2 * K + (angle - np.sin(angle)) / angle**3 * K @ K


def logarithm(begin: Pose, end: Pose) -> Twist:
    """Body twist that carries begin to end in unit time: end = begin exp(twist)."""
    relative = begin.inverse() @ end
    rotation = Rotation.from_quat(relative.quaternion, scalar_first=True).as_rotvec()
    return Twist(np.linalg.solve(left_jacobian(rotation), relative.position), rotation)


def exponential(begin: Pose, twist: Twist, time: float = 1.0) -> Pose:
    """begin exp(time * twist), twist in the body's axes."""
    rotation = np.asarray(twist.angular) * time
    step = Pose(left_jacobian(rotation) @ (np.asarray(twist.linear) * time),
                Rotation.from_rotvec(rotation).as_quat(scalar_first=True))
    return begin @ step


def screw(begin: Pose, end: Pose, duration: float, n: int) -> ScrewSamples:
    """The screw motion from begin to end at the n instants (k + 1) duration / n, with its world twist about the origin.

    A frame that moves along a screw has a constant twist in its own axes, so no substep sees a kink.
    """
    twist = logarithm(begin, end)
    times = (np.arange(n) + 1.0) / n
    poses = [exponential(begin, twist, t) for t in times]
    matrices = np.stack([pose.matrix for pose in poses])
    return ScrewSamples(
        np.stack([pose.position for pose in poses]),
        matrices,
        matrices @ (np.asarray(twist.linear) / duration),
        matrices @ (np.asarray(twist.angular) / duration),
    )
