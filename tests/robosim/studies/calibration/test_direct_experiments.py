"""Experiments with a closed form, against hand calculations and limits."""

import math

import pytest

from robosim.studies.calibration.direct import friction_angle, predict, shear_ratio, shear_strength, sliding_angle
from robosim.studies.calibration.measurements import CupExperiment, ScoopExperiment, ShearExperiment, TiltExperiment

G = 9.81


@pytest.mark.parametrize(("phi", "ratio"), [(20.0, 0.4457), (30.0, 0.6928), (40.0, 0.9446)])
def test_the_shear_ratio_is_that_of_the_law(phi: float, ratio: float) -> None:
    """Ratios of the cone integrated along a path of simple shear, as the verification case measures them."""
    assert shear_ratio(phi) == pytest.approx(ratio, abs=1e-4)
    assert friction_angle(shear_ratio(phi)) == pytest.approx(phi)


def test_strength_without_pressure_is_the_apex_times_the_ratio() -> None:
    assert shear_strength(0.0, 30.0, 50.0) == pytest.approx(shear_ratio(30.0) * 50.0 / math.tan(math.radians(30.0)))
    assert shear_strength(100.0, 30.0, 0.0) == pytest.approx(100.0 * shear_ratio(30.0))


def test_a_layer_without_cohesion_slides_at_the_same_angle_whatever_its_depth() -> None:
    expected = math.degrees(math.atan(shear_ratio(30.0)))
    assert [sliding_angle(depth, 850.0, 30.0, 0.0) for depth in (0.005, 0.5)] == pytest.approx([expected] * 2)


@pytest.mark.parametrize("depth", [0.005, 0.02, 0.1])
def test_a_sliding_layer_is_in_balance(depth: float) -> None:
    """Pull of the weight = strength under its pressure, along the base."""
    density, phi, cohesion = 560.0, 35.0, 12.0
    angle = math.radians(sliding_angle(depth, density, phi, cohesion))
    weight = density * G * depth
    if angle < math.pi / 2:
        assert weight * math.sin(angle) == pytest.approx(shear_strength(weight * math.cos(angle), phi, cohesion))


def test_a_thin_cohesive_layer_never_slides() -> None:
    assert sliding_angle(0.001, 560.0, 35.0, 30.0) == 90.0


def test_readings_that_are_predicted() -> None:
    numbers = {"density": 800.0, "friction_angle_deg": 30.0, "cohesion": 0.0, "wall_friction": 0.5}
    cup = CupExperiment(kind="cup", masses=[0.1, 0.1], noise=0.001, volume=2e-4)
    assert predict(cup, numbers) == pytest.approx([0.16, 0.16])
    wall = TiltExperiment(kind="tilt", angles=[25.0], noise=1.0, depth=0.01, slides_on="wall")
    assert predict(wall, numbers) == pytest.approx([math.degrees(math.atan(0.5))])
    shear = ShearExperiment(kind="shear", normal_stress=[100.0, 200.0], shear_stress=[1.0, 1.0], noise=1.0)
    assert predict(shear, numbers) == pytest.approx([100 * shear_ratio(30.0), 200 * shear_ratio(30.0)])
    scoop = ScoopExperiment(kind="scoop", masses=[0.1], noise=0.001, volume=1e-4, rim_radius=0.03)
    cone = math.pi * 0.03**3 * shear_ratio(30.0) / 3  # a flank without cohesion has the ratio as its slope
    assert predict(scoop, numbers) == pytest.approx([800.0 * (1e-4 + cone)])
