"""Height maps: a flat bed has its own height, a slope its slope, and nothing is drawn outside the raster."""

import numpy as np
import pytest

from mpm.errors import InvalidValue
from mpm.observers.height_map import HeightMap, Raster

SPACING = 0.005


def lattice(counts: tuple[int, int, int]) -> np.ndarray:
    places = np.stack(np.meshgrid(*[SPACING * (np.arange(n) + 0.5) for n in counts], indexing="ij"), -1)
    return places.reshape(-1, 3).astype(np.float32)


def test_flat_bed_has_its_own_mean_height():
    raster = Raster((4 * SPACING, 4 * SPACING), (16 * SPACING, 16 * SPACING), (96, 96))
    heights = HeightMap(raster, SPACING).draw(lattice((20, 20, 4)), np.zeros((96, 96), np.float32))
    assert heights.mean() == pytest.approx(4 * SPACING, rel=1e-3) and np.ptp(heights) < 0.4 * SPACING


def test_slope_is_seen_along_the_axis_that_it_has():
    grains = lattice((40, 40, 1))
    grains[:, 2] += 0.5 * grains[:, 0]
    raster = Raster((0.0, 0.0), (40 * SPACING, 40 * SPACING), (40, 40))
    heights = HeightMap(raster, SPACING).draw(grains, np.zeros((40, 40), np.float32))[5:-5, 5:-5]
    along_x, along_y = (np.polyfit(SPACING * np.arange(30), heights.mean(axis), 1)[0] for axis in (1, 0))
    assert along_x == pytest.approx(0.5, rel=0.02) and abs(along_y) < 0.01


def test_floor_shows_where_no_particle_is_and_is_never_dug_into():
    floor = np.full((8, 8), 0.1, np.float32)
    raster = Raster((0.0, 0.0), (0.08, 0.08), (8, 8))
    grains = np.array([[0.045, 0.045, 0.2], [0.015, 0.015, 0.0], [5.0, 5.0, 1.0], [-1.0, 0.04, 1.0]], np.float32)
    heights = HeightMap(raster, SPACING).draw(grains, floor)
    assert heights[4, 4] == pytest.approx(0.2 + SPACING * (0.75**0.5 - 0.2607), abs=1e-6)
    heights[4, 4] = 0.1
    np.testing.assert_array_equal(heights, floor)


@pytest.mark.parametrize("raster", [Raster((0, 0), (1, 1), (0, 4)), Raster((1, 0), (0, 1), (4, 4))])
def test_raster_without_pixels_or_area_is_refused(raster: Raster):
    with pytest.raises(InvalidValue, match="lower below upper"):
        HeightMap(raster, SPACING)
