"""Laws at one material point against closed forms; the verification case `uniaxial` has those of the elastic ones."""

import numpy as np
import pytest
from element import Element

import mpm


def test_clay_flows_at_its_yield_stress() -> None:
    """In uniaxial tension sigma_1 - sigma_3 stops at the yield stress, and plastic flow keeps the volume."""
    material = mpm.VonMises(E=1e6, nu=0.3, density=1500.0, yield_stress=2000.0)
    stretches, tau = Element(material).apply(np.diag([1.02, 0.995, 0.995]))
    assert tau[0] - tau[-1] == pytest.approx(2000.0, rel=1e-10)
    assert np.prod(stretches) == pytest.approx(1.02 * 0.995**2, rel=1e-12)
    below = Element(material).apply(np.diag([1.0005, 1.0, 1.0]))[1]
    assert below[0] - below[-1] == pytest.approx(2 * material.mu * np.log(1.0005), rel=1e-9)
