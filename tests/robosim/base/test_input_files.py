"""Files that others wrote: what they promise is compared with what they hold before memory is taken."""

import io
import struct
import zipfile
from pathlib import Path

import numpy as np
import pytest
import yaml
from numpy.lib import format as npy

from mpm.array_files import read_arrays
from mpm.errors import InvalidValue
from mpm.files import quote
from robosim.base.errors import ConfigError, UnknownName
from robosim.base.input_files import MAX_DEPTH, MAX_TEXT, StrictComposer, check_form, read_json, read_text
from robosim.base.resources import config_path


class Loader(StrictComposer, yaml.SafeLoader):
    """As the project's readers of YAML use it."""


def header(shape: tuple[int, ...], descr: object = "<f8") -> bytes:
    """The header of a .npy file, whether true or not."""
    file = io.BytesIO()
    npy.write_array_header_1_0(file, {"descr": descr, "fortran_order": False, "shape": shape})
    return file.getvalue()


def written(path: Path, compression: int = zipfile.ZIP_STORED, **members: bytes) -> Path:
    """A .npz file of members as given."""
    with zipfile.ZipFile(path, "w", compression) as archive:
        for name, content in members.items():
            archive.writestr(f"{name}.npy", content)
    return path


def test_arrays_are_read_as_they_were_written(tmp_path: Path) -> None:
    arrays = {"a": np.arange(12.0).reshape(3, 4), "b": np.asfortranarray(np.arange(6).reshape(2, 3)),
              "c": np.array("salt"), "d": np.zeros((0, 3), np.float32), "e": np.array(True), "f": np.array(7)}
    for save in (np.savez, np.savez_compressed):
        save(tmp_path / "x.npz", **arrays)
        stored = read_arrays(tmp_path / "x.npz")
        assert stored.keys() == arrays.keys()
        for name, array in arrays.items():
            assert stored[name].dtype == array.dtype and stored[name].flags.writeable
            np.testing.assert_array_equal(stored[name], array)
    assert list(read_arrays(tmp_path / "x.npz", names=["a", "z"])) == ["a"]
    assert stored.integer("f", None, 0, 10) == 7 and stored.integer("z", 3, 0, 10) == 3
    assert stored.text("c", "") == "salt" and stored.text("z", "sand") == "sand"


@pytest.mark.parametrize(("shape", "descr"), [((2, 3 * 10**10), "<f8"), ((2, -3), "<f8"), ((10**12,), "<U0"),
                                              ((3,), "|O"), ((2,) * 9, "<f8"), ((2,), [("x", "<f8")])])
def test_headers_that_do_not_fit_are_refused(tmp_path: Path, shape: tuple[int, ...], descr: object) -> None:
    """480 GB are promised by the first; nothing is allocated for it."""
    path = written(tmp_path / "x.npz", actions=header(shape, descr) + bytes(48))
    with pytest.raises(InvalidValue, match="x.npz: cannot be read as a .npz file: .*actions"):
        read_arrays(path)


def test_a_header_of_nested_brackets_is_refused(tmp_path: Path) -> None:
    text = b"(" * 5000 + b"\n"
    path = written(tmp_path / "x.npz", a=b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text)
    with pytest.raises(InvalidValue, match="cannot be read as a .npz file"):
        read_arrays(path)


def test_an_archive_that_unpacks_to_gigabytes_is_refused(tmp_path: Path) -> None:
    """By what its directory says: 100 MB of zeros in 100 kB; and by its number of members."""
    path = written(tmp_path / "x.npz", zipfile.ZIP_DEFLATED, a=header((100 * 2**17,)) + bytes(100 * 2**20))
    assert path.stat().st_size < 2**20
    with pytest.raises(InvalidValue, match=r"its arrays take 1048\d+ bytes; accepted: up to 67108864"):
        read_arrays(path)
    with pytest.raises(InvalidValue, match="1001 arrays; accepted: up to 1000"):
        read_arrays(written(tmp_path / "y.npz", **{f"a{k}": b"" for k in range(1001)}))


def test_an_array_that_is_in_a_file_twice_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path / "x.npz", a=header((3,)) + bytes(24))
    with zipfile.ZipFile(path, "a") as archive, pytest.warns(UserWarning, match="Duplicate name"):
        archive.writestr("a.npy", header((3,)) + bytes(24))
    with pytest.raises(InvalidValue, match="'a.npy' is in it twice"):
        read_arrays(path)


def test_a_name_that_does_not_exist_is_told_what_was_probably_meant() -> None:
    """However long it is, the message stays one that can be read."""
    with pytest.raises(UnknownName, match=r"unknown material 'suger'.*; did you mean 'sugar'\?$"):
        config_path("materials", "suger", "material")
    for name in (5000 * "x", 5000 * "x" + ".yaml"):
        with pytest.raises(ConfigError) as caught:
            config_path("materials", name, "material")
        assert len(str(caught.value)) < 1000


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04", b"\x93NUMPY", b"\x80\x04K\x01."])
def test_other_files_are_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "x.npz"
    path.write_bytes(content)
    with pytest.raises(InvalidValue, match="x.npz: cannot be read as a .npz file"):
        read_arrays(path)


@pytest.mark.parametrize("value", [np.array([1, 2]), np.array("one"), np.array(-1), np.array(11), np.array(1.5),
                                   np.array(np.nan), np.zeros((10, 10))])
def test_single_values_are_checked(tmp_path: Path, value: np.ndarray) -> None:
    np.savez(tmp_path / "x.npz", n=value)
    with pytest.raises(InvalidValue, match=r"x.npz: n: .*; accepted: a whole number from 0 to 10"):
        read_arrays(tmp_path / "x.npz").integer("n", None, 0, 10)


BOMB = "\n".join(["a0: &a0 [x, x, x, x, x, x, x, x, x]"] +
                 [f"a{k + 1}: &a{k + 1} [{', '.join([f'*a{k}'] * 9)}]" for k in range(9)])
"""Nine lists of nine ... : 10^10 values."""


@pytest.mark.parametrize(("text", "message"), [
    ("a: 1\nb: 2\na: 3", "line 3: key 'a' is given twice"), ("t: {x: 1, y: 2, 'x': 3}", "line 1: key 'x' is given"),
    (BOMB, "more than 20000 values"), ("&a [1, *a]", "an alias within what it stands for"),
    ("[" * (MAX_DEPTH + 1), "nested more than 20 deep"), ("[" * 100_000, "nested more than 20 deep"),
    ("[" + "1," * 30_000 + "1]", "more than 20000 values"), ("!!int x", "does not fit its type"),
    ("!!timestamp x", "does not fit its type"), ("9" * 5000, "does not fit its type"),
])
def test_yaml_that_would_multiply_or_contradict_itself_is_refused(text: str, message: str) -> None:
    with pytest.raises(InvalidValue, match=message):
        yaml.load(text, Loader)


def test_yaml_keeps_aliases_and_merged_tables() -> None:
    assert yaml.load("a: &a {x: 1, y: 2}\nb: {<<: *a, x: 3}\nc: *a", Loader) == {
        "a": {"x": 1, "y": 2}, "b": {"x": 3, "y": 2}, "c": {"x": 1, "y": 2}}


@pytest.mark.parametrize(("text", "message"), [
    ('{"a": 1, "a": 2}', "key 'a' is given twice"), ("[NaN]", "NaN is not part of JSON"),
    ("[" * 100_000, "nested too deeply"),
    ("9" * 5000, "not JSON"), ("1e999", "'1e999' is too large"), ("", "not JSON")])
def test_json_is_checked(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "x.json").write_text(text)
    with pytest.raises(InvalidValue, match=rf"x.json: .*{message}"):
        read_json(tmp_path / "x.json")


FORM = {"name": str, "runs": [{"seconds": float, "count": int, "is_done": bool, "score": (float, None),
                               "more": ({str: float}, ...)}]}
RUN = {"seconds": 1, "count": 2, "is_done": True, "score": None, "other": []}


@pytest.mark.parametrize(("run", "message"), [
    (RUN, ""), ({**RUN, "score": 0.5, "more": {"a": 1.0}}, ""),
    ({**RUN, "seconds": None}, "runs.0.seconds: None; accepted: a number"),
    ({**RUN, "seconds": True}, "runs.0.seconds: True; accepted: a number"), ({**RUN, "seconds": 1e300}, "a number"),
    ({**RUN, "count": 1.5}, "a whole number"), ({**RUN, "count": 10**400}, "a whole number"),
    ({**RUN, "is_done": 1}, "true or false"), ({**RUN, "more": None}, "runs.0.more: None; accepted: a table"),
    ({**RUN, "more": {"a": "b"}}, "runs.0.more.'a': 'b'; accepted: a number"), ({}, "runs.0: key 'seconds' is missing"),
    ([], r"runs.0: \[\]; accepted: a table")])
def test_a_table_has_a_form(run: object, message: str) -> None:
    if message:
        with pytest.raises(InvalidValue, match=message):
            check_form({"name": "x", "runs": [run]}, FORM)
    else:
        check_form({"name": "x", "runs": [run]}, FORM)


def test_texts_are_small_and_utf8(tmp_path: Path) -> None:
    path = tmp_path / "x.yaml"
    for content, message in ((b"\xff\xfea\x00", "byte 0 is not UTF-8"), (b" " * (MAX_TEXT + 1), "accepted: up to")):
        path.write_bytes(content)
        with pytest.raises(InvalidValue, match=message):
            read_text(path)
    path.write_bytes("\ufeffköln".encode())
    assert read_text(path) == "köln"
    with pytest.raises(InvalidValue, match="not a file"):
        read_text(tmp_path)


def test_values_are_shown_short() -> None:
    assert len(quote("x" * 10**6)) < 300 and len(quote([[1] * 1000] * 1000)) < 1000
    assert "too long" in quote(10**5000) and quote(0.01) == quote(np.float64(0.01)) == "0.01"


@pytest.mark.parametrize(("array", "words"), [
    (np.array([True]), "of type bool; accepted: real numbers"), (np.array(["1.0"]), "of type <U3"),
    (np.array([0.0, np.nan]), "holds numbers that are not finite"), (np.array([np.inf]), "holds numbers that are not"),
])
def test_numbers_are_real_and_finite(tmp_path: Path, array: np.ndarray, words: str) -> None:
    np.savez(tmp_path / "x.npz", actions=array)
    with pytest.raises(InvalidValue, match=f"x.npz: actions: {words}"):
        read_arrays(tmp_path / "x.npz").numbers("actions")
    np.savez(tmp_path / "y.npz", actions=np.array([0.1 + 0.2j]))
    with pytest.raises(InvalidValue, match="y.npz: cannot be read as a .npz file: 'actions'"):
        read_arrays(tmp_path / "y.npz")
    with pytest.raises(InvalidValue, match="x.npz: holds actions; accepted: an array `tool`"):
        read_arrays(tmp_path / "x.npz").numbers("tool")
    if array.dtype.kind == "f":
        with pytest.raises(InvalidValue, match=words):
            read_arrays(tmp_path / "x.npz").check_finite()
