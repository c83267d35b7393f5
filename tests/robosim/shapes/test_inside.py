"""What a vessel holds when it is level, against volumes in closed form."""

import numpy as np
import pytest
import trimesh
from own_meshes import half_sphere

from robosim.base.errors import ConfigError
from robosim.shapes import tool_shape
from robosim.shapes.inside import Inside, find_inside


def make_cup(radius: float, height: float, wall: float) -> trimesh.Trimesh:
    """Return a round cup that stands on z = 0 with its floor as thick as its wall."""
    return trimesh.creation.revolve([(0.0, 0.0), (radius + wall, 0.0), (radius + wall, height), (radius, height),
                                     (radius, wall), (0.0, wall)], sections=64)


@pytest.fixture(scope="module")
def spoon() -> tuple[trimesh.Trimesh, Inside]:
    (mesh,) = tool_shape("spoon").head
    return mesh, find_inside(mesh)


def test_the_bowl_of_the_spoon_is_a_half_ellipsoid(spoon: tuple[trimesh.Trimesh, Inside]) -> None:
    """Half axes 35, 25 and 30 mm: 2/3 pi a b c."""
    _, inside = spoon
    assert inside.volume == pytest.approx(2.0 / 3.0 * np.pi * 0.035 * 0.025 * 0.030, rel=0.03)
    assert abs(inside.level) < 1.5 * inside.spacing and np.abs(inside.centre[:2]).max() < 5e-4


def test_points_are_in_it_or_in_the_heap_above(spoon: tuple[trimesh.Trimesh, Inside]) -> None:
    _, inside = spoon
    points = np.array([[0, 0, -0.01], [0, 0, -0.05], [0, 0, 0.008], [0, 0, 0.02], [0.05, 0, -0.01], [0.034, 0, -0.02],
                       [0, 0.3, 0.0], [0.02, 0.0, 0.012]])
    assert inside.holds(points).tolist() == [True, False, False, False, False, False, False, False]
    assert inside.holds(points, heap=0.015).tolist() == [True, False, True, False, False, False, False, True]


def test_a_cup_holds_its_cavity_and_a_tilted_one_less() -> None:
    cup = make_cup(0.03, 0.05, 0.003)
    assert cup.is_watertight
    cup.fix_normals()
    assert find_inside(cup).volume == pytest.approx(np.pi * 0.03**2 * 0.047, rel=0.03)
    tilted = cup.copy()
    tilted.apply_transform(trimesh.transformations.rotation_matrix(np.radians(30.0), [1, 0, 0]))
    # a cylinder of radius r and depth h that is tilted by a: pi r^2 (h - r tan a)
    left = np.pi * 0.03**2 * (0.047 - 0.03 * np.tan(np.radians(30.0)))
    assert find_inside(tilted).volume == pytest.approx(left, rel=0.05)


@pytest.mark.parametrize("turned", [90.0, 180.0])
def test_what_runs_out_is_no_inside(turned: float) -> None:
    cup = make_cup(0.03, 0.05, 0.003)
    cup.apply_transform(trimesh.transformations.rotation_matrix(np.radians(turned), [1, 0, 0]))
    with pytest.raises(ConfigError, match="no inside found: level, it holds no water"):
        find_inside(cup, cells=50)


@pytest.mark.parametrize("wall", [0.5, 1.0])
def test_a_thin_bowl_on_a_long_handle_holds_what_it_holds(wall: float) -> None:
    """A half sphere of 28 mm, of sheet metal thinner than the cells along the 0.3 m of the ladle."""
    along = np.array([-1.0, 0.0, 1.0]) / np.sqrt(2.0)
    rod = trimesh.creation.cylinder(8, segment=[[-28.5, 0, -3], [-28.5, 0, -3] + 300.0 * along], sections=32)
    inside = find_inside([half_sphere(28.0, wall).apply_scale(1e-3), rod.apply_scale(1e-3)])
    assert inside.volume == pytest.approx(2.0 / 3.0 * np.pi * 0.028**3, rel=0.025)
    assert inside.spacing < 6e-4


def test_a_closed_hollow_is_no_inside() -> None:
    outer, inner = trimesh.creation.icosphere(3, 0.05), trimesh.creation.icosphere(3, 0.04)
    inner.invert()
    with pytest.raises(ConfigError, match="no inside found"):
        find_inside(trimesh.util.concatenate([outer, inner]), cells=50)  # pyright: ignore[reportArgumentType]
