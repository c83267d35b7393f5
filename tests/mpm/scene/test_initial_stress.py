"""Bodies that begin under a stress: it is there as given, and a bed under its own weight stays at rest."""

import numpy as np
import pytest
from field_parts import sand

import mpm
from mpm.materials.elasticity import NeoHookean

SAND = sand(E=1.5e5, friction_angle_deg=33.0)
WATER = mpm.NewtonianFluid(bulk_modulus=1.5e5, density=1000.0, viscosity=0.0)
CELL = 0.01
GRID = mpm.Grid((0, 0, 0), (0.1, 0.1, 0.1), CELL)
POSITIONS = mpm.sample_box((0, 0, 0), (0.1, 0.1, 0.05), CELL / 2)
VOLUME = 0.1 * 0.1 * 0.05 / len(POSITIONS)


def make(law: object, stress: np.ndarray | None, positions: np.ndarray = POSITIONS) -> mpm.Solver:
    """A bed in a box with slipping walls, in double precision."""
    return mpm.Solver(grid=GRID, bodies=[mpm.Body(law, positions, volume=VOLUME, stress=stress)], precision="f64",
                      walls=mpm.Walls.all("slip"))


def some_stresses() -> np.ndarray:
    """Compressive stresses [Pa] (n, 3, 3) with all entries, within the cone of the sand."""
    rng = np.random.default_rng(0)
    shear = rng.normal(0, 40.0, (len(POSITIONS), 3, 3))
    return 0.5 * (shear + shear.transpose(0, 2, 1)) - rng.uniform(500, 2e4, len(POSITIONS))[:, None, None] * np.eye(3)


def kirchhoff(solver: mpm.Solver) -> np.ndarray:
    """Stresses [Pa] (n, 3, 3) in the particles' initial volume."""
    return solver.stresses() * solver.volume_ratios()[:, None, None]


def test_particles_begin_under_the_stress_that_was_given() -> None:
    given = some_stresses()
    assert np.abs(kirchhoff(make(SAND, given)) - given).max() < 1e-9 * np.abs(given).max()
    pressure = np.linspace(0.0, 3e4, len(POSITIONS))[:, None, None] * -np.eye(3)
    assert np.abs(kirchhoff(make(WATER, pressure)) - pressure).max() < 1e-9 * 3e4


def test_two_bodies_keep_their_own() -> None:
    left = POSITIONS[:, 0] < 0.05
    given = some_stresses()
    solver = mpm.Solver(grid=GRID, precision="f64", bodies=[
        mpm.Body(WATER, POSITIONS[left], volume=VOLUME), mpm.Body(SAND, POSITIONS[~left], volume=VOLUME,
                                                                  stress=given[~left])])
    stresses = kirchhoff(solver)
    assert not stresses[: left.sum()].any()
    assert np.abs(stresses[left.sum():] - given[~left]).max() < 1e-9 * np.abs(given).max()


@pytest.mark.long
@pytest.mark.parametrize("law", [SAND, WATER, pytest.param(mpm.Elastic(E=1.5e5, nu=0.2, density=1500.0),
                                                           marks=pytest.mark.slow)])
def test_a_bed_under_its_own_weight_stays_at_rest(law: object) -> None:
    """It moves at less than a hundredth of the speed that it does where it begins without stress."""
    speeds = []
    for stress in (None, mpm.geostatic_stress(POSITIONS, VOLUME, law)):
        solver, fastest = make(law, stress), 0.0
        for _ in range(20):
            solver.advance(1e-3)
            fastest = max(fastest, np.abs(solver.velocities()).max())
        speeds.append(fastest)
    assert speeds[1] < 0.01 * speeds[0]


def test_weight_of_the_column_above_and_what_stands_sideways() -> None:
    heap = POSITIONS[POSITIONS[:, 2] < 0.02 + 0.3 * POSITIONS[:, 0]]
    stress = mpm.geostatic_stress(heap, VOLUME, SAND, gravity=5.0)
    column = (heap[:, 0] < 0.01) & (heap[:, 1] < 0.01)
    top = heap[column, 2].max() + 0.5 * VOLUME ** (1 / 3)
    assert np.allclose(-stress[column, 2, 2], 1500.0 * 5.0 * (top - heap[column, 2]), rtol=1e-12)
    assert np.allclose(stress[:, 0, 0], (1 - np.sin(np.radians(33.0))) * stress[:, 2, 2])
    assert np.allclose(mpm.geostatic_stress(heap, VOLUME, SAND, lateral=0.3)[:, 1, 1] * 10, 3 * mpm.geostatic_stress(
        heap, VOLUME, SAND)[:, 2, 2])


@pytest.mark.parametrize(("law", "stress", "message"), [
    (SAND, np.zeros((3, 3)), "stress"),
    (SAND, np.full((len(POSITIONS), 3, 3), np.nan), "finite"),
    (SAND, np.tile(np.triu(np.ones((3, 3))), (len(POSITIONS), 1, 1)), "symmetric"),
    (SAND, np.tile(-1e6 * np.eye(3), (len(POSITIONS), 1, 1)), "stiffer"),
    (WATER, np.tile(-3.2e4 * np.eye(3), (len(POSITIONS), 1, 1)), r"-3.2e\+04 Pa .* 30% .* down to -3.15e\+04 Pa"),
    (WATER, np.tile(np.diag([-1.0, -1.0, -2.0]), (len(POSITIONS), 1, 1)), "deviator"),
    (NeoHookean(E=1e5, nu=0.2, density=1e3), np.tile(-np.eye(3), (len(POSITIONS), 1, 1)), "NeoHookean"),
])
def test_other_stresses_are_refused_by_name(law: object, stress: np.ndarray, message: str) -> None:
    with pytest.raises(mpm.InvalidValue, match=message):
        mpm.Body(law, POSITIONS, volume=VOLUME, stress=stress)


def test_the_largest_pressure_of_a_fluid_leaves_seventy_percent_of_its_volume() -> None:
    fluid = make(WATER, np.tile(-3.15e4 * (1 - 1e-9) * np.eye(3), (len(POSITIONS), 1, 1)))
    assert fluid.volume_ratios() == pytest.approx(0.7, rel=1e-6)


@pytest.mark.parametrize(("positions", "options", "message"), [
    (np.zeros((0, 3)), {}, "positions"), (np.zeros((4, 2)), {}, "positions"),
    (np.zeros((4, 3)), {"lateral": -1.0}, "lateral"), (np.zeros((4, 3)), {"gravity": np.inf}, "gravity"),
])
def test_bad_arguments_of_the_geostatic_stress(positions: np.ndarray, options: dict, message: str) -> None:
    with pytest.raises(mpm.InvalidValue, match=message):
        mpm.geostatic_stress(positions, VOLUME, SAND, **options)
