"""Adjoints against central differences, in double precision, over twenty random directions each."""

import numpy as np
import pytest
from adjoint_element import DT, AdjointElement

import mpm
from mpm.materials.stress_update import LEAST_RATIO
from mpm.state.packs import LANES

DIRECTIONS = 20
LAWS = {"hencky": mpm.Elastic(E=1e5, nu=0.3, density=1000.0),
        "neo_hookean": mpm.Elastic(E=1e5, nu=0.3, density=1000.0, model="neo_hookean"),
        "fixed_corotated": mpm.Elastic(E=1e5, nu=0.3, density=1000.0, model="fixed_corotated"),
        "von_mises": mpm.VonMises(E=1e5, nu=0.3, density=1000.0, yield_stress=4e3),
        "sand": mpm.DruckerPrager(E=1e5, nu=0.3, density=1500.0, friction_angle_deg=30.0),
        "cohesive_sand": mpm.DruckerPrager(E=1e5, nu=0.3, density=1500.0, friction_angle_deg=30.0, cohesion=2e3),
        "mu_i": mpm.MuIRheology(E=1e5, nu=0.3, density=1500.0, friction_angle_deg=20.0, limit_angle_deg=35.0,
                                cohesion=2e3, grain_diameter=1e-3, grain_density=2500.0),
        "fluid": mpm.NewtonianFluid(bulk_modulus=1e5, density=1000.0, viscosity=3.0),
        "fluid_without_tension": mpm.NewtonianFluid(bulk_modulus=1e5, density=1000.0, viscosity=3.0, tension=False)}


def numbers_of(law) -> np.ndarray:
    return np.pad(law.parameters, (0, 8 - len(law.parameters)))


@pytest.mark.parametrize("name", [name if name in ("sand", "mu_i", "fluid", "fluid_without_tension", "fixed_corotated")
                                  else pytest.param(name, marks=pytest.mark.slow) for name in LAWS])
def test_constitutive_update(name, rng):
    """From no strain (every eigenvalue the same) and from a large one; compressed, stretched, inside and outside the
    yield surface, one of each in the pack."""
    element = AdjointElement(LAWS[name])
    for size in (0.0, 0.08):
        state = size * rng.uniform(-1.0, 1.0, (LANES, element.size))
        if element.size >= 3 and size > 0:
            state[:, :3] += np.array([0.1, -0.1, -0.02, 0.003])[:, None]
        C = 30.0 * rng.standard_normal((LANES, 9))
        compare_with_differences(element, state, C, numbers_of(LAWS[name]), rng)


def compare_with_differences(element: AdjointElement, state: np.ndarray, C: np.ndarray, p: np.ndarray,
                             rng: np.random.Generator) -> None:
    """Assert that adjoints by state, C and parameters are central differences, for random weights of the results."""
    weights = rng.standard_normal((LANES, 6 + element.size))
    weights[:, :6] /= 1e5
    state_bar, C_bar, p_bar = element.backward(state, C, p, weights)
    for _ in range(DIRECTIONS):
        to_state, to_C = rng.standard_normal(state.shape), 1e3 * rng.standard_normal(C.shape)
        to_p, h = p * rng.standard_normal(8), 1e-6
        ends = [np.sum(weights * element.forward(state + s * to_state, C + s * to_C, p + s * to_p)) for s in (h, -h)]
        terms = [np.sum(state_bar * to_state), np.sum(C_bar * to_C), np.sum(p_bar * to_p)]
        difference = (ends[0] - ends[1]) / (2 * h)
        assert abs(sum(terms) - difference) <= 1e-6 * np.abs(terms).max()


@pytest.mark.parametrize("name", ["fluid", "fluid_without_tension"])
def test_fluid_at_large_rates(name, rng):
    """Where the volume changes to a twentieth or to twenty times of itself in a substep; and where it is held at the
    smallest ratio, which no longer depends on the rate."""
    element, p = AdjointElement(LAWS[name]), numbers_of(LAWS[name])
    C = 30.0 * rng.standard_normal((LANES, 9))
    C[:, 0] += np.array([-10.0, -3.0, 3.0, 10.0]) / DT
    compare_with_differences(element, 0.08 * rng.uniform(-1.0, 1.0, (LANES, 1)), C, p, rng)
    held, C[:, 0] = np.full((LANES, 1), LEAST_RATIO - 1.0), -10.0 / DT
    assert element.forward(held, C, p)[:, 6] == pytest.approx(LEAST_RATIO - 1.0, rel=1e-15)
    assert not element.backward(held, C, p, np.ones((LANES, 7)))[0].any()


@pytest.mark.slow
def test_derivatives_through_an_svd_and_over_a_smooth_yield_surface(rng):
    """Where strains differ an SVD loses nothing, where they coincide shear has no derivative; a smooth surface changes
    nothing in its limit, and where it is wide, derivatives do not jump between two grains on its two sides."""
    law, p = LAWS["sand"], numbers_of(LAWS["sand"])
    sharp, svd, narrow, wide = (AdjointElement(law, **options)
                                for options in ({}, {"svd": True}, {"soft": 1e-9}, {"soft": 0.5}))

    def bars(element: AdjointElement, state: np.ndarray, C: np.ndarray, weights: np.ndarray) -> np.ndarray:
        return np.column_stack(element.backward(state, C, p, weights)[:2])

    state = 0.05 * rng.uniform(-1.0, 1.0, (LANES, sharp.size))
    state[:, :3] += np.array([0.1, -0.1, -0.02, 0.003])[:, None]
    C, weights = 30.0 * rng.standard_normal((LANES, 9)), rng.standard_normal((LANES, 6 + sharp.size))
    weights[:, :6] /= 1e5
    ours = bars(sharp, state, C, weights)
    assert bars(svd, state, C, weights) == pytest.approx(ours, rel=1e-7, abs=1e-9)
    assert bars(narrow, state, C, weights) == pytest.approx(ours, rel=1e-9, abs=1e-12)
    pressed, still = np.zeros((LANES, sharp.size)), np.zeros((LANES, 9))
    pressed[:, :3] = -0.02
    found = [bars(element, pressed, still, weights)[:, 3:6] for element in (sharp, svd)]
    assert np.abs(found[0]).min() > 0.0 and np.abs(found[1]).max() < 1e-3 * np.abs(found[0]).max()
    low, high = 0.0, 0.1  # shear of a pressed grain: the largest that does not yet yield
    for _ in range(60):
        middle = 0.5 * (low + high)
        sheared = pressed.copy()
        sheared[:, 3] = middle
        kept = sharp.forward(sheared, still, p)[:, 6 + 3]
        low, high = (middle, high) if np.all(kept > middle * (1 - 1e-9)) else (low, middle)
    jumps = []
    for element in (sharp, wide):
        ends = []
        for shear in (low * (1 - 1e-7), high * (1 + 1e-7)):
            sheared = pressed.copy()
            sheared[:, 3] = shear
            ends.append(bars(element, sheared, still, weights))
        jumps.append(np.abs(ends[1] - ends[0]).max())
    assert jumps[0] > 1e-2 and jumps[1] < 1e-4 * jumps[0]
    pressed[:, 3] = 1e-4 * low  # far within the surface nothing grows
    found = [np.abs(bars(element, pressed, still, weights)).max() for element in (sharp, wide)]
    assert found[1] < 1.5 * found[0]


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)
