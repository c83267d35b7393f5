"""The pulses of a dose as decisions."""

from typing import Any, cast

import gymnasium
import numpy as np

from robosim.dosing.command import accepted_error
from robosim.dosing.pulses import CHANGES, OBSERVED
from robosim.envs.grain_env import GrainEnv
from robosim.studies.evaluation.pulse_policy import PulsedDosing
from robosim.studies.tuning.trial import episode_cost


class PulseWrapper(gymnasium.Wrapper):
    """Pulses of PI control: a decision changes the strength and the time of one, 5 to 20 times in a dose.

    Its observation is what is seen as the pulse begins; the controller does all the rest. A decision is rewarded with
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
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (OBSERVED,), np.float32)

    def reset(self, **options: Any) -> tuple[np.ndarray, dict[str, Any]]:
        """Reset the environment, and play to the first pulse or to the end of the dose."""
        self._next, info = self.env.reset(**options)
        self._dosing = PulsedDosing(self.raw)
        self._end, self._info = (False, False), info
        self._seen = np.zeros(OBSERVED, np.float32)
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
                self._seen = self._dosing.pulse.observe()
                return
            self._advance()

    def _advance(self) -> None:
        self._next, _, terminated, truncated, self._info = self.env.step(self._action)
        self._end = (terminated, truncated)

    def _charge(self) -> float:
        """Return the cost of the dose as it stands."""
        readings, dose = self._info["readings"], self.raw.task.dose
        assert dose is not None
        accepted = accepted_error(readings["target_mass"], dose.tolerance_percent, dose.tolerance_g)
        return episode_cost({**readings, "accepted_error": accepted, "diverged": self._info.get("diverged") or ""},
                            self._duration)
