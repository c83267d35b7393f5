"""The pulses of a dose as decisions."""

from typing import Any, cast

import gymnasium
import numpy as np

from robosim.dosing.command import accepted_error
from robosim.dosing.pulses import CHANGES, LARGEST_MASS, OBSERVED
from robosim.envs.grain_env import GrainEnv
from robosim.studies.policies.dosing import PulsedDosing
from robosim.studies.tuning.trial import episode_cost
from robosim.tasks.counting import TOOL

HIDDEN = 6
"""Numbers at the end of an observation that only critics see: what no sensor of a robot shows."""
DENSE, STEEP, COHESIVE = 1500.0, 45.0, 1000.0
"""Units of a material's density [kg/m^3], friction angle [deg] and cohesion [Pa]."""


class PulseWrapper(gymnasium.Wrapper):
    """Pulses of PI control: a decision changes the strength and the time of one, 5 to 20 times in a dose.

    Its observation is what is seen as the pulse begins, OBSERVED numbers, and HIDDEN more for critics: the mass that is
    in the tool and that is missing, and the material. The controller does all the rest. A decision is rewarded with
    what it saves of the cost that controllers are tuned by: error and spilled mass in accepted errors, and time. It
    costs `cost` x the mean square of the action. A dose without a pulse has one decision, which changes nothing.
    share: by which actions are scaled. Raises what `PulsedDosing` raises."""

    def __init__(self, env: gymnasium.Env, share: float, cost: float = 0.0) -> None:
        super().__init__(env)
        self.raw = cast(GrainEnv, env.unwrapped)
        self._share, self._cost = share, cost
        self._duration = self.raw.task.steps * self.raw.task.step_dt
        self._dosing = PulsedDosing(self.raw)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (CHANGES,), np.float32)
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (OBSERVED + HIDDEN,), np.float32)

    def reset(self, **options: Any) -> tuple[np.ndarray, dict[str, Any]]:
        """Reset the environment, and play to the first pulse or to the end of the dose."""
        self._next, info = self.env.reset(**options)
        self._dosing = PulsedDosing(self.raw)
        self._end, self._info = (False, False), info
        self._seen = np.zeros(OBSERVED + HIDDEN, np.float32)
        self._play_to_pulse()
        self._charged = self._charge()
        return self._seen.copy(), self._info

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Change the pulse, and play to the next one or to the end of the dose."""
        if not any(self._end):
            self._dosing.change(self._share * np.asarray(action))
            self._advance()
            self._play_to_pulse()
        before, self._charged = self._charged, self._charge()
        reward = before - self._charged - self._cost * float(np.mean(np.square(action)))
        return self._seen.copy(), reward, *self._end, self._info

    def _play_to_pulse(self) -> None:
        while not any(self._end):
            self._action = self._dosing(self._next)
            if self._dosing.pulse is not None:
                self._seen = np.concatenate([self._dosing.pulse.observe(), self._hidden()], dtype=np.float32)
                return
            self._advance()

    def _advance(self) -> None:
        self._next, _, terminated, truncated, self._info = self.env.step(self._action)
        self._end = (terminated, truncated)

    def _hidden(self) -> np.ndarray:
        """Return what only critics see, (HIDDEN,), each of about 1; 0 for what a material does not have."""
        solver, readings, target = self.raw.solver, self._info["readings"], self._info["readings"]["target_mass"]
        missing = (target - readings["poured"]) / (5.0 * self._accepted())
        numbers: Any = solver.bodies[0].material
        return np.array([
            np.clip(missing, -LARGEST_MASS, LARGEST_MASS), min(readings["held"] / target, LARGEST_MASS),
            numbers.density / DENSE, getattr(numbers, "friction_angle_deg", 0.0) / STEEP,
            getattr(numbers, "cohesion", 0.0) / COHESIVE, solver.colliders[TOOL].friction])

    def _accepted(self) -> float:
        """Return the error of the dose that is accepted [kg]."""
        dose = self.raw.task.dose
        assert dose is not None
        return accepted_error(self._info["readings"]["target_mass"], dose.tolerance_percent, dose.tolerance_g)

    def _charge(self) -> float:
        """Return the cost of the dose as it stands."""
        diverged = self._info.get("diverged") or ""
        return episode_cost({**self._info["readings"], "accepted_error": self._accepted(), "diverged": diverged},
                            self._duration)
