"""Pour curves and files of dosing numbers: interpolation, and what they refuse."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from pouring_plant import SALT, VIBRATION

from robosim.base.errors import ConfigError
from robosim.dosing.numbers import load_dosing
from robosim.dosing.pour_curve import PourCurve

CURVE = SALT.model_dump(mode="json")


def test_tilt_is_the_inverse_of_mass() -> None:
    for mass in np.linspace(0.0005, 0.0799, 20):
        assert SALT.mass(SALT.tilt(mass)) == pytest.approx(mass)
    assert np.degrees(SALT.tilt(0.2)) == pytest.approx(75.0) and np.degrees(SALT.tilt(-1.0)) == pytest.approx(20.0)
    assert SALT.mass(SALT.begin) == pytest.approx(0.01 * SALT.load)


def test_a_mass_of_a_plateau_is_reached_at_its_begin() -> None:
    curve = PourCurve.model_validate(CURVE | {"masses": [0.0, 0.02, 0.02, 0.02, 0.05, 0.08]})
    assert np.degrees(curve.tilt(0.02)) == pytest.approx(30.0)
    assert np.degrees(curve.tilt(0.035)) == pytest.approx(55.0)


def test_tilt_per_mass_is_the_mean_slope_also_at_the_end() -> None:
    assert SALT.tilt_per_mass(0.02, 0.025) == pytest.approx(np.radians(10.0) / 0.025)
    at_end = np.radians(15.0) / 0.012
    assert SALT.tilt_per_mass(0.068, 0.012) == pytest.approx(at_end)
    assert SALT.tilt_per_mass(0.079, 0.012) == pytest.approx(at_end)
    assert SALT.tilt_per_mass(0.5, 0.012) == pytest.approx(at_end)


@pytest.mark.parametrize(("curve", "numbers", "message"), [
    ({"masses": [0.0, 0.002]}, {}, "6 tilts_deg and 2 masses; accepted: as many"),
    ({"tilts_deg": [20, 30, 30, 50, 60, 75]}, {}, "accepted: rising"),
    ({"masses": [0.0, 0.03, 0.02, 0.045, 0.068, 0.08]}, {}, "none below the one before"),
    ({"masses": [0.0, 0.002, 0.02, 0.045, 0.068, 0.09]}, {}, "90.00 g are poured of a load of 80.00 g"),
    ({"masses": [0.0] * 6}, {}, "0.00 g are poured in all; accepted: from 0.80 g"),
    ({"tilts_deg": [20, 30, 40, 50, 60, 400]}, {}, "less than or equal to 180"),
    ({"load": float("nan")}, {}, "load"),
    ({}, {"pi": {"fastest_deg": 90}}, "pi.fastest_deg = 90.0 with motion.fast_deg = 60.0"),
    ({}, {"pi": {"gain": 1}}, "unknown key 'pi.gain'; valid: before_deg"),
    ({}, {"shaker": {"amplitude": 2}}, "shaker.amplitude"),
])
def test_curves_and_numbers_that_are_refused(tmp_path: Path, curve: dict, numbers: dict, message: str) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump({"task": "Mine", "tool": "spoon", "curve": CURVE | curve, "vibration": VIBRATION,
                                    **numbers}))
    with pytest.raises(ConfigError, match=f"mine.yaml.*{message}"):
        load_dosing(str(path))
