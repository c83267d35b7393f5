"""The check on held-out experiments: a correct calibration is rejected as seldom as the bound says."""

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("sklearn")

from robosim.studies.calibration.experiment import Numbers, Trial
from robosim.studies.calibration.posterior import Posterior
from robosim.studies.calibration.run import Runs, predict_held_out
from robosim.studies.calibration.search import Ranges, Search
from robosim.studies.calibration.verdict import LEAST_PROBABILITY, residual

RANGES = Ranges.of({"a": (0.0, 1.0), "b": (0.0, 1.0)})
READINGS, ERROR = 15, 0.01
AXIS = np.linspace(0.0, 1.0, READINGS)
WIDTHS = np.array([0.04, 0.06])
"""Standard deviations of the posterior: they move the readings by several of their errors."""


def read(numbers: Numbers, seed: int) -> np.ndarray:
    """What would be read: linear in the numbers."""
    return numbers["a"] + numbers["b"] * AXIS


def rejected_share(count: int, store: Runs, *, is_direct: bool, offset: float = 0.0) -> float:
    """Share of calibrations of known numbers whose held-out experiment is said not to be predicted."""
    rng, rejected = np.random.default_rng(3), 0
    for k in range(count):
        truth = np.array([0.5, 0.5])
        mean = truth + WIDTHS * rng.normal(size=2)
        found = Search(Posterior(mean + WIDTHS * rng.normal(size=(400, 2)), mean), {}, np.empty((0, 2)), True)
        readings = read(RANGES.numbers(truth), 0) + ERROR * rng.normal(size=READINGS) + offset * np.cos(9 * AXIS)
        trial = Trial(f"tall {k}", "heap", readings, np.full(READINGS, ERROR), read, is_direct, True, AXIS, "r", "m")
        rejected += not residual(trial, *predict_held_out(trial, RANGES, found, store)).is_explained
    return rejected / count


@pytest.mark.parametrize(("is_direct", "count"), [
    (True, 400), pytest.param(False, 60, marks=pytest.mark.slow)], ids=["closed form", "emulated"])
def test_correct_calibrations_are_rejected_as_seldom_as_the_bound_says(is_direct: bool, count: int, tmp_path: Path
                                                                       ) -> None:
    """At most as many as the binomial distribution exceeds with a probability of about 1 %."""
    share = rejected_share(count, Runs(tmp_path, "key"), is_direct=is_direct)
    assert share <= LEAST_PROBABILITY + 2.5 * np.sqrt(LEAST_PROBABILITY / count)


def test_a_misfit_that_no_numbers_give_is_rejected(tmp_path: Path) -> None:
    """Readings off by three of their errors in a shape that the numbers do not have."""
    assert rejected_share(20, Runs(tmp_path, "key"), is_direct=True, offset=3 * ERROR) > 0.9
