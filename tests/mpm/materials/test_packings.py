"""The time step of a law that stiffens with density: no packing of its particles needs a smaller one."""

import numpy as np
import pytest
from packings import CELLS, Stencils, largest_square, packings

import mpm
from mpm.materials.density import mass_around
from mpm.materials.stable_step import ACCEPTED_FRACTION, isolated_particle_bound, material_bound

CELL = 0.008


@pytest.mark.parametrize(("per_axis", "nu"), [(6, 0.2), (6, 0.3), (7, 0.2), (8, 0.2), (8, 0.3), (12, 0.0), (12, 0.2),
                                              (12, 0.3)])
def test_no_packing_vibrates_too_fast_for_the_accepted_step(per_axis: int, nu: float) -> None:
    """A mode of angular frequency w is stable up to dt = 2 / w; a lone particle as stiff as its law says has its bound
    there. per_axis: particles in six cells, 6 for one a cell."""
    law = mpm.DruckerPrager(E=1e5, nu=nu, density=1500.0, friction_angle_deg=30.0)
    lone = isolated_particle_bound(CELL, law.density, law.mu, law.lam)
    volume = (CELL * CELLS / per_axis) ** 3
    longest = ACCEPTED_FRACTION * material_bound(CELL, law, volume=volume) / lone
    assert longest > ACCEPTED_FRACTION
    for name, places in packings(per_axis).items():
        assert largest_square(places, (per_axis / CELLS) ** 3, nu) * longest**2 < 0.85, name


def test_a_lone_particle_as_stiff_as_its_law_needs_the_bound_of_one() -> None:
    """The frequencies are in units in which its own is one, and it is soft where it is alone."""
    lone = np.array([[3.1, 3.2, 3.3]])
    assert largest_square(lone, Stencils(lone).around()[0], 0.2) == pytest.approx(1.0)
    assert largest_square(lone, 2.0, 0.2) == pytest.approx(0.3)


def test_density_is_noted_as_it_is_first_estimated() -> None:
    """At rest, without weight: a box of sand away from walls, and a grain that lies apart."""
    sand = mpm.DruckerPrager(E=1e5, nu=0.2, density=1500.0, friction_angle_deg=30.0)
    box = mpm.sample_box((0.02, 0.02, 0.02), (0.06, 0.06, 0.06), 0.004, np.random.default_rng(0))
    x = np.concatenate([box, [[0.09, 0.09, 0.09]]])
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.1, 0.1, 0.1), CELL), gravity=(0, 0, 0), sleep=False,
                        bodies=[mpm.Body(sand, x, volume=0.004**3)])
    first = solver.state()["around"][:, 0]
    assert first == pytest.approx(mass_around(x / CELL, np.full(len(x), 1500.0 * 0.004**3)), rel=1e-5)
    filled = first / (1500.0 * CELL**3)
    assert 0.95 < filled.max() < 1.1 and filled[-1] < 0.03
    solver.advance(4 * solver.dt)
    assert solver.state()["around"][:, 0] == pytest.approx(first, rel=1e-4)
