"""Reference and readings of the case `swinging_ball`, without a simulation."""

import numpy as np
import pytest

from robosim.studies.verification.cases.coupling.swinging_ball import (
    added_mass,
    boundary_layer_damping,
    half_swing,
    image_velocity,
)


def test_added_mass_grows_towards_the_walls() -> None:
    """One half in unbounded water; the images' sum does not depend on where it is cut, and falls with the cube."""
    assert added_mass(1e-3, 1.0) == pytest.approx(0.5, abs=1e-6)
    assert image_velocity(0.02, 0.1, 40) == pytest.approx(image_velocity(0.02, 0.1, 80), rel=1e-3)
    assert image_velocity(0.02, 0.2) == pytest.approx(image_velocity(0.02, 0.1) / 8, rel=1e-9)
    assert 0.5 < added_mass(0.01, 0.1) < added_mass(0.02, 0.1) < 0.6


def test_images_are_those_of_a_potential_without_flow_through_walls() -> None:
    """In the near field of a wall far larger than the gap, the correction of one wall: 3/8 (a/h)^3 of 1/2 head on.

    A cube has two walls head on and four beside, 3/16 each, less what their images' images take.
    """
    single = 0.5 * (2 * 3 / 8 + 4 * 3 / 16) * (0.01 / 0.05) ** 3
    assert added_mass(0.01, 0.1) - 0.5 == pytest.approx(single, rel=0.4)


@pytest.mark.parametrize("damping", [0.0, 0.08, 0.4])
def test_frequency_and_damping_of_a_known_swing(damping: float) -> None:
    """Of a damped oscillator that starts at rest, from its next peak."""
    frequency, step = 6.9, 1e-3
    damped = frequency * np.sqrt(1 - damping**2)
    t = np.arange(800) * step
    swing = np.cos(damped * t) + damping * frequency / damped * np.sin(damped * t)
    x = 0.04 * np.exp(-damping * frequency * t) * swing
    found = half_swing(x, step)
    assert found == pytest.approx((frequency, damping), rel=1e-3, abs=1e-4)


def test_what_does_not_swing_has_no_frequency() -> None:
    assert np.isnan(half_swing(0.04 * np.exp(-np.linspace(0, 2, 500)), 1e-3)).all()


def test_water_damps_a_ball_of_this_size_by_a_hundredth() -> None:
    """The order of the boundary layer's thickness over the radius."""
    assert 0.005 < boundary_layer_damping(6.9, 0.1) < 0.02
