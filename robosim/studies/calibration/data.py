"""Files of measurements: height maps, profiles and curves of mass, with what makes them unusable.
A heap is compared ring by ring about the column's axis; a ring's height is the mean of its readings. A map whose rings
hold another volume than the column had is of another unit or scale, and is refused."""

import math
from pathlib import Path
from tokenize import TokenError
from typing import NamedTuple

import numpy as np
from numpy.lib.format import open_memmap

from mpm.array_files import BROKEN, MAX_ARRAYS, MAX_HEADER
from robosim.base.errors import ConfigError
from robosim.base.input_files import read_bytes, read_rows, to_numbers
from robosim.studies.calibration.measurements import HeapExperiment, PourExperiment

METRES = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
KILOGRAMS = {"kg": 1.0, "g": 1e-3}
MAX_HOLES, MAX_PIXELS = 0.2, 4_000_000
"""Largest share of pixels without a height: a fifth fewer readings widen the errors of rings by a tenth; and pixels."""
VOLUMES = (0.6, 1.5)
"""Least and largest volume of a heap over that of its column. Powders loosen or pack by some 20 % when they are let go;
a heap in cm instead of mm has ten times, or a tenth of, the volume."""
RINGS = 3.0
"""Rings on the column's radius: of a map of a column of 40 mm with pixels of 2 mm, the innermost has 35."""
MARGIN = 2
"""Rings of floor that are compared beyond a heap's edge: a simulated heap may reach farther."""
FALL = 4.0
"""Standard deviations of the noise by which a mass that was poured may be less than an earlier one, and a ring of bare
floor above 0."""
CURVE_POINTS = 16
"""Readings of a curve of masses that are compared; more of one pour are not independent of each other."""


HeapData = tuple[np.ndarray, np.ndarray]
"""Readings of a heap: distances from its axis [m] (n,), and heights [m] (n,)."""


class Rings(NamedTuple):
    """A heap by rings."""

    index: np.ndarray
    """(n,) ring of each reading that is used"""
    distances: np.ndarray
    """(n,) [m] of these readings from the axis"""
    radii: np.ndarray
    """(k,) mean distance of a ring's readings [m]"""
    heights: np.ndarray
    """(k,) mean height [m]"""
    counts: np.ndarray
    """(k,) readings"""

    def mean(self, values: np.ndarray) -> np.ndarray:
        """Return the mean (k,) over each ring of values (n,) at the readings."""
        return np.bincount(self.index, values, len(self.counts)) / self.counts


def sort_rings(distances: np.ndarray, heights: np.ndarray, width: float, last: int | None = None) -> Rings:
    """Return the rings of a width [m] that hold readings at distances [m] (n,) with heights [m] (n,); last: most."""
    index = np.minimum(distances / width, MAX_PIXELS).astype(int)
    if last is not None:
        used = index < last
        index, distances, heights = index[used], distances[used], heights[used]
    counts = np.bincount(index)
    with np.errstate(invalid="ignore"):  # empty rings
        radii, means = (np.bincount(index, values) / counts for values in (distances, heights))
    return Rings(index, distances, radii, means, counts)


class Curve(NamedTuple):
    """Masses [kg] (n,) at times [s] (n,)."""

    times: np.ndarray
    masses: np.ndarray


def read_heap(name: str, heap: HeapExperiment) -> HeapData:
    """Read a heap's file; raises ConfigError with the experiment, what is wrong and what is accepted."""
    path, place = Path(heap.data), f"experiments.{name}: {heap.data}"
    suffix = path.suffix.lower()
    if suffix == ".csv":
        data = _read_profile(place, path, heap)
    elif suffix in (".npy", ".png"):
        data = _read_map(place, path, heap)
    else:
        raise ConfigError(f"{place}: ends in {suffix!r}; accepted: .npy, .png (height maps) or .csv (a profile)")
    if len(data[1]) < 8:
        raise ConfigError(f"{place}: {len(data[1])} heights; accepted: 8 or more")
    return data


def make_rings(name: str, heap: HeapExperiment, data: HeapData) -> Rings:
    """Sort a heap's readings into rings; raises ConfigError for a heap of another volume than its column."""
    width = heap.radius / RINGS
    every = sort_rings(*data, width)
    last = int(np.argmax(np.append(every.counts, 0) == 0))  # beyond a gap nothing is compared
    if last < RINGS:
        raise ConfigError(f"experiments.{name}: {heap.data}: no heights {last * width * 1e3:.0f} mm from the axis; "
                          f"accepted: readings from the axis outwards, at least every {width * 1e3:.1f} mm")
    edge = find_edge(name, heap, every.heights[:last], every.counts[:last])
    rings = sort_rings(*data, width, min(last, edge + MARGIN))
    edges = width * np.arange(len(rings.counts) + 1)
    volume = float((rings.heights * math.pi * (edges[1:] ** 2 - edges[:-1] ** 2)).sum())
    column, (least, most) = math.pi * heap.radius**2 * heap.height, VOLUMES
    if not least * column <= volume <= most * column:
        raise ConfigError(f"experiments.{name}: {heap.data}: a heap of {volume * 1e6:.0f} cm^3 of a column of "
                          f"{column * 1e6:.0f} cm^3; accepted: {least:g} to {most:g} of it; is `scale` or `unit` "
                          f"another one, or part of the heap outside the map?")
    return rings


def find_edge(name: str, heap: HeapExperiment, heights: np.ndarray, counts: np.ndarray) -> int:
    """Return the number of rings up to the last one above the floor.
    Rings of bare floor agree with any numbers: the more of them a map has, the less a misfit of the heap would count.
    heights: (k,) means of rings [m]; counts: (k,) their readings. Raises ConfigError where no ring is above the floor.
    """
    floor = np.maximum(0.02 * heights.max(), FALL * heap.noise / np.sqrt(counts))
    raised = np.flatnonzero(heights > floor)
    if not len(raised):
        raise ConfigError(f"experiments.{name}: {heap.data}: no ring about the axis is higher than {FALL:g} standard "
                          f"deviations of the noise of {heap.noise:g} m; accepted: a heap above the noise")
    return int(raised[-1]) + 1


def read_curve(name: str, pour: PourExperiment) -> Curve:
    """Read masses over time; raises ConfigError for times that do not rise and for masses that fall."""
    path, place = Path(pour.data), f"experiments.{name}: {pour.data}"
    times, masses = _read_columns(place, path, ("t", "m"))
    masses = masses * KILOGRAMS[pour.unit]
    if len(times) < 4:
        raise ConfigError(f"{place}: {len(times)} readings; accepted: 4 or more")
    if not (np.diff(times) > 0).all():
        k = int(np.argmax(np.diff(times) <= 0)) + 1
        raise ConfigError(f"{place}: t = {times[k]:g} s follows {times[k - 1]:g} s; accepted: times that rise")
    highest = np.maximum.accumulate(masses)
    fallen = highest - masses
    if (fallen > FALL * math.sqrt(2.0) * pour.noise).any():
        k = int(np.argmax(fallen))
        raise ConfigError(f"{place}: the mass falls from {highest[k]:g} to {masses[k]:g} kg at t = {times[k]:g} s, "
                          f"more than noise of {pour.noise:g} kg explains; accepted: the mass that has left the box")
    if times[0] < 0:
        raise ConfigError(f"{place}: begins at t = {times[0]:g} s; accepted: times from the begin of the tilting, 0")
    if len(times) > CURVE_POINTS:
        kept = np.unique(np.linspace(0, len(times) - 1, CURVE_POINTS).round().astype(int))
        times, masses = times[kept], masses[kept]
    return Curve(times, masses)


def _read_map(place: str, path: Path, heap: HeapExperiment) -> HeapData:
    """Read a height map: rows along x, columns along y, heights above the floor; NaN and infinity are holes."""
    if heap.scale is None:
        raise ConfigError(f"{place}: key 'scale' is missing; accepted: the edge of a pixel [m], such as scale: 0.002")
    heights = _load_map(place, path, heap) * METRES[heap.unit]
    if heights.ndim != 2 or min(heights.shape) < 4 or heights.size > MAX_PIXELS:
        raise ConfigError(f"{place}: of shape {heights.shape}; accepted: a map of 4 x 4 to {MAX_PIXELS} pixels")
    valid = _check_heights(place, heap, heights, "pixels", 99.5)
    rows, columns = np.indices(heights.shape)
    raised = np.where(valid & (heights > 0.1 * np.nanmax(heights)), heights, 0.0)
    centre = heap.centre or [(raised * places).sum() / raised.sum() for places in (rows, columns)]
    if not all(0 <= c <= n - 1 for c, n in zip(centre, heights.shape)):
        raise ConfigError(f"{place}: centre = {list(centre)} is outside the map of {heights.shape} pixels")
    distances = np.hypot(rows - centre[0], columns - centre[1]) * heap.scale
    return distances[valid], heights[valid]


def _load_map(place: str, path: Path, heap: HeapExperiment) -> np.ndarray:
    try:
        read_bytes(path, MAX_ARRAYS)
        if path.suffix.lower() == ".npy":
            stored = open_memmap(path, "r", max_header_size=MAX_HEADER)  # refuses a header that promises more
            if stored.dtype.kind not in "iuf":
                raise ValueError(f"of type {stored.dtype}; accepted: real numbers")
            return stored.astype(float)
        from PIL import Image

        with Image.open(path) as image:
            if image.mode not in ("L", "I", "I;16", "I;16B", "F"):
                raise ValueError(f"a picture of mode {image.mode}; accepted: grey levels of 8 or 16 bits")
            levels = np.array(image, float)
    except (*BROKEN, SyntaxError, TokenError) as error:
        raise ConfigError(f"{place}: cannot be read: {error}") from None
    if heap.height_per_level is None:
        raise ConfigError(f"{place}: key 'height_per_level' is missing; accepted: the height of a grey level "
                          f"[{heap.unit}]")
    return levels * heap.height_per_level


def _read_profile(place: str, path: Path, heap: HeapExperiment) -> HeapData:
    """Read a profile through the axis: columns r and z; points without a height are holes."""
    places, heights = METRES[heap.unit] * _read_columns(place, path, ("r", "z"), may_miss="z")
    origin = heap.centre[0] if heap.centre is not None else 0.0
    distances = np.abs(places - origin * METRES[heap.unit])
    valid = _check_heights(place, heap, heights, "points", 100.0)
    return distances[valid], heights[valid]


def _read_columns(place: str, path: Path, names: tuple[str, str], may_miss: str = "") -> np.ndarray:
    """Return the named columns (2, n) of a .csv file; a cell of `may_miss` may be empty, and is NaN then."""
    columns = to_numbers(read_rows(path, MAX_ARRAYS, place), names, place, may_miss).T
    for name, values in zip(names, columns):
        if name != may_miss and not np.isfinite(values).all():
            raise ConfigError(f"{place}: {name} of reading {int(np.argmin(np.isfinite(values))) + 1} is not finite; "
                              f"accepted: a number")
    if not columns.size:
        raise ConfigError(f"{place}: has no line of numbers")
    return columns


def _check_heights(place: str, heap: HeapExperiment, heights: np.ndarray, what: str, percentile: float) -> np.ndarray:
    """Return which heights [m] are no holes; what: they are of, for messages.
    Refuses too many holes, and heights, by a percentile, that no heap of this column has: above the column, or not
    above the noise."""
    valid = np.isfinite(heights)
    if 1.0 - valid.mean() > MAX_HOLES:
        raise ConfigError(f"{place}: {1 - valid.mean():.0%} of the {what} have no height; accepted: up to "
                          f"{MAX_HOLES:.0%}")
    top = float(np.percentile(heights[valid], percentile))
    if top > heap.height + 5 * heap.noise:
        raise ConfigError(f"{place}: heights reach {top:g} m with unit {heap.unit!r}, and the column was "
                          f"{heap.height:g} m high; accepted: heights up to that; is it another unit?")
    if top < max(0.02 * heap.height, heap.noise):
        raise ConfigError(f"{place}: heights reach {top:g} m with unit {heap.unit!r}, and the column was "
                          f"{heap.height:g} m high with noise of {heap.noise:g} m; accepted: a heap above the noise; "
                          f"is it another unit?")
    return valid
