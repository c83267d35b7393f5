"""The readings of a rehearsal, step by step."""

from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

WRENCH = ["fx_N", "fy_N", "fz_N", "tx_Nm", "ty_Nm", "tz_Nm"]
POSE = ["x", "y", "z", "qw", "qx", "qy", "qz"]
WRITTEN = ("time", "q", "qd", "qdd", "torque", "sensed_torque", "external_torque", "wrist", "commanded", "reached")
"""The fields of `Steps` in these columns."""


class Steps(NamedTuple):
    """Readings of host steps, each at its end unless stated, (steps,) or (steps, k). Vectors of the arm have k = n."""

    time: np.ndarray
    """[s]"""
    q: np.ndarray
    """Joint angles [rad]."""
    qd: np.ndarray
    """Joint speeds [rad/s]."""
    qdd: np.ndarray
    """Mean joint accelerations over the step [rad/s^2]."""
    torque: np.ndarray
    """Motor torques [N m] during the step."""
    demanded_torque: np.ndarray
    """Motor torques [N m] before clipping at the limits."""
    sensed_torque: np.ndarray
    """Readings of the joint torque sensors [N m], at the step's start."""
    external_torque: np.ndarray
    """External torques [N m] that the controller estimates from them."""
    commanded: np.ndarray
    """Commanded world poses of the tool, k = 7: position [m], quaternion."""
    reached: np.ndarray
    """World poses of the tool, k = 7."""
    wrist: np.ndarray
    """Force [N] and torque [N m], k = 6, of the arm on the hand at the flange, in world axes, at the step's start."""
    residual: np.ndarray
    """Change of the grains' momentum, k = 6, [N s], [N m s] that no impulse accounts for."""
    exchanged: np.ndarray
    """Sum of the magnitudes of all impulses, k = 2: linear [N s], angular [N m s]."""
    tool_force: np.ndarray
    """Mean force [N] of the grains on the tool during the step, k = 3, in world axes."""
    tool_work: np.ndarray
    """Work [J] of the tool on the grains."""
    is_missed: np.ndarray
    """Whether robot and grains agree less than the coupling's tolerance asks for."""


class GrainSample(NamedTuple):
    """Readings that need all grains' positions."""

    time: float
    """[s]"""
    mass_in_tool: float
    """[kg]"""
    lost: int
    """Number of grains at the sides or the top of the region, or with positions that are not finite."""
    awake: float
    """Share of the grains that is computed: those awake."""


class EnergySample(NamedTuple):
    """Energies of the grains [J] at a time [s]."""

    time: float
    kinetic: float
    potential: float
    elastic: float


def name_columns(joints: Sequence[str], slides: Collection[str] = ()) -> list[str]:
    """Name the columns of trajectory.csv; slides: joints whose values are in metres and newtons."""
    forms = ("q_{}_rad", "qd_{}_rad_s", "qdd_{}_rad_s2", "torque_{}_Nm", "sensed_torque_{}_Nm", "external_torque_{}_Nm")
    def name(form: str, joint: str) -> str:
        return form.format(joint).replace("_rad", "_m").replace("_Nm", "_N") if joint in slides else form.format(joint)

    return ["time_s", *(name(form, joint) for form in forms for joint in joints), *(f"wrist_{c}" for c in WRENCH),
            *(f"commanded_{c}" for c in POSE), *(f"reached_{c}" for c in POSE)]


class Readings:
    """All readings of a run of an arm with these joints; compute: gives those of the steps since its last call."""

    def __init__(self, joints: Sequence[str], slides: Collection[str], compute: Callable[[], Steps]) -> None:
        self.joints, self.slides, self._compute = tuple(joints), tuple(slides), compute
        self._parts: list[Steps] = []
        self.grains: list[GrainSample] = []
        self.energies: list[EnergySample] = []

    def collect(self) -> Steps:
        """Compute the readings of the steps since the last call, and return them."""
        new = self._compute()
        if len(new.time):
            self._parts.append(new)
        return new

    def stack_steps(self, name: str) -> np.ndarray:
        """Stack the values of one field of `Steps` over all steps (n, ...)."""
        empty = self.collect()
        return np.concatenate([getattr(part, name) for part in self._parts or [empty]])

    def stack_grains(self, name: str) -> np.ndarray:
        """Stack the values of one field of `GrainSample` over all samples (m,)."""
        return np.array([getattr(sample, name) for sample in self.grains])

    @property
    def awake_share(self) -> float:
        """Mean share of the grains that was awake."""
        return float(self.stack_grains("awake").mean())

    def write_csv(self, path: Path) -> None:
        """Write trajectory.csv: one row a step, nine digits."""
        values = {name: np.column_stack([self.stack_steps(name)]) for name in WRITTEN}
        align_signs(values["commanded"], values["reached"])
        rows = np.column_stack(list(values.values()))
        header = ",".join(name_columns(self.joints, self.slides))
        with path.open("w", encoding="utf-8") as file:
            np.savetxt(file, rows, delimiter=",", header=header, comments="", fmt="%.9g")


def align_signs(commanded: np.ndarray, reached: np.ndarray) -> None:
    """Choose the signs of the quaternions of poses (n, 7), in place: continuous, and reached as commanded."""
    commanded[:, 3:] = make_continuous(commanded[:, 3:])
    reached[:, 3:] *= np.where(np.sum(reached[:, 3:] * commanded[:, 3:], axis=1, keepdims=True) < 0.0, -1.0, 1.0)


def make_continuous(quaternions: np.ndarray) -> np.ndarray:
    """Choose the signs of quaternions (n, 4) so that none jumps from row to row; the first has w >= 0.
    A rotation has two quaternions of opposite signs. Where they change along a motion, differences and interpolations
    of rows are wrong."""
    first = np.where(quaternions[:1, 0] < 0.0, -1.0, 1.0)
    changes = np.where(np.sum(quaternions[1:] * quaternions[:-1], axis=1) < 0.0, -1.0, 1.0)
    return quaternions * np.cumprod(np.concatenate([first, changes]))[:, None]
