"""Pulses of a dose that are changed as they begin, on a plant without grains."""

from collections.abc import Callable

import numpy as np
import pytest
from pouring_plant import SALT, VIBRATION, Dose, Plant

from robosim.dosing.command import DoseCommand, DoseController, DoseSight
from robosim.dosing.numbers import DosingNumbers
from robosim.dosing.pi import PiDosing
from robosim.dosing.pulses import HISTORY, OBSERVED, Pulse, PulseSight, pulse_factors

NUMBERS = DosingNumbers.model_validate({
    "task": "Plant", "tool": "spoon", "curve": SALT, "vibration": VIBRATION,
    "pi": {"before_deg": 10, "search_deg": 4, "time": 2, "integral": 0.4, "first": 0.6, "pulse": 0.4}})


class Changed(DoseController):
    """PI control whose pulses are changed by factors, or not touched; keeps what was seen of each, and its commands."""

    def __init__(self, factors: Callable[[PulseSight], tuple[float, float]] | None) -> None:
        self._pi, self._factors = PiDosing(NUMBERS, Plant.dt), factors
        self.seen: list[PulseSight] = []
        self.commands: list[list[DoseCommand]] = []
        """Those of each pulse, from the one with which it begins."""

    def start(self, target: float, accepted: float) -> None:
        self._pi.start(target, accepted)

    def command(self, sight: DoseSight) -> DoseCommand:
        command, pulse = self._pi.command(sight), self._pi.pulse
        if pulse is not None:
            self.seen.append(pulse)
            self.commands.append([])
            if self._factors is not None:
                self._pi.change(*self._factors(pulse))
        if self.commands:
            self.commands[-1].append(command)
        return command

    def shaking(self, k: int) -> list[float]:
        """Amplitudes of a pulse, in shares of the largest, while it shakes; without the command that begins it."""
        return [one.amplitude / VIBRATION["amplitude"] for one in self.commands[k][1:] if one.amplitude > 0.0]


def dose(factors: Callable[[PulseSight], tuple[float, float]] | None, seed: int = 0) -> tuple[Changed, Dose]:
    controller = Changed(factors)
    return controller, Dose(controller, Plant(SALT, seed), 20e-3)


@pytest.mark.parametrize("seed", range(3))
def test_pulses_that_are_not_changed_are_those_of_pi_control(seed: int) -> None:
    (_, plain), (one, same) = dose(None, seed), dose(lambda pulse: (1.0, 1.0), seed)
    assert len(one.seen) >= 2
    for a, b in zip(plain.commands, same.commands, strict=True):
        assert a.tilt_rate == b.tilt_rate and a.amplitude == b.amplitude


def test_a_pulse_shakes_as_strongly_and_as_long_as_it_is_changed_to() -> None:
    weak = dose(lambda pulse: (0.5, 0.5))[0]
    strong = dose(lambda pulse: (2.0, 1.0))[0]
    before = weak.seen[0].strength
    assert weak.shaking(0) == pytest.approx([max(0.5 * before, NUMBERS.pi.weakest)] * len(weak.shaking(0)))
    assert len(weak.shaking(0)) * Plant.dt == pytest.approx(0.5 * NUMBERS.pi.pulse, abs=1.5 * Plant.dt)
    assert max(strong.shaking(0)) == pytest.approx(min(2.0 * before, 1.0))


def test_a_pulse_shows_those_before_it_and_what_they_brought() -> None:
    """Newest first; what is missing falls by what came, but for what came between."""
    controller, made = dose(lambda pulse: (1.0, 0.5))
    assert len(controller.seen) > HISTORY + 1 and controller.seen[0].past == ()
    for before, after in zip(controller.seen, controller.seen[1:], strict=False):
        assert after.past[1:] == before.past[: HISTORY - 1]
        assert after.past[0].time == pytest.approx(0.5 * NUMBERS.pi.pulse)
        assert after.past[0].came == pytest.approx(max(before.missing - after.missing, 0.0), abs=1e-9)
        assert after.left < before.left
    assert controller.seen[0].target == 20e-3 and 0.0 < controller.seen[-1].missing < 8e-3
    assert abs(made.error) < 1e-3


def test_what_is_seen_is_finite_and_of_order_one() -> None:
    past = (Pulse(0.4, 0.2, 1.0),)
    seen = PulseSight(0.01, 3e-4, -0.5, 2e-4, 0.3, 0.5, 0.7, past).observe()
    assert seen.shape == (OBSERVED,) and np.isfinite(seen).all() and np.abs(seen).max() <= 5.0
    assert seen[-3 * HISTORY:] == pytest.approx([0.4, 0.2, 5.0] + [0.0] * 6)
    assert np.isfinite(PulseSight(0.01, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, ()).observe()).all()


def test_actions_are_factors() -> None:
    assert pulse_factors(np.zeros(2)) == (1.0, 1.0)
    assert pulse_factors(np.array([1.0, -1.0])) == (2.0, 0.5) == pulse_factors(np.array([9.0, -9.0]))
