"""What a rehearsal writes down, step by step."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

ARM = [f"A{i}" for i in range(1, 8)]
WRENCH = ["fx_N", "fy_N", "fz_N", "tx_Nm", "ty_Nm", "tz_Nm"]
POSE = ["x", "y", "z", "qw", "qx", "qy", "qz"]
COLUMNS = (
    ["time_s"] + [f"q_{a}_rad" for a in ARM] + [f"qd_{a}_rad_s" for a in ARM] + [f"qdd_{a}_rad_s2" for a in ARM]
    + [f"torque_{a}_Nm" for a in ARM] + [f"sensed_torque_{a}_Nm" for a in ARM]
    + [f"external_torque_{a}_Nm" for a in ARM] + [f"wrist_{c}" for c in WRENCH]
    + [f"commanded_{c}" for c in POSE] + [f"reached_{c}" for c in POSE]
)


class Step(NamedTuple):
    """One step's readings; arrays in SI."""

    time: float
    q: np.ndarray
    qd: np.ndarray
    qdd: np.ndarray
    torque: np.ndarray
    demand: np.ndarray
    """Torques before clipping at the limits (7,) [N m]."""
    joint_torque: np.ndarray
    """What the joint torque sensors feel (7,) [N m]."""
    external_torque: np.ndarray
    """What the controller takes for outside forces (7,) [N m]."""
    commanded: np.ndarray
    """Tool pose (7,): position, quaternion."""
    reached: np.ndarray
    wrist: np.ndarray
    """Force and torque (6,) at the flange in world axes, that the arm exerts on the hand [N], [N m]."""
    residual: np.ndarray
    """Unaccounted momentum of the step (6,) [N s], [N m s]."""
    exchanged: np.ndarray
    """Sum of the magnitudes of all impulses of the step (2,): linear, angular."""
    tool_work: float
    """Work of the tool on the grains in the step [J]."""


class Sample(NamedTuple):
    """Readings that need all particles' places; taken every few steps."""

    time: float
    in_tool: float
    """[kg]"""
    lost: int
    """Grains at the sides or the top of the region, where a clamp holds them, or nowhere."""


class EnergySample(NamedTuple):
    """The grains' energies [J], which need all particles' strains; taken now and then."""

    time: float
    kinetic: float
    potential: float
    elastic: float


class Recording:
    """Grows step by step; `array` gives one column for all steps."""

    def __init__(self) -> None:
        self.steps: list[Step] = []
        self.samples: list[Sample] = []
        self.energies: list[EnergySample] = []

    def array(self, name: str) -> np.ndarray:
        """Values of one field of `Step` over all steps (n, ...)."""
        return np.array([getattr(step, name) for step in self.steps])

    def sampled(self, name: str) -> np.ndarray:
        """Values of one field of `Sample` (m,)."""
        return np.array([getattr(sample, name) for sample in self.samples])

    def between(self, begin: float, end: float) -> slice:
        """Steps whose time lies in [begin, end) s."""
        times = self.array("time")
        return slice(int(np.searchsorted(times, begin)), int(np.searchsorted(times, end)))

    def write_csv(self, path: Path) -> None:
        """trajectory.csv: one row a step."""
        rows = np.column_stack([self.array(name).reshape(len(self.steps), -1) for name in
                                ("time", "q", "qd", "qdd", "torque", "joint_torque", "external_torque", "wrist",
                                 "commanded", "reached")])
        with path.open("w") as file:
            np.savetxt(file, rows, delimiter=",", header=",".join(COLUMNS), comments="", fmt="%.9g")
