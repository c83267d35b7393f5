"""The balance of a dose: its filter against the exponential, its tare and its display."""

import numpy as np
import pytest

from robosim.config.motion import BalanceConfig
from robosim.rehearsal.dosing.balance import TaredBalance

EXACT = BalanceConfig(readability=0.0, repeatability=0.0)


def test_a_step_of_mass_is_shown_as_the_lag_lets_it() -> None:
    balance = TaredBalance(EXACT, 2.0, 0.1)
    for k in range(1, 60):
        passed = 0.02 * k
        assert balance.read(2.0 + passed, 0.12) == pytest.approx(0.02 * (1.0 - np.exp(-passed / EXACT.lag)), rel=1e-9)


def test_without_a_lag_it_shows_the_mass_less_the_tare() -> None:
    balance = TaredBalance(EXACT.model_copy(update={"lag": 0.0}), 0.0, 0.3)
    assert balance.read(0.0, 0.3) == 0.0
    assert balance.read(0.02, 0.35) == pytest.approx(0.05)


def test_the_display_has_steps_and_scatters() -> None:
    """Every reading is a multiple of the readability; their scatter is the repeatability, with that of rounding."""
    balance = TaredBalance(BalanceConfig(lag=0.0, readability=1e-5, repeatability=5e-5), 0.0, 0.0)
    shown = np.array([balance.read(0.02 * k, 0.02) for k in range(2000)])
    assert np.abs(shown / 1e-5 - np.round(shown / 1e-5)).max() < 1e-6
    assert shown.mean() == pytest.approx(0.02, abs=5e-6)
    assert shown.std() == pytest.approx(np.hypot(5e-5, 1e-5 / np.sqrt(12.0)), rel=0.1)
