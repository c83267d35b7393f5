"""Rigid motion: poses, twists and wrenches with named parts, and the screw between two poses.
What every step needs is written out in plain numbers: scipy's rotations took a third of a small scene's step."""

import math
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from mpm.errors import InvalidValue

ORIGIN, AXES, LINEAR, ANGULAR, COLUMNS = 0, 3, 12, 15, 18
"""Columns of a motion table: where origin, rotation matrix and velocities of a frame begin, and how many there are."""


class Pose(NamedTuple):
    """Pose of a frame t in the world w, `T_wt`."""

    position: np.ndarray
    """Origin of the frame in world coordinates [m] (3,)."""
    quaternion: np.ndarray
    """Unit quaternion (w, x, y, z) of the rotation from frame to world coordinates."""

    @classmethod
    def identity(cls) -> "Pose":
        """Return the pose of the world frame."""
        return cls(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))

    @classmethod
    def from_matrix(cls, position: np.ndarray, matrix: np.ndarray) -> "Pose":
        """Return the pose of a frame whose axes are the columns of matrix (3, 3)."""
        return cls(np.array(position, float), quaternion_of(matrix))

    @property
    def matrix(self) -> np.ndarray:
        """Rotation matrix (3, 3); its columns are the axes of the frame in world coordinates."""
        w, x, y, z = map(float, self.quaternion)
        s = 2.0 / (w * w + x * x + y * y + z * z)
        return np.array([[1.0 - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w)],
                         [s * (x * y + z * w), 1.0 - s * (x * x + z * z), s * (y * z - x * w)],
                         [s * (x * z - y * w), s * (y * z + x * w), 1.0 - s * (x * x + y * y)]])

    def __matmul__(self, other: "Pose") -> "Pose":  # type: ignore[override]
        matrix = self.matrix
        return Pose.from_matrix(self.position + matrix @ other.position, matrix @ other.matrix)

    def inverse(self) -> "Pose":
        """Return the inverse: the pose of the world in this frame."""
        matrix = self.matrix.T
        return Pose.from_matrix(-matrix @ self.position, matrix)

    def apply(self, points: np.ndarray) -> np.ndarray:
        """Return world coordinates (n, 3) of points (n, 3) in this frame."""
        return points @ self.matrix.T + self.position


def check_pose(what: str, pose: Pose) -> Pose:
    """Return a pose; raise InvalidValue for anything else, and for numbers that place nothing.
    what: whose pose, for the message."""
    try:
        position, quaternion = [float(v) for v in pose.position], [float(v) for v in pose.quaternion]
        is_pose = len(position) == 3 and len(quaternion) == 4 and any(quaternion) \
            and math.isfinite(sum(position) + sum(quaternion))
    except (AttributeError, TypeError, ValueError):
        is_pose = False
    if not is_pose:
        raise InvalidValue(f"{what}: pose = {' '.join(str(pose).split())}; accepted: finite numbers, mpm.Pose(position "
                           f"[m] (3,), unit quaternion (w, x, y, z))")
    return pose


def quaternion_of(matrix: np.ndarray) -> np.ndarray:
    """Return the unit quaternion (w, x, y, z) of a rotation matrix (3, 3). Source: Shepperd 1978."""
    (a, b, c), (d, e, f), (g, h, i) = np.asarray(matrix, float).tolist()
    squares = (1 + a + e + i, 1 + a - e - i, 1 - a + e - i, 1 - a - e + i)
    largest = squares.index(max(squares))
    row = ((squares[0], h - f, c - g, d - b), (h - f, squares[1], b + d, c + g), (c - g, b + d, squares[2], f + h),
           (d - b, c + g, f + h, squares[3]))[largest]
    length = math.sqrt(sum(v * v for v in row))
    return np.array([v / length for v in row])


class Twist(NamedTuple):
    """Velocity of a rigid body, in world axes about the origin of its frame."""

    linear: np.ndarray
    """Velocity of the origin [m/s] (3,)."""
    angular: np.ndarray
    """Angular velocity [rad/s] (3,)."""


class Wrench(NamedTuple):
    """Wrench in world axes about the origin of a frame; also used for impulses, in N s and N m s."""

    force: np.ndarray
    """Force [N] (3,)."""
    torque: np.ndarray
    """Torque [N m] (3,)."""


class ScrewSamples(NamedTuple):
    """A screw motion at evenly spaced times: positions (n, 3), matrices (n, 3, 3), linear (n, 3), angular (n, 3).
    Of a frame at rest there is one sample, n = 1, for all times."""

    positions: np.ndarray
    matrices: np.ndarray
    linear: np.ndarray
    angular: np.ndarray


def skew(vectors: np.ndarray) -> np.ndarray:
    """Return the cross-product matrices (..., 3, 3) of vectors (..., 3), real or complex."""
    x, y, z = np.moveaxis(np.asarray(vectors), -1, 0)
    zero = np.zeros_like(x)
    rows = [[zero, -z, y], [z, zero, -x], [-y, x, zero]]
    return np.stack([np.stack(row, -1) for row in rows], -2)


def rotation_coefficients(rotations: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return sin(t) / t, (1 - cos t) / t^2 and (t - sin t) / t^3 of lengths t of vectors (..., 3), (..., 1, 1) each.
    Analytic in the vectors, so that complex steps through them give derivatives."""
    squares = np.sum(rotations * rotations, -1)[..., None, None]
    small = np.abs(squares) < 1e-4
    t = np.sqrt(np.where(small, 1.0, squares))
    z = np.where(small, squares, 0.0)
    return (np.where(small, 1 - z / 6 + z**2 / 120 - z**3 / 5040, np.sin(t) / t),
            np.where(small, 0.5 - z / 24 + z**2 / 720 - z**3 / 40320, (1 - np.cos(t)) / t**2),
            np.where(small, 1 / 6 - z / 120 + z**2 / 5040 - z**3 / 362880, (t - np.sin(t)) / t**3))


def rotation_matrix(rotations: np.ndarray) -> np.ndarray:
    """Return the rotation matrices (..., 3, 3) of rotation vectors [rad] (..., 3), real or complex."""
    a, b, _ = rotation_coefficients(rotations)
    K = skew(rotations)
    return np.eye(3) + a * K + b * K @ K


def left_jacobian(rotations: np.ndarray) -> np.ndarray:
    """Return V of SE(3) (..., 3, 3): exp(rho, phi) translates by V(phi) rho.
    rotations: phi [rad] (..., 3), real or complex. Source: Barfoot 2017, eq. 7.77."""
    _, b, c = rotation_coefficients(rotations)
    K = skew(rotations)
    return np.eye(3) + b * K + c * K @ K


def logarithm(begin: Pose, end: Pose) -> Twist:
    """Return the body twist that carries begin to end in unit time: end = begin exp(twist)."""
    rotation = relative_rotation(begin.quaternion, end.quaternion)
    offset = begin.matrix.T @ (np.asarray(end.position) - begin.position)
    angle = math.sqrt(rotation @ rotation)
    if angle < 1e-4:
        third = 1.0 / 12.0 + angle**2 / 720.0
    else:
        third = (1.0 - 0.5 * angle / math.tan(0.5 * angle)) / angle**2
    turned = _cross(rotation, offset)  # V^-1 (Barfoot 2017, eq. 7.78)
    return Twist(offset - 0.5 * turned + third * _cross(rotation, turned), rotation)


def relative_rotation(begin: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Return the rotation vector [rad] (3,), in the first frame's axes, from one unit quaternion to another."""
    a, b, c, d = map(float, begin)
    w, x, y, z = map(float, end)
    real = a * w + b * x + c * y + d * z
    i, j, k = a * x - b * w - c * z + d * y, a * y + b * z - c * w - d * x, a * z - b * y + c * x - d * w
    sine = math.sqrt(i * i + j * j + k * k)
    if real < 0.0:
        real, i, j, k = -real, -i, -j, -k
    scale = 2.0 * math.atan2(sine, real) / sine if sine > 1e-12 else 2.0
    return np.array([scale * i, scale * j, scale * k])


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the cross product of two vectors (3,), in a tenth of NumPy's time."""
    (p, q, r), (x, y, z) = a, b
    return np.array([q * z - r * y, r * x - p * z, p * y - q * x])


def rotate(quaternion: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """Return the quaternion (w, x, y, z) of a frame after a rotation vector [rad] (3,) in world axes; unit length."""
    p, q, r = map(float, rotation)
    half = 0.5 * math.sqrt(p * p + q * q + r * r)
    scale = 0.5 * math.sin(half) / half if half > 1e-9 else 0.5
    a, b, c, d = math.cos(half), scale * p, scale * q, scale * r
    w, x, y, z = map(float, quaternion)
    i, j, k, l = (a * w - b * x - c * y - d * z, a * x + b * w + c * z - d * y,
                  a * y - b * z + c * w + d * x, a * z + b * y - c * x + d * w)
    length = math.sqrt(i * i + j * j + k * k + l * l)
    return np.array([i / length, j / length, k / length, l / length])


def exponential(begin: Pose, twist: Twist, time: float = 1.0) -> Pose:
    """Return begin exp(time * twist), with the twist in the body's axes."""
    rotation = np.asarray(twist.angular) * time
    step = Pose(left_jacobian(rotation) @ (np.asarray(twist.linear) * time),
                Rotation.from_rotvec(rotation).as_quat(scalar_first=True))
    return begin @ step


def screw(begin: Pose, twist: Twist, duration: float, n: int) -> ScrewSamples:
    """Return the screw begin exp(u twist) at n values u = (k + 1) / n, with its world twist about the frame's origin.
    The twist carries the frame along in unit time; `duration` [s] is what the motion takes. A frame that moves along a
    screw has a constant twist in its own axes, so that no substep sees a kink."""
    R, linear, angular = begin.matrix, np.asarray(twist.linear, float), np.asarray(twist.angular, float)
    if not (linear.any() or angular.any()):  # most colliders rest in most steps: one row for all
        return ScrewSamples(begin.position[None], R[None], np.zeros((1, 3)), np.zeros((1, 3)))
    u = np.arange(1, n + 1) / n
    angle = math.sqrt(angular @ angular)
    steps = u[:, None] * linear
    matrices = np.empty((n, 3, 3))
    matrices[:] = R
    if angle > 0.0:
        axis = angular / angle
        x, y, z = axis
        K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        turns, small = u * angle, angle < 1e-3
        sine, rest = np.sin(turns), 1.0 - np.cos(turns)
        RK = R @ K
        matrices += sine[:, None, None] * RK + rest[:, None, None] * (RK @ K)
        across = _cross(axis, linear)
        second = 0.5 * angle * u**2 if small else rest / angle
        third = angle**2 / 6.0 * u**3 if small else u - sine / angle
        steps += second[:, None] * across + third[:, None] * _cross(axis, across)
    return ScrewSamples(begin.position + steps @ R.T, matrices, matrices @ (linear / duration),
                        matrices @ (angular / duration))


def motion_table(legs: list[list[ScrewSamples]], n: int, dtype: type) -> np.ndarray:
    """Return the motion table (k, n, COLUMNS) of k frames in n substeps, legs one after another.
    A row holds origin, rotation matrix (row by row), linear and angular velocity, in world axes."""
    table = np.zeros((max(len(legs), 1), n, COLUMNS), dtype)
    for rows, way in zip(table, legs):
        part = n // len(way)
        for i, s in enumerate(way):
            row = rows[i * part : (i + 1) * part]
            row[:, ORIGIN:AXES], row[:, AXES:LINEAR] = s.positions, s.matrices.reshape(-1, 9)
            row[:, LINEAR:ANGULAR], row[:, ANGULAR:] = s.linear, s.angular
    return table
