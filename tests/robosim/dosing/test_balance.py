"""A balance: its filter whatever the interval of readings, its drift, and a memory that can be stored."""

import copy

import numpy as np
import pytest

from robosim.dosing.balance import Balance


def test_the_filter_does_not_depend_on_the_interval_of_readings() -> None:
    """Of a mass that stays the same after a step: each reading is on the exponential."""
    balance, rng = Balance(0.2, 0.0, 0.0), np.random.default_rng(0)
    for interval in (0.01, 0.05, 0.37):
        memory = balance.start(1.0, 0.1)
        for time in 1.0 + interval * np.arange(1, 12):
            shown = balance.read(memory, time, 0.14, rng, tare=0.1)
            assert shown == pytest.approx(0.04 * (1.0 - np.exp(-(time - 1.0) / 0.2)), rel=1e-9)


def test_the_zero_drifts_along_a_line_with_a_slope_of_its_own() -> None:
    balance, slopes = Balance(0.0, 0.0, 0.0, drift=1e-5), []
    for seed in range(400):
        rng, memory = np.random.default_rng(seed), balance.start(0.0, 0.02)
        shown = np.array([balance.read(memory, time, 0.02, rng) - 0.02 for time in (1.0, 2.0, 5.0)])
        np.testing.assert_allclose(shown / [1.0, 2.0, 5.0], shown[0], rtol=1e-6)
        slopes.append(shown[0])
    assert np.std(slopes) == pytest.approx(1e-5, rel=0.1)
    assert abs(np.mean(slopes)) < 2e-6


def test_a_copied_memory_goes_on_with_the_same_bits() -> None:
    balance, rng = Balance(0.2, 1e-5, 1e-5, drift=1e-5), np.random.default_rng(3)
    memory = balance.start(0.0, 0.0)
    for k in range(1, 5):
        balance.read(memory, 0.02 * k, 0.01, rng)
    other, again = copy.deepcopy(memory), copy.deepcopy(rng)
    for k in range(5, 40):
        assert balance.read(memory, 0.02 * k, 0.02, rng) == balance.read(other, 0.02 * k, 0.02, again)
