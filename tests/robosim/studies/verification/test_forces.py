"""Forces of sand: the references of the cases against independent forms of them."""

import math
from pathlib import Path

import numpy as np
import pytest

import mpm
from robosim.base.errors import ConfigError, UnknownName
from robosim.base.resources import folder
from robosim.studies.verification.cases import references
from robosim.studies.verification.cases.case import Comparison
from robosim.studies.verification.cases.dense_sand import DenseSand, shear_ratio
from robosim.studies.verification.cases.expectations import Within
from robosim.studies.verification.cases.forces import dropped_sphere, plates, resistive_force
from robosim.studies.verification.cases.forces.plate_bed import make_sand
from robosim.studies.verification.cases.forces.resistive_force import plane_alpha, space_alpha
from robosim.studies.verification.cases.forces.walls import coulomb_passive, janssen, rankine
from robosim.studies.verification.cases.references import read_reference
from robosim.studies.verification.report_page import draw_comparison


@pytest.mark.parametrize(("beta", "gamma", "z", "x"), [
    (0, 90, 1.000, 0.0), (90, 0, 0.037, 0.370), (0, -90, -0.250, 0.0), (45, 45, 0.570, 0.360), (30, 0, 0.426, 0.271),
    (60, 45, 0.376, 0.377), (-30, 0, 0.155, 0.118), (-30, 45, 0.542, -0.019)])
def test_plane_theory_has_the_published_values(beta: float, gamma: float, z: float, x: float) -> None:
    """Values of the series in two public codes (validation B9)."""
    assert plane_alpha(beta, gamma) == pytest.approx((x, z), abs=1.1e-3)


@pytest.mark.parametrize("medium", ["generic", "loose poppy seeds", "close poppy seeds"])
def test_vertical_motion_has_the_mirror_symmetry(medium: str) -> None:
    """A plate that leans the other way is pushed the other way; with a sine in place of the cosine of C-11, as in a
    public code, a level plate would be pushed sideways."""
    for gamma in (90.0, -90.0):
        for beta in (0.0, 20.0, 65.0, 90.0):
            one, other = plane_alpha(beta, gamma, medium), plane_alpha(-beta, gamma, medium)
            assert one.z == pytest.approx(other.z, abs=1e-12) and one.x == pytest.approx(-other.x, abs=1e-12)


def test_tables_in_the_plane_agree_but_for_their_scale() -> None:
    """The packings of poppy seeds differ from the generic table by less than the uncertainty that is stated."""
    def scaled(medium: str) -> np.ndarray:
        return np.array([plane_alpha(b, g, medium) for b, g in plates.DIRECTIONS["map"]]) \
            / plane_alpha(0, 90, medium).z

    reference = read_reference("resistive_force_2d")
    for medium in ("loose poppy seeds", "close poppy seeds"):
        assert np.sqrt(np.mean((scaled(medium) - scaled("generic")) ** 2)) < 0.06 < reference["uncertainty"]
        scale = 1e6 * plane_alpha(0, 90, medium).z / (9.81 * reference["bulk_density"][medium])
        least, most = next((float(one.low or 0.0), one.high) for one in plates.plate_map.expectations
                           if isinstance(one, Within) and one.name == "scale")
        assert least - 0.1 < scale < most


@pytest.mark.parametrize(("angles", "r", "z"), [((0, 90), 0.0, 0.875), ((45, 45), -0.342, 0.583),
                                                ((90, 0), -0.192, 0.075), ((60, 30), -0.336, 0.350)])
def test_theory_in_space_has_the_published_values(angles: tuple, r: float, z: float) -> None:
    assert space_alpha(*angles) == pytest.approx((r, 0.0, z), abs=1e-3)


def test_doubtful_coefficients_would_drive_the_plate() -> None:
    """Sand cannot push a plate along its own motion; with the third code's two coefficients it does so often."""
    angles = np.arange(-90.0, 91.0, 15.0)
    shares = []
    for doubtful in (False, True):
        power = [a[0] * math.cos(math.radians(g)) - a[2] * math.sin(math.radians(g)) for b in angles for g in angles
                 for p in (0.0, 45.0, 90.0) for a in [space_alpha(b, g, p, doubtful)]]
        shares.append(np.mean(np.array(power) > 1e-9))
    assert shares[0] < 0.03 and shares[1] > 2 * shares[0], shares
    assert space_alpha(0, 90, doubtful=True)[2] == pytest.approx(1.056, abs=1e-3)


@pytest.mark.parametrize(("mu", "scale"), [(0.3, 16.1), (0.4, 31.1), (0.5, 59.8), (0.7, 179.8)])
def test_scale_of_the_theory_in_space(mu: float, scale: float) -> None:
    assert resistive_force.space_scale(mu) == pytest.approx(scale, abs=0.06)


def test_a_wrong_file_of_references_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    target = tmp_path / "references" / "impact.yaml"
    target.parent.mkdir()
    target.write_text((folder("configs") / "references" / "impact.yaml").read_text().replace("prefactor: 0.14",
                                                                                            "prefactor: much"))
    monkeypatch.setattr(references, "folder", lambda name: tmp_path)
    with pytest.raises(ConfigError, match=r"impact\.yaml.*prefactor.*accepted"):
        read_reference.__wrapped__("impact")


def test_earth_pressure_is_that_of_the_worst_wedge() -> None:
    """Coulomb's coefficient is the least force of all plane wedges; on a smooth wall it is Rankine's."""
    assert (rankine(30.0, False), rankine(30.0, True)) == pytest.approx((1 / 3, 3.0))
    slopes = np.radians(np.linspace(5.0, 60.0, 20001))
    for phi_deg, wall_deg, expected in ((20, 0, 2.0396), (25, 12.5, 3.5524), (30, 15, 4.9765), (35, 17.5, 7.3567)):
        phi, wall = math.radians(phi_deg), math.radians(wall_deg)
        lever = np.cos(slopes + phi + wall)
        wedges = np.sin(slopes + phi) / np.tan(slopes) / np.where(lever > 0, lever, np.nan)
        assert coulomb_passive(phi_deg, wall_deg) == pytest.approx(np.nanmin(wedges), rel=1e-4)
        assert coulomb_passive(phi_deg, wall_deg) == pytest.approx(expected, abs=1e-4)
    assert coulomb_passive(30.0, 0.0) == pytest.approx(rankine(30.0, True))


def test_janssen_balances_every_layer() -> None:
    """d sigma / dz = rho g - 2 mu K sigma / W, by differences; without friction it is the weight."""
    z, h = np.linspace(0.01, 0.5, 50), 1e-5
    slope = (janssen(z + h, 0.1, 0.3, 0.5) - janssen(z - h, 0.1, 0.3, 0.5)) / (2 * h)
    balance = 1500.0 * 9.81 - 2 * 0.3 * 0.5 / 0.1 * janssen(z, 0.1, 0.3, 0.5)
    assert slope == pytest.approx(balance, rel=1e-6)
    assert janssen(0.2, 0.1, 1e-9, 0.5) == pytest.approx(1500.0 * 9.81 * 0.2, rel=1e-6)


def test_lifted_block_weighs_its_volume() -> None:
    """Layers of the block whose sides lean outward: a strip of width 1 + 2 s, a square with rounded corners."""
    lean = math.tan(math.asin(math.tan(math.radians(30.0))))
    for depth in (0.5, 2.0, 4.0):
        offset = lean * (np.arange(20000) + 0.5) / 20000 * depth
        for square, area in ((False, 1 + 2 * offset), (True, 1 + 4 * offset + math.pi * offset**2)):
            found = plates.lifting_bound(np.array([depth]), 30.0, square)
            assert found == pytest.approx([area.mean()], rel=1e-6), (depth, square)


def test_laws_of_plates_carry_the_same_friction() -> None:
    """In simple shear, dense sand in its critical state; there is no dense sand with cohesion."""
    for degrees in (25.0, 30.0):
        ratio = math.tan(math.radians(degrees))
        dense, loose = make_sand(degrees, law="dense"), make_sand(degrees, cohesion=50.0)
        assert isinstance(dense, DenseSand) and isinstance(loose, mpm.DruckerPrager)
        assert shear_ratio(dense.friction_angle_deg) == pytest.approx(ratio)
        assert 3.0 / math.sqrt(2.0) * loose.alpha == pytest.approx(ratio)
        assert (dense.dilation > 0.1, loose.cohesion) == (True, 50.0)
    with pytest.raises(UnknownName, match="drucker_prager"):
        make_sand(law="clay")
    with pytest.raises(mpm.InvalidValue, match=r"50 Pa.*accepted: 0"):
        make_sand(law="dense", cohesion=50.0)


def test_depth_of_impact_follows_its_law() -> None:
    """Steel of 25.4 mm dropped by 0.1 m stops at 31.4 mm."""
    ratio, mu = 7860.0 / 1520.0, math.tan(math.radians(24.0))
    depth = dropped_sphere.predict(0.1, ratio, mu)
    assert depth == pytest.approx(0.0314, abs=3e-4)
    assert depth == pytest.approx(0.14 / mu * math.sqrt(ratio) * 0.0254 ** (2 / 3) * (0.1 + depth) ** (1 / 3), rel=1e-9)


def test_a_comparison_shows_runs_and_reference() -> None:
    """Points that are not finite are left out; the reference's line has its uncertainty on either side."""
    html = draw_comparison(Comparison(
        title="depth", x="law [m]", y="measured [m]", measured={"coarse": [(0.1, 0.09, "one"), (0.2, math.nan, "two")]},
        published={"table": [(0.1, 0.1, "three")]}, line=((0.0, 0.0), (1.0, 1.0)), uncertainty=0.2, is_relative=True,
        source="source"))
    assert all(word in html for word in ("coarse", "table", "its uncertainty", "one", "three")) and "two" not in html
