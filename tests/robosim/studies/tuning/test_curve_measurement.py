"""The mean of measured pour curves, on points that are made up."""

import numpy as np
import pytest

from robosim.base.errors import ConfigError
from robosim.dosing.pour_curve import PourCurve
from robosim.studies.tuning.curve import STEP_DEG, mean_curve


def ramp(begin: float, end: float, mass: float, last: float = 100.0) -> list[tuple[float, float]]:
    """Return points of a run that pours a mass [kg] evenly between two tilts [deg]."""
    return [(float(t), float(mass * np.clip((t - begin) / (end - begin), 0.0, 1.0))) for t in np.arange(0.5, last, 0.5)]


def test_the_mean_of_two_runs_lies_between_them() -> None:
    tilts, masses = mean_curve([ramp(20.0, 60.0, 0.04), ramp(30.0, 70.0, 0.02)], 100.0)
    assert (tilts[0], tilts[-1]) == (20.0, 70.0) and np.diff(tilts) == pytest.approx(STEP_DEG)
    assert masses[0] == 0.0 and masses[-1] == pytest.approx(0.03)
    assert masses[tilts.index(50.0)] == pytest.approx((0.03 + 0.01) / 2.0, abs=1e-5)


def test_a_mean_is_a_pour_curve_also_where_a_grain_comes_back() -> None:
    points = ramp(20.0, 60.0, 0.04)
    points[90] = (points[90][0], points[90][1] - 2e-3)
    tilts, masses = mean_curve([points], 100.0)
    curve = PourCurve(material="salt", load=0.04, rate_deg=4.0, tilts_deg=tuple(tilts), masses=tuple(masses),
                      source="made up for tests")
    assert np.all(np.diff(masses) >= 0.0) and curve.mass(np.radians(30.0)) == pytest.approx(0.01, abs=2e-5)


def test_runs_that_are_refused() -> None:
    with pytest.raises(ConfigError, match="episode 1 has no tilt: the lip was not above the cup in time; accepted: "):
        mean_curve([ramp(20.0, 60.0, 0.04), []], 100.0)
    wrapped = [(170.0, 0.01), (179.9, 0.02), (-179.9, 0.02)]
    with pytest.raises(ConfigError, match="episode 0: a tilt of -179.9 deg after 179.9 deg; accepted: rising"):
        mean_curve([wrapped], 180.0)
