"""PI control of a dose whose pulses are changed as they begin, by whoever learns to or by a learned network."""

from pathlib import Path
from typing import Any, cast

import numpy as np

from mpm.array_files import StoredArrays
from robosim.dosing.pi import PiDosing
from robosim.dosing.pulses import CHANGES, OBSERVED, PulseSight, pulse_factors
from robosim.envs.grain_env import GrainEnv
from robosim.studies.evaluation import PULSED
from robosim.studies.evaluation.dosing_policy import DosingPolicy
from robosim.studies.evaluation.network import Network


class PulsedDosing(DosingPolicy):
    """The dosing controller PULSED at work; raises what DosingPolicy raises."""

    def __init__(self, env: GrainEnv) -> None:
        super().__init__(PULSED, env)

    @property
    def pulse(self) -> PulseSight | None:
        """The pulse that the last action begins; None where it begins none."""
        return cast(PiDosing, self.controller).pulse

    def change(self, change: np.ndarray) -> None:
        """Change the pulse that the last action begins; change (CHANGES,): of -1 to 1, as of `pulse_factors`."""
        cast(PiDosing, self.controller).change(*pulse_factors(change))


class PulsePolicy(PulsedDosing):
    """A network that changes the strength and the time of each pulse.
    It sees the pulse, OBSERVED numbers; `residual` of its file scales what it gives. Raises ConfigError,
    mpm.InvalidValue for a network that does not fit, and what DosingPolicy raises."""

    def __init__(self, path: Path, arrays: StoredArrays, env: GrainEnv) -> None:
        super().__init__(env)
        self._network = Network(path, arrays)
        self._network.check_sizes("pulses", (OBSERVED,), CHANGES)
        self._share = float(arrays.numbers("residual").flat[0])

    def __call__(self, observation: Any) -> np.ndarray:
        """Return the next action (8,)."""
        action = super().__call__(observation)
        if self.pulse is not None:
            self.change(self._share * self._network(self.pulse.observe()))
        return action
