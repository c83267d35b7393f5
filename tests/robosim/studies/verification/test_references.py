"""References and readings of cases, without a simulation."""

import math

import numpy as np
import pytest

from robosim.base.errors import UnknownName
from robosim.studies.verification.cases.continuum import manufactured
from robosim.studies.verification.cases.coupling import swinging_ball as ball
from robosim.studies.verification.cases.granular import discharge, drum, rotating_drum


@pytest.mark.parametrize(("model", "expected"), [
    ("neo_hookean", (833.057067555, -184.990465035, -1243.50864019)),
    ("fixed_corotated", (875.847657867, -160.854949802, -912.41212371)),
    ("hencky", (433.066088704, -179.669138527, -1668.19178685))])
def test_axis_aligned_acceleration(model: str, expected: tuple[float, ...]) -> None:
    """Values at X = (.31, .62, .17), t = .0037 from differences in 50-digit arithmetic (validation A2)."""
    value = manufactured.cube_acceleration(np.array([[0.31, 0.62, 0.17]]), 0.0037, model)
    assert value[0] == pytest.approx(expected, rel=1e-9)


def test_vortex_acceleration() -> None:
    value = manufactured.ring_acceleration(np.array([[0.61, 0.73]]), 0.3, 0.1)
    assert value[0] == pytest.approx((-0.513507500584, 0.305846682095), rel=1e-9)


def test_laws_of_the_slot_have_the_friction_of_the_reference() -> None:
    """Ratio of shear stress to pressure in slow simple shear: tan 30 deg, and 0.32 of the mu(I) continuum."""
    ratios = [3.0 / math.sqrt(2.0) * discharge.make_sand(law, 1e5).alpha for law in discharge.LAWS]
    assert ratios == pytest.approx([math.tan(math.radians(30.0)), 0.32, 0.32], abs=1e-4)
    with pytest.raises(UnknownName, match="mu_i"):
        discharge.make_sand("honey", 1e5)


def test_a_slope_of_a_drum_is_found_from_its_grains() -> None:
    """Grains below a plane through a drum, at three slopes and two levels; and the level for a share of the circle."""
    rng = np.random.default_rng(0)
    for degrees, level in ((10.0, 0.0), (30.0, 0.0), (35.0, -0.3)):
        tilt, x = math.radians(degrees), rng.uniform(-0.1, 0.1, (200000, 3))
        below = x[:, 2] * math.cos(tilt) + x[:, 0] * math.sin(tilt) < level * 0.1
        x = x[below & (np.hypot(x[:, 0], x[:, 2]) < 0.1)]
        angle, height = drum.surface_line(x, 0.005, 0.1)
        assert angle == pytest.approx(degrees, abs=0.5) and height == pytest.approx(0.1 * level + 0.00125, abs=5e-4)
        assert rotating_drum.centre_slope(x) == pytest.approx(degrees, abs=0.5)
        room = math.pi * 0.1**2 * drum.share_of(level) / len(x)
        assert drum.room_inside(x, (angle, 0.1 * level), 0.1, 0.02) == pytest.approx(room, rel=0.02)
    for share in (0.2, 0.5, 0.8):
        level = drum.level_of(share)
        assert drum.share_of(level) == pytest.approx(share)
        strips = np.linspace(-1.0, level, 200001)
        chords = 2.0 * np.sqrt(np.clip(1.0 - strips**2, 0.0, None))
        assert np.trapezoid(chords, strips) / math.pi == pytest.approx(share, abs=1e-5)


def test_added_mass_grows_towards_the_walls() -> None:
    """One half in unbounded water; the images' sum does not depend on where it is cut, and falls with the cube."""
    assert ball.added_mass(1e-3, 1.0) == pytest.approx(0.5, abs=1e-6)
    assert ball.image_velocity(0.02, 0.1, 40) == pytest.approx(ball.image_velocity(0.02, 0.1, 80), rel=1e-3)
    assert ball.image_velocity(0.02, 0.2) == pytest.approx(ball.image_velocity(0.02, 0.1) / 8, rel=1e-9)
    assert 0.5 < ball.added_mass(0.01, 0.1) < ball.added_mass(0.02, 0.1) < 0.6


def test_images_are_those_of_a_potential_without_flow_through_walls() -> None:
    """In the near field of a wall far larger than the gap, the correction of one wall: 3/8 (a/h)^3 of 1/2 head on.
    A cube has two walls head on and four beside, 3/16 each, less what their images' images take."""
    single = 0.5 * (2 * 3 / 8 + 4 * 3 / 16) * (0.01 / 0.05) ** 3
    assert ball.added_mass(0.01, 0.1) - 0.5 == pytest.approx(single, rel=0.4)


@pytest.mark.parametrize("damping", [0.0, 0.08, 0.4])
def test_frequency_and_damping_of_a_known_swing(damping: float) -> None:
    """Of a damped oscillator that starts at rest, from its next peak."""
    frequency, step = 6.9, 1e-3
    damped = frequency * np.sqrt(1 - damping**2)
    t = np.arange(800) * step
    swing = np.cos(damped * t) + damping * frequency / damped * np.sin(damped * t)
    x = 0.04 * np.exp(-damping * frequency * t) * swing
    found = ball.half_swing(x, step)
    assert found == pytest.approx((frequency, damping), rel=1e-3, abs=1e-4)


def test_what_does_not_swing_has_no_frequency() -> None:
    assert np.isnan(ball.half_swing(0.04 * np.exp(-np.linspace(0, 2, 500)), 1e-3)).all()
