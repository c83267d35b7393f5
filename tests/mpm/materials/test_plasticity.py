"""Sand and clay at one material point: volume correction, the plane-strain cone, cohesion, and the yield stress.
The return mapping is held by the verification case `return_mapping`, the way to the cone by `element_path`."""

from dataclasses import replace

import numpy as np
import pytest
from element import Element
from scipy.optimize import brentq

import mpm


def test_volume_correction_takes_expansion_back() -> None:
    element = Element(mpm.DruckerPrager(E=3.537e5, nu=0.3, density=1500.0, friction_angle_deg=30.0))
    element.apply(np.diag([1.02, 1.01, 0.995]))
    assert element.vc == pytest.approx(0.024740416325804, abs=1e-14)
    stretches, _ = element.apply(0.99 * np.eye(3))
    assert np.prod(stretches) == pytest.approx(0.9946040196510, abs=1e-12)
    assert element.vc == pytest.approx(0.0, abs=1e-14)


def test_plane_strain_cone_yields_at_mohr_coulomb() -> None:
    """In plane strain without dilation the cone's shear ratio is sin(phi) (validation section B3)."""
    material = mpm.DruckerPrager(E=1e5, nu=0.3, density=1500.0, friction_angle_deg=30.0, cone="plane_strain")
    assert 3.0 * material.alpha / np.sqrt(2.0) == pytest.approx(np.sin(np.radians(30.0)), rel=1e-14)


@pytest.mark.parametrize("limit", [0.0, 50.0, 100.0 / np.tan(np.radians(30.0))])
def test_cohesion_carries_tension_up_to_its_limit(limit: float) -> None:
    material = mpm.DruckerPrager(E=1e5, nu=0.2, density=500.0, friction_angle_deg=30.0, cohesion=100.0,
                                 tensile_strength=limit)
    _, stresses = Element(material).apply(1.05 * np.eye(3))
    assert stresses == pytest.approx([limit] * 3, rel=1e-10, abs=1e-10)
    with pytest.raises(mpm.InvalidValue, match=r"tensile_strength \[Pa\] = 200; accepted: 0 to 173.2"):
        replace(material, tensile_strength=200.0)


@pytest.mark.parametrize(("cone", "intercept"), [("compression", 1.2), ("plane_strain", np.cos(np.radians(30.0)))])
def test_the_intercept_of_cohesion_is_what_the_cone_makes_of_it(cone: str, intercept: float) -> None:
    """In simple shear under a constant normal stress, which ends with equal normal stresses."""
    material = mpm.DruckerPrager(E=3.537e5, nu=0.3, density=1500.0, friction_angle_deg=30.0, cohesion=100.0, cone=cone)
    element, normal = Element(material), -1000.0

    def sheared(stretch: float, b: np.ndarray, vc: float) -> np.ndarray:
        element.b, element.vc = b, vc
        element.apply(np.array([[1.0, 2e-3, 0.0], [0.0, stretch, 0.0], [0.0, 0.0, 1.0]]))
        return element.tau / np.sqrt(np.linalg.det(element.b))

    b, vc = np.exp(2.0 * normal / (3.0 * material.lam + 2.0 * material.mu)) * np.eye(3), 0.0
    for _ in range(60):
        stretch = brentq(lambda s, b=b, vc=vc: sheared(s, b, vc)[1, 1] - normal, 0.99, 1.01, xtol=1e-12)
        sigma = sheared(stretch, b, vc)
        b, vc = element.b, element.vc
    assert sigma[0, 1] == pytest.approx(3.0 * material.alpha / np.sqrt(2.0) * -normal + intercept * 100.0, rel=0.01)


def test_clay_flows_at_its_yield_stress() -> None:
    """In uniaxial tension sigma_1 - sigma_3 stops at the yield stress, and plastic flow keeps the volume."""
    material = mpm.VonMises(E=1e6, nu=0.3, density=1500.0, yield_stress=2000.0)
    stretches, tau = Element(material).apply(np.diag([1.02, 0.995, 0.995]))
    assert tau[0] - tau[-1] == pytest.approx(2000.0, rel=1e-10)
    assert np.prod(stretches) == pytest.approx(1.02 * 0.995**2, rel=1e-12)
    below = Element(material).apply(np.diag([1.0005, 1.0, 1.0]))[1]
    assert below[0] - below[-1] == pytest.approx(2 * material.mu * np.log(1.0005), rel=1e-9)
