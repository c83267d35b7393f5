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


def left_jacobian(rotations: np.ndarray) -> np.ndarray:
    """V of SE(3) (..., 3, 3): exp(rho, phi) translates by V(phi) rho; phi [rad] (..., 3). (Barfoot 2017, eq. 7.77)"""
    angle = np.linalg.norm(rotations, axis=-1)[..., None, None]
    K = skew(rotations)
    small = angle < 1e-4
    a = np.where(small, 1.0, angle)
    first = np.where(small, 0.5 - angle**2 / 24.0, (1.0 - np.cos(a)) / a**2)
    second = np.where(small, 1.0 / 6.0 - angle**2 / 120.0, (a - np.sin(a)) / a**3)
    return np.eye(3) + first * K + second * K @ K


def logarithm(begin: Pose, end: Pose) -> Twist:
    """Body twist that carries begin to end in unit time: end = begin exp(twist)."""
    R = begin.matrix
    rotation = Rotation.from_matrix(R.T @ end.matrix).as_rotvec()
    offset = R.T @ (np.asarray(end.position) - begin.position)
    return Twist(np.linalg.solve(left_jacobian(rotation), offset), rotation)


def exponential(begin: Pose, twist: Twist, time: float = 1.0) -> Pose:
    """begin exp(time * twist), twist in the body's axes."""
    rotation = np.asarray(twist.angular) * time
    step = Pose(left_jacobian(rotation) @ (np.asarray(twist.linear) * time),
                Rotation.from_rotvec(rotation).as_quat(scalar_first=True))
    return begin @ step


def screw(begin: Pose, twist: Twist, duration: float, n: int) -> ScrewSamples:
    """The screw begin exp(u twist) at the n values u = (k + 1) / n, with its world twist about the frame's origin.

    twist carries the frame through in unit time, `duration` [s] is what it really takes. A frame that moves along a
    screw has a constant twist in its own axes, so that no substep sees a kink.
    """
    R, linear, angular = begin.matrix, np.asarray(twist.linear), np.asarray(twist.angular)
    rotations = ((np.arange(n) + 1.0) / n)[:, None] * angular
    steps = ((np.arange(n) + 1.0) / n)[:, None] * linear
    matrices = R @ Rotation.from_rotvec(rotations).as_matrix()
    positions = begin.position + np.einsum("ij,njk,nk->ni", R, left_jacobian(rotations), steps)
    return ScrewSamples(positions, matrices, matrices @ (linear / duration), matrices @ (angular / duration))


def motion_table(screws: list[ScrewSamples], first: int, n: int, dtype: type) -> np.ndarray:
    """Origin, matrix, linear and angular velocity of moving frames in n substeps from `first` on (k, n, 18)."""
    chosen = slice(first, first + n)
    rows = [np.concatenate([s.positions[chosen], s.matrices[chosen].reshape(n, 9), s.linear[chosen],
                            s.angular[chosen]], axis=1) for s in screws]
    return np.array(rows, dtype)
