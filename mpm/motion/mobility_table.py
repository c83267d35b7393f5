"""Mobilities and twists of mobile colliders, in the table that a launch reads and writes."""

import math
import warnings
from collections.abc import Mapping

import numpy as np

from mpm.errors import ContactNotConverged, InvalidValue
from mpm.geometry.rigid_motion import Pose, Twist, Wrench
from mpm.motion.mobile_motion import AXES, CENTRE, IMPULSE, LEVER, RATE, RESIDUAL, RESPONSE, TWIST
from mpm.scene.validation import check_finite, read_array

IDENTITY, SYMMETRY = np.eye(6), 1e-6
"""Share of a mobility's norm by which it may lack symmetry, or an eigenvalue may be negative: rounding."""


LARGE_RESIDUAL = 1e-2
"""Residual of a contact solve, relative to the change of the twist by contact, from which the result may be wrong."""


class MobilityTable:
    """One row a mobile collider; each needs a mobility before the first advance."""

    def __init__(self, indices: tuple[int, ...]) -> None:
        self.indices = indices
        n = len(indices)
        self.twists = np.zeros((n, 6))
        """Twists about the centres at the end of the last advance."""
        self._has_mobility, self._has_warned, self._is_set = [False] * n, False, False
        self._free = np.zeros((n, 6))
        self._levers = np.zeros((n, 3))
        """From the centre to the frame's origin, in the frame."""
        self._responses = np.zeros((n, 6, n, 6))
        self.table = np.zeros((max(n, 1), RESPONSE + 36 * max(n, 1)))
        """Read and written by kernels."""

    def set(self, index: int, pose: Pose, W: np.ndarray, free_twist: np.ndarray, twist: np.ndarray | None,
            centre: np.ndarray | None, others: dict[int, np.ndarray]) -> None:
        """Store the arguments of `Solver.set_collider_mobility`; raises InvalidValue as it does."""
        b = self.indices.index(index)
        self._responses[b] = 0.0
        self._responses[b, :, b] = check_mobility(index, W)
        for other, response in others.items():
            if other not in self.indices or other == index:
                raise InvalidValue(f"mobility of collider {index}: others names collider {other}; accepted: "
                                   f"{tuple(i for i in self.indices if i != index)}")
            checked = check_finite(f"mobility of collider {index}: others", response, (6, 6))
            self._responses[b, :, self.indices.index(other)] = checked
        self._free[b] = check_finite(f"mobility of collider {index}: free_twist", free_twist, (6,))
        if twist is not None:
            self.twists[b] = check_finite(f"mobility of collider {index}: twist", twist, (6,))
        if centre is None:
            self._levers[b] = 0.0
        else:
            lever = pose.position - check_finite(f"mobility of collider {index}: centre", centre, (3,))
            self._levers[b] = pose.matrix.T @ lever
        self._has_mobility[b] = self._is_set = True

    @property
    def is_at_rest(self) -> bool:
        """Whether no collider was set since the last advance, nor moves in the next."""
        return not (self._is_set or self.twists.any())

    def save(self) -> dict[str, np.ndarray]:
        """Return what the next advance depends on besides the poses."""
        return {"twists": self.twists.copy(), "free_twists": self._free.copy(), "levers": self._levers.copy(),
                "responses": self._responses.copy()}

    def restore(self, saved: Mapping[str, np.ndarray]) -> None:
        """Return to what `save` gave; raises InvalidValue, and changes nothing, for one of another scene."""
        present = {"twists": self.twists, "free_twists": self._free, "levers": self._levers,
                   "responses": self._responses}
        checked = {name: read_array(saved, name, values.shape) for name, values in present.items()}
        for name, values in present.items():
            values[:] = checked[name]

    def fastest(self, index: int, radius: float) -> float:
        """Return the speed [m/s] that a collider's surface has now or would have at the end without contact."""
        b = self.indices.index(index)
        pairs = [(math.hypot(*t[:3]), math.hypot(*t[3:])) for t in (self.twists[b].tolist(), self._free[b].tolist())]
        return max(speed + (radius * turning if turning else 0.0) for speed, turning in pairs)

    def begin(self, poses: list[Pose], duration: float) -> None:
        """Fill the table for an advance; raises InvalidValue for a collider that was given no mobility."""
        n, self._has_warned, self._is_set = len(self.indices), False, False
        for b, index in enumerate(self.indices):
            if not self._has_mobility[b] and not self._responses[b].any():  # a loaded state has responses of its own
                raise InvalidValue(f"advance: collider {index} is mobile and has no mobility; call "
                                   f"set_collider_mobility({index}, W, free_twist) first, with W = np.zeros((6, 6)) to "
                                   f"hold it")
            row, R = self.table[b], poses[index].matrix
            row[CENTRE:AXES] = poses[index].position - R @ self._levers[b]
            row[AXES:LEVER] = R.ravel()
            row[LEVER:TWIST] = self._levers[b]
            row[TWIST:RATE] = self.twists[b]
            row[IMPULSE:RESPONSE] = 0.0
            row[RATE:IMPULSE] = (self._free[b] - self.twists[b]) / duration
            row[RESPONSE:] = self._responses[b].reshape(6, 6 * n).ravel()

    def end(self, poses: list[Pose]) -> None:
        """Read poses and twists from the table.
        Free twists hold for one advance: after it a collider keeps its twist and its mobility. Warns once an advance
        where contact did not converge."""
        worst = int(np.argmax(self.table[:, RESIDUAL]))
        if self.residual > LARGE_RESIDUAL and not self._has_warned:
            self._has_warned = True
            warnings.warn(ContactNotConverged(
                f"contact of collider {self.indices[worst]}: the solve for its twist ended with a residual of "
                f"{self.residual:.2g} of the change by contact; give a shorter advance or dt, or check its mobility"),
                stacklevel=5)
        for b, index in enumerate(self.indices):
            row = self.table[b]
            R = row[AXES:LEVER].reshape(3, 3)
            poses[index] = Pose.from_matrix(row[CENTRE:AXES] + R @ row[LEVER:TWIST], R)
            self.twists[b] = self._free[b] = row[TWIST:RATE]

    @property
    def residual(self) -> float:
        """The largest relative residual of the contact solves of the last advance; 0 without mobile colliders."""
        return float(self.table[:, RESIDUAL].max())

    def not_finite(self) -> list[int]:
        """Return the colliders whose motion is not finite."""
        return [index for index, row in zip(self.indices, self.table) if not np.isfinite(row).all()]

    def impulse(self, index: int) -> Wrench:
        """Return the impulse received in the last advance, about the centre as it moved."""
        values = self.table[self.indices.index(index), IMPULSE:RESIDUAL]
        return Wrench(values[:3].copy(), values[3:].copy())

    def twist(self, index: int) -> Twist:
        """Return the twist about the centre at the end of the last advance; raises InvalidValue for others."""
        if index not in self.indices:
            raise InvalidValue(f"collider {index} is not mobile; mobile: {self.indices}")
        values = self.twists[self.indices.index(index)]
        return Twist(values[:3].copy(), values[3:].copy())


def check_mobility(index: int, W: np.ndarray) -> np.ndarray:
    """Return the mobility made exactly symmetric; raises InvalidValue for one not symmetric or not positive."""
    W = check_finite(f"mobility of collider {index}: W", W, (6, 6))
    scale = math.sqrt((W * W).sum())
    if np.abs(W - W.T).max() > SYMMETRY * scale:
        raise InvalidValue(f"mobility of collider {index}: W is not symmetric: {np.abs(W - W.T).max():.3g} of "
                           f"{scale:.3g}; the mobility of a mechanism is symmetric")
    W = 0.5 * (W + W.T)
    try:
        np.linalg.cholesky(W + SYMMETRY * scale * IDENTITY)  # a third of the time of the eigenvalues
    except np.linalg.LinAlgError:
        least = np.linalg.eigvalsh(W)[0]
        if least < -SYMMETRY * scale:
            raise InvalidValue(f"mobility of collider {index}: W has the eigenvalue {least:.3g}; accepted: 0 or more "
                               f"(a body that moves against a push would gain energy without end)") from None
    return W
