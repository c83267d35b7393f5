"""Laws at one material point against closed forms (validation section A9; von Mises by definition)."""

import numpy as np
import pytest
from element import Element
from scipy.optimize import brentq

import mpm

# E = 1e5 Pa, nu = 0.3: stretch -> (first Piola stress P11 [Pa], lateral stretch)
UNIAXIAL = {"hencky": {0.90: (-11706.724, 1.032113), 0.99: (-1015.185, 1.0030197), 1.01: (985.181, 0.9970194),
                       1.10: (8664.562, 0.9718119)},
            "fixed_corotated": {0.90: (-10390.234, 1.030628), 0.99: (-1003.566, 1.0030068), 1.01: (996.504, 0.9970069),
                                1.10: (9679.246, 0.9707300)},
            "neo_hookean": {0.90: (-10872.219, 1.031702), 0.99: (-1007.813, 1.0030160), 1.01: (992.365, 0.9970158),
                            1.10: (9307.743, 0.9714929)}}


@pytest.mark.parametrize("model", UNIAXIAL)
def test_uniaxial_stretch(model: str) -> None:
    material = mpm.Elastic(E=1e5, nu=0.3, density=1000.0, model=model)
    element = Element(material)
    for stretch, (piola, lateral) in UNIAXIAL[model].items():
        def lateral_stress(guess: float, stretch: float = stretch) -> float:
            element.b = np.eye(3)
            tau = element.apply(np.diag([stretch, guess, guess]))[1]
            return tau[0] if stretch < 1 else tau[-1]

        found = brentq(lateral_stress, 0.9, 1.1, xtol=1e-13)
        assert found == pytest.approx(lateral, abs=2e-6)
        element.b = np.eye(3)
        tau = element.apply(np.diag([stretch, found, found]))[1]
        axial = tau[-1] if stretch < 1 else tau[0]
        assert axial / stretch == pytest.approx(piola, rel=1e-6)


def test_clay_flows_at_its_yield_stress() -> None:
    """In uniaxial tension sigma_1 - sigma_3 stops at the yield stress, and plastic flow keeps the volume."""
    material = mpm.VonMises(E=1e6, nu=0.3, density=1500.0, yield_stress=2000.0)
    stretches, tau = Element(material).apply(np.diag([1.02, 0.995, 0.995]))
    assert tau[0] - tau[-1] == pytest.approx(2000.0, rel=1e-10)
    assert np.prod(stretches) == pytest.approx(1.02 * 0.995**2, rel=1e-12)
    below = Element(material).apply(np.diag([1.0005, 1.0, 1.0]))[1]
    assert below[0] - below[-1] == pytest.approx(2 * material.mu * np.log(1.0005), rel=1e-9)
