"""Drucker-Prager return mapping against vectors computed with 50-digit arithmetic (validation section B1).
The vectors follow Klar et al. 2016, ACM TOG 35(4):103; E = 3.537e5 Pa, nu = 0.3."""

import numpy as np
import pytest
from element import Element
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

import mpm


def rotation(axis: list[float], angle: float) -> np.ndarray:
    return Rotation.from_rotvec(np.array(axis) / np.linalg.norm(axis) * angle).as_matrix()


F_B = rotation([1, 2, 3], 0.7) @ np.diag([1.06, 0.97, 0.93]) @ rotation([0, 1, 1], -1.1).T
VECTORS = {
    "A": (30, [[0.99, 0.08, 0], [0, 0.985, 0.01], [0.005, 0, 1]],
          [1.0085764158389063, 0.9950670406256893, 0.9716549254930555], [-2810.569983, -6479.531073, -12957.515529]),
    "B": (30, F_B, [1.0221358041351838, 0.9775200327763318, 0.9570316055093315],
          [-3176.873661, -15319.899951, -21083.133737]),
    "C": (20, np.diag([1, 1, 0.9]), [0.99427076968015037, 0.99427076968015037, 0.91040192147800686],
          [-23062.897509, -23062.897509, -47039.240953]),
    "D": (45, [[1, 0.2, 0], [0, 0.97, 0], [0, 0, 1]],
          [1.0235012557943168, 0.9933484499414169, 0.9540732863994636], [104.735322, -8031.214451, -19007.075089]),
    "E": (30, 0.9 * np.eye(3), [0.9, 0.9, 0.9], [-93165.035970] * 3),
    "F": (30, np.diag([1.2, 1, 0.8334166667]), [1, 1, 1], [0, 0, 0]),
    "G": (30, np.diag([0.2, 1, 2]), [1.3177499898842169, 0.8801934292701054, 0.3448647832876871],
          [-111903.14886, -221696.88505, -476630.04574]),
    "H": (0, [[0.99, 0.03, 0], [0, 0.99, 0], [0, 0, 0.99]], [0.99, 0.99, 0.99], [-8887.009478] * 3),
    "I": (60, [[0.95, 0.3, 0], [0, 0.95, 0], [0, 0, 0.95]],
          [1.1117692030835673, 0.95, 0.8117692030835671], [-2573.110165, -45356.095562, -88139.080959]),
}


def sand(angle: float) -> mpm.DruckerPrager:
    return mpm.DruckerPrager(E=3.537e5, nu=0.3, density=1500.0, friction_angle_deg=angle)


@pytest.mark.parametrize("name", VECTORS)
def test_exact_integrator_reproduces_the_vector(name: str) -> None:
    angle, F, stretches, stresses = VECTORS[name]
    found_stretches, found_stresses = Element(sand(angle)).apply(np.asarray(F, float))
    # vector F states its stretch product with ten digits only
    assert found_stretches == pytest.approx(stretches, abs=1e-12 if name != "F" else 1e-10)
    assert found_stresses == pytest.approx(stresses, abs=2e-6 if name != "G" else 1e-5)


@pytest.mark.parametrize("name", ["A", "B", "C", "D", "E", "F"])
def test_series_in_single_precision_is_exact_to_its_rounding(name: str) -> None:
    angle, F, stretches, _ = VECTORS[name]
    found, _ = Element(sand(angle), "f32", "series").apply(np.asarray(F, float))
    assert found == pytest.approx(stretches, rel=2e-6)


def test_volume_correction_takes_expansion_back() -> None:
    element = Element(sand(30))
    element.apply(np.diag([1.02, 1.01, 0.995]))
    assert element.vc == pytest.approx(0.024740416325804, abs=1e-14)
    stretches, _ = element.apply(0.99 * np.eye(3))
    assert np.prod(stretches) == pytest.approx(0.9946040196510, abs=1e-12)
    assert element.vc == pytest.approx(0.0, abs=1e-14)


def test_plane_strain_cone_yields_at_mohr_coulomb() -> None:
    """In plane strain without dilation the cone's shear ratio is sin(phi) (validation section B3)."""
    material = mpm.DruckerPrager(E=1e5, nu=0.3, density=1500.0, friction_angle_deg=30.0, cone="plane_strain")
    assert 3.0 * material.alpha / np.sqrt(2.0) == pytest.approx(np.sin(np.radians(30.0)), rel=1e-14)


def test_cohesion_carries_tension_up_to_its_cap() -> None:
    material = mpm.DruckerPrager(E=1e5, nu=0.2, density=500.0, friction_angle_deg=30.0, cohesion=100.0)
    _, stresses = Element(material).apply(1.05 * np.eye(3))
    assert stresses == pytest.approx([100.0 / np.tan(np.radians(30.0))] * 3, rel=1e-10)


@pytest.mark.parametrize("angle", [20.0, 30.0, 40.0])
def test_simple_shear_under_constant_pressure_ends_on_the_cone(angle: float) -> None:
    """tau / sigma_n -> 3 alpha / sqrt(2) once the shear passes 0.08, with isotropic normal stresses (validation B2)."""
    material = sand(angle)
    element = Element(material)
    step, normal = 2e-3, -1000.0

    def sheared(stretch: float, b: np.ndarray, vc: float) -> np.ndarray:
        element.b, element.vc = b, vc
        element.apply(np.array([[1.0, step, 0.0], [0.0, stretch, 0.0], [0.0, 0.0, 1.0]]))
        return element.tau / np.sqrt(np.linalg.det(element.b))

    # isotropic start at the normal stress: bulk modulus (3 lam + 2 mu) / 3
    bulk = material.lam + 2.0 / 3.0 * material.mu
    b, vc = np.exp(2.0 / 3.0 * normal / bulk) * np.eye(3), 0.0
    for _ in range(60):
        stretch = brentq(lambda s, b=b, vc=vc: sheared(s, b, vc)[1, 1] - normal, 0.99, 1.01, xtol=1e-12)
        sigma = sheared(stretch, b, vc)
        b, vc = element.b, element.vc
    assert sigma[0, 1] / -normal == pytest.approx(3.0 * material.alpha / np.sqrt(2.0), rel=0.01)
    assert np.diag(sigma) == pytest.approx([normal] * 3, rel=0.015)
