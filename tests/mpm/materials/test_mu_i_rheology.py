"""Friction that grows with the rate of shear, against the law of Jop, Forterre and Pouliquen (2006) itself."""

import math

import numpy as np
import pytest
from element import Element

import mpm

BEADS = {"E": 1e6, "nu": 0.3, "density": 1500.0, "friction_angle_deg": 18.0, "grain_diameter": 1e-3,
         "grain_density": 2450.0}
STATIC, LIMIT = (mpm.DruckerPrager(E=1e6, nu=0.3, density=1500.0, friction_angle_deg=angle) for angle in (18.0, 29.0))


def shear(material: mpm.DruckerPrager, rate: float, dt: float, until: float = 0.1) -> tuple[float, float]:
    """Shear a point, pressed by 1.5 %, at a rate [1/s] and constant volume; return its pressure and shear stress."""
    element = Element(material)
    element.apply(0.995 * np.eye(3), dt)
    step = np.eye(3)
    step[0, 1] = rate * dt
    for _ in range(round(until / (rate * dt))):
        element.apply(step, dt)
    tau = element.tau
    return -np.trace(tau) / 3.0, float(np.linalg.norm(tau - np.trace(tau) / 3.0 * np.eye(3)) / math.sqrt(2.0))


@pytest.mark.parametrize("rate", [0.1, 10.0, 1000.0])
def test_steady_shear_has_the_friction_of_its_inertial_number(rate: float) -> None:
    """Over four decades of I, from the friction at rest to well over half way to that at infinite rate."""
    material = mpm.MuIRheology(**BEADS, limit_angle_deg=29.0)
    pressure, stress = shear(material, rate, 1e-3 / rate)
    inertial = rate * 1e-3 / math.sqrt(pressure / 2450.0)
    low, high = (3.0 * law.alpha / math.sqrt(2.0) for law in (STATIC, LIMIT))
    expected = low + (high - low) / (1.0 + 0.279 / inertial)
    assert stress / pressure == pytest.approx(expected, rel=2e-4) and low < stress / pressure < high


def test_friction_does_not_depend_on_the_substep() -> None:
    """A tenth of it leaves the stress, which the law gives implicitly, as it is."""
    material = mpm.MuIRheology(**BEADS, limit_angle_deg=29.0)
    assert shear(material, 50.0, 2e-5)[1] == pytest.approx(shear(material, 50.0, 2e-6)[1], rel=1e-3)


def test_the_same_angle_at_any_rate_is_drucker_prager() -> None:
    """Also where it is pulled apart, and pressed again afterwards."""
    plain, same = Element(STATIC), Element(mpm.MuIRheology(**BEADS, limit_angle_deg=18.0))
    rng = np.random.default_rng(3)
    for push in (-0.01, 0.02, -0.03, 0.0):
        F = np.eye(3) * (1.0 + push) + 0.02 * rng.standard_normal((3, 3))
        for found, expected in zip(same.apply(F), plain.apply(F)):
            assert found == pytest.approx(expected, rel=1e-9, abs=1e-6)
        assert same.vc == pytest.approx(plain.vc, abs=1e-12)


def test_cohesion_does_not_grow_with_the_rate() -> None:
    """A faster flow gains what friction does: as much with cohesion as without."""
    loose, sticky = (mpm.MuIRheology(**BEADS, limit_angle_deg=29.0, cohesion=cohesion) for cohesion in (0.0, 3e3))
    gains = [shear(material, 500.0, 2e-6)[1] - shear(material, 0.05, 2e-2)[1] for material in (loose, sticky)]
    assert gains[0] > 500.0 and gains[1] == pytest.approx(gains[0], rel=0.01)


@pytest.mark.parametrize(("numbers", "text"), [
    ({"limit_angle_deg": 17.0}, "friction_angle_deg = 18, limit_angle_deg = 17"),
    ({"limit_angle_deg": 29.0, "grain_diameter": 0.0}, "grain_diameter [m] = 0"),
    ({"limit_angle_deg": 29.0, "friction_angle_deg": 0.0}, "0 < friction_angle_deg")])
def test_numbers_out_of_range_are_refused(numbers: dict, text: str) -> None:
    with pytest.raises(mpm.InvalidValue) as error:
        mpm.MuIRheology(**{**BEADS, **numbers})
    assert text in str(error.value)
