"""Reading of measurements: what is accepted, and every message for what is not."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from PIL import Image

pytest.importorskip("sklearn")

from robosim.base.errors import ConfigError
from robosim.studies.calibration.data import MARGIN, MAX_HOLES, RINGS, Rings, make_rings, read_curve, read_heap
from robosim.studies.calibration.experiment import Trial
from robosim.studies.calibration.measurements import HeapExperiment, PourExperiment, load_measurements
from robosim.studies.calibration.verdict import residual

PIXEL, RADIUS, HEIGHT, BASE = 0.002, 0.04, 0.05, 0.1  # BASE: radius of the cone into which the column is poured [m]
PEAK = 3 * RADIUS**2 * HEIGHT / BASE**2  # its height, of the same volume [m]


def cone_map(shift: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    """Heights [m] of a cone with the column's volume on a map of 121 x 131 pixels."""
    rows, columns = np.indices((121, 131))
    distances = np.hypot(rows - 60 - shift[0], columns - 65 - shift[1]) * PIXEL
    return np.maximum(PEAK * (1 - distances / BASE), 0.0)


def make_heap(path: Path, **more: Any) -> HeapExperiment:
    return HeapExperiment.model_validate({"kind": "heap", "data": str(path), "unit": "mm", "scale": PIXEL,
                                          "noise": 0.002, "radius": RADIUS, "height": HEIGHT, **more})


def save_map(folder: Path, heights_m: np.ndarray) -> Path:
    np.save(folder / "heap.npy", 1e3 * heights_m)
    return folder / "heap.npy"


def rings_of(heap: HeapExperiment) -> Rings:
    return make_rings("lab", heap, read_heap("lab", heap))


def test_a_map_becomes_rings_about_the_heap_s_centroid(tmp_path: Path) -> None:
    """Of a cone every ring has the height at its mean distance; its place in the map does not matter."""
    rings = rings_of(make_heap(save_map(tmp_path, cone_map((7.0, -4.0)))))
    inner = rings.radii < 0.9 * BASE
    assert inner.sum() >= 6 and rings.heights[inner] == pytest.approx(PEAK * (1 - rings.radii[inner] / BASE), abs=2e-4)
    assert rings.mean(rings.distances) == pytest.approx(rings.radii)


def test_an_empty_margin_of_a_map_does_not_change_the_verdict(tmp_path: Path) -> None:
    """A misfit of the heap has the same probability, whatever the floor about it that the map shows."""
    probabilities, heights = [], cone_map() + np.random.default_rng(0).normal(0.0, 0.002, (121, 131))
    floor = np.random.default_rng(1).normal(0.0, 0.002, (421, 431))
    floor[150:271, 150:281] = heights
    for k, shown in enumerate((heights, floor)):
        (tmp_path / str(k)).mkdir()
        axis = [n / 2 for n in shown.shape]
        heap = make_heap(save_map(tmp_path / str(k), shown), centre=[axis[0] - 0.5, axis[1] - 0.5])
        rings = rings_of(heap)
        errors = np.sqrt(heap.noise**2 / rings.counts + 0.001**2)
        trial = Trial("lab", "heap", rings.heights, errors, lambda numbers, seed: np.empty(0), False, False,
                      rings.radii, "r", "m")
        misfit = np.where(rings.radii < BASE, 0.002 * (-1.0) ** np.arange(len(rings.radii)), 0.0)
        probabilities.append(residual(trial, rings.heights + misfit).probability)
        assert len(rings.radii) <= np.ceil(BASE / (RADIUS / RINGS)) + MARGIN
    assert probabilities[1] == pytest.approx(probabilities[0], rel=1e-6) and probabilities[0] < 0.01


def test_a_picture_has_the_heights_of_the_map(tmp_path: Path) -> None:
    levels = np.round(cone_map() / 1e-5).astype(np.uint16)  # 10 um a level
    Image.fromarray(levels).save(tmp_path / "heap.png")
    picture = rings_of(make_heap(tmp_path / "heap.png", height_per_level=0.01))
    assert picture.heights == pytest.approx(rings_of(make_heap(save_map(tmp_path, cone_map()))).heights, abs=1e-5)


def test_a_profile_has_the_heights_of_the_map(tmp_path: Path) -> None:
    r = np.arange(-120.0, 121.0, 2.0)  # mm
    lines = [f"{x:g},{1e3 * max(PEAK * (1 - abs(x) * 1e-3 / BASE), 0.0):.4f}" for x in r]
    lines[3] = f"{r[3]:g},"  # a hole
    (tmp_path / "profile.csv").write_text("\n".join(["r,z", *lines]))
    rings = rings_of(make_heap(tmp_path / "profile.csv", scale=None))
    inner = rings.radii < 0.9 * BASE
    assert rings.heights[inner] == pytest.approx(PEAK * (1 - rings.radii[inner] / BASE), abs=1e-6)


def test_holes_are_tolerated_up_to_a_share_and_change_little(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    whole, holed = cone_map(), cone_map()
    holed[rng.random(holed.shape) < 0.9 * MAX_HOLES] = np.nan
    whole, holed = (rings_of(make_heap(save_map(tmp_path, heights))) for heights in (whole, holed))
    assert holed.heights == pytest.approx(whole.heights, abs=1e-3) and holed.counts.sum() < 0.9 * whole.counts.sum()


BAD_MAPS: dict[str, tuple[np.ndarray, dict[str, Any], str]] = {
    "no scale": (cone_map(), {"scale": None}, "key 'scale' is missing; accepted: the edge of a pixel"),
    "holes": (np.where(np.arange(131) % 3, cone_map(), np.nan), {}, "34% of the pixels have no height; accepted: up"),
    "metres as mm": (cone_map() * 1e-3, {}, "heights reach .* unit 'mm'.* is it another unit"),
    "mm as cm": (cone_map(), {"unit": "cm"}, "heights reach 0.2.* with unit 'cm'.* is it another unit"),
    "another scale": (cone_map(), {"scale": 0.004}, r"a heap of 1\d\d\d cm\^3 of a column of 251 cm\^3; .*`scale`"),
    "a part": (cone_map()[55:75, 60:80], {}, "part of the heap outside the map"),
    "flat": (np.zeros((50, 50)), {}, "accepted: a heap above the noise"),
    "one row": (cone_map()[60:61], {}, r"of shape \(1, 131\); accepted: a map of 4 x 4"),
    "outside": (cone_map(), {"centre": [500, 3]}, "centre = .* is outside the map"),
}


@pytest.mark.parametrize(("heights", "more", "message"), BAD_MAPS.values(), ids=BAD_MAPS)
def test_a_map_that_cannot_be_used_is_refused(heights: np.ndarray, more: dict, message: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=f"experiments.lab: .*{message}"):
        rings_of(make_heap(save_map(tmp_path, heights), **more))


def test_files_that_are_no_maps_are_refused(tmp_path: Path) -> None:
    Image.fromarray(np.zeros((9, 9, 3), np.uint8)).save(tmp_path / "colour.png")
    Image.fromarray(np.zeros((9, 9), np.uint8)).save(tmp_path / "grey.png")
    (tmp_path / "text.npy").write_text("no array")
    (tmp_path / "heap.tif").write_text("")
    (tmp_path / "bare.csv").write_text("x,y\n1,2\n")
    (tmp_path / "words.csv").write_text("r,z\n1,2\ntwo,3\n")
    np.save(tmp_path / "flags.npy", np.zeros((9, 9), bool))
    for name, message in {"colour.png": "a picture of mode RGB; accepted: grey levels",
                          "grey.png": "key 'height_per_level' is missing", "text.npy": "cannot be read",
                          "none.npy": "cannot be read", "heap.tif": "accepted: .npy, .png",
                          "bare.csv": "no column r among x, y", "flags.npy": "accepted: real numbers",
                          "words.csv": "line 3: r = 'two'; accepted: a number"}.items():
        with pytest.raises(ConfigError, match=re.escape(message)):
            read_heap("lab", make_heap(tmp_path / name))


@pytest.mark.parametrize("shape", ["(9, 9)", "(99999, 9999)", "(9223372036854775808, 9)", "(-9, 9)", "(True, 9)", "(9"])
def test_a_header_that_promises_something_else_is_refused(shape: str, tmp_path: Path) -> None:
    header = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}".ljust(117).encode() + b"\n"
    (tmp_path / "heap.npy").write_bytes(b"\x93NUMPY\x01\x00\x76\x00" + header)
    with pytest.raises(ConfigError, match="cannot be read"):
        read_heap("lab", make_heap(tmp_path / "heap.npy"))


def make_pour(path: Path, lines: list[str]) -> PourExperiment:
    path.write_text("\n".join(["t,m", *lines]))
    return PourExperiment.model_validate({
        "kind": "pour", "data": str(path), "unit": "g", "noise": 0.001, "length": 0.1, "depth": 0.06, "width": 0.08,
        "fill_height": 0.05, "tilt_speed": 30.0, "end_angle": 90.0})


def test_a_curve_is_read_in_kg_and_thinned(tmp_path: Path) -> None:
    pour = make_pour(tmp_path / "m.csv", [f"{0.1 * k:g},{k}" for k in range(101)])
    curve = read_curve("lab", pour)
    assert (len(curve.times), curve.times[0], curve.times[-1], curve.masses[-1]) == (16, 0.0, 10.0, 0.1)
    may_fall = make_pour(tmp_path / "m.csv", ["0,0", "1,50", "2,48", "3,60"])  # within its noise
    assert len(read_curve("lab", may_fall).masses) == 4


@pytest.mark.parametrize(("lines", "message"), [
    (["0,0", "1,50", "2,40", "3,60"], "the mass falls from 0.05 to 0.04 kg at t = 2 s, more than noise of 0.001 kg"),
    (["0,0", "2,50", "1,60", "3,60"], "t = 1 s follows 2 s; accepted: times that rise"),
    (["-1,0", "2,50", "3,60", "4,60"], "begins at t = -1 s"), (["0,0", "2,50"], "2 readings; accepted: 4 or more"),
    (["0,0", "1,", "2,1", "3,2"], "line 3: m = ''; accepted: a number")])
def test_a_curve_that_cannot_be_used_is_refused(lines: list[str], message: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=re.escape(message)):
        read_curve("lab", make_pour(tmp_path / "m.csv", lines))


CUP = {"kind": "cup", "masses": [0.121], "noise": 0.001, "volume": 1e-4}
BAD_FILES: dict[str, tuple[dict[str, Any], str]] = {
    "a number": ({"sought": {"frition_angle_deg": [20, 40]}}, "unknown number in .*sought 'frition_angle_deg'; valid"),
    "a range": ({"sought": {"density": [900, 800]}}, r"sought.density = \[900, 800\]; accepted: the least value"),
    "a wall of a fluid": ({"material": "water", "sought": {"wall_friction": [0.1, 0.9]}},
                          r"lab.yaml: sought.wall_friction: .*'water' has no wall_friction; accepted: density, "),
    "a bound": ({"sought": {"friction_angle_deg": [20, 95]}}, "friction_angle_deg: value = 95; accepted: 0 to 89"),
    "a kind": ({"experiments": {"lab": {**CUP, "kind": "cap"}}}, "experiments.lab.kind = 'cap'; accepted: heap"),
    "a key": ({"experiments": {"lab": {**CUP, "mass": 1}}}, "experiments.lab: unknown key 'mass'; valid: held"),
    "a noise": ({"experiments": {"lab": {**CUP, "noise": 0}}}, "experiments.lab: noise: "),
    "a material": ({"material": "pepper"}, "unknown material 'pepper'"),
    "all held out": ({"experiments": {"lab": {**CUP, "held_out": True}}}, "all are held out"),
    "lengths": ({"experiments": {"lab": {"kind": "shear", "normal_stress": [100, 200], "shear_stress": [80],
                                         "noise": 5.0}}}, "2 values of normal_stress, 1 of shear_stress"),
    "a wall": ({"experiments": {"lab": {"kind": "tilt", "angles": [20.0], "noise": 1.0, "depth": 0.01,
                                        "slides_on": "wall"}}}, "needs the friction of the wall"),
}


@pytest.mark.parametrize(("change", "message"), BAD_FILES.values(), ids=BAD_FILES)
def test_a_file_of_measurements_that_cannot_be_used_is_refused(change: dict, message: str, tmp_path: Path) -> None:
    table = {"description": "salt", "material": "salt", "sought": {"density": [1000, 1400]},
             "experiments": {"lab": CUP}, **change}
    path = tmp_path / "lab.yaml"
    path.write_text(yaml.safe_dump(table))
    with pytest.raises(ConfigError, match=message):
        load_measurements(path)
