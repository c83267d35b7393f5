"""Wild values and damaged files for the tests of schemas and readers, and the bounds that each input is handled in."""

import contextlib
import copy
import io
import json
import re
import resource
import signal
import zipfile
from collections.abc import Callable, Iterator
from typing import Any
from xml.etree import ElementTree

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import mpm
from robosim.base.errors import RobosimError

MEMORY = 2 * 2**30
"""Bytes that handling one input may add to the address space."""
SECONDS = 10
"""Time that handling one input may take."""
OWN = (RobosimError, mpm.MpmError)
"""Errors that a command prints as a line."""
WILD: tuple[Any, ...] = (float("nan"), float("inf"), -float("inf"), 1e300, -1e300, 1e-300, 10**400, -1, 0, 2**63, "",
                         "x" * 10**6, "\ud7ff\u202e\x00", "1e6", None, True, [], {}, [[[[[[1]]]]]], [0] * 10**5,
                         {"a": {"b": {}}}, {1: 2}, b"\xff", "../../etc/passwd", "\n")
"""Values that are wrong, or extreme, at most places of a file."""
SMALL: tuple[Any, ...] = tuple(value for value in WILD if len(repr(value) if not isinstance(value, int) else "") < 1000)
"""Those that a file of wrong values is written with in a moment."""
FILLS: tuple[Any, ...] = (0, 1, -1, 10**9, 2**63 - 1, 1e300, np.nan, np.inf, True, "text", "\u202e")
"""Values that arrays are filled with."""
PIECES = (b"\x00" * 8, b"\xff" * 8, b"[" * 5000, b"{a: " * 500, b"&a [*a]", b"\n- " * 3000, b"9" * 5000, b"1e999",
          b"\xff\xfe", b"!!python/none ", b'{"a": 1, "a": 1}', b"NaN")
"""What readers of text fail on."""

TEXTS = (b"nan", b"inf", b"-inf", b"1e308", b"-1e308", b"1e-320", b"-1", b"0", b"99999999999", b"4294967295", b"", b"x",
         b"1 1", b"../../x", b"9" * 400)
"""Texts in place of a number or a name."""


class TooSlow(BaseException):
    """An input took more than SECONDS of processor time; no `except Exception` hides it."""


@contextlib.contextmanager
def bounded() -> Iterator[None]:
    """Limit memory and time of what is within: beyond, MemoryError or TooSlow is raised."""
    def stop(*_: object) -> None:
        raise TooSlow

    with open("/proc/self/statm") as file:
        now = int(file.read().split()[0]) * resource.getpagesize()
    limits, handler = resource.getrlimit(resource.RLIMIT_AS), signal.signal(signal.SIGPROF, stop)
    resource.setrlimit(resource.RLIMIT_AS, (now + MEMORY, limits[1]))
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, handler)
        resource.setrlimit(resource.RLIMIT_AS, limits)


def handle(action: Callable[[], Any]) -> tuple[Any, str]:
    """Return what an action returns and "", or None and the message of one of the project's errors."""
    with bounded():
        try:
            return action(), ""
        except OWN as error:
            text = str(error)
    assert text and len(text) < 20_000 and "\n" not in text
    return None, text


def fuzz(drawn: st.SearchStrategy[Any], examples: int, action: Callable[[Any], object]) -> None:
    """Handle what is drawn: the same inputs in every run; more than 100 examples are drawn anew each time."""
    fixed = examples <= 100

    @settings(max_examples=examples, derandomize=fixed, deadline=None, database=None, print_blob=not fixed,
              suppress_health_check=list(HealthCheck))
    @given(drawn)
    def attempt(one: Any) -> None:
        handle(lambda: action(one))

    attempt()


def places(value: Any, here: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """List the places of all values in tables and lists, those of tables and lists themselves, too."""
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [place for key, one in inner for place in ((*here, key), *places(one, (*here, key)))]


def look_up(value: Any, place: tuple[Any, ...]) -> Any:
    for key in place:
        value = value[key]
    return value


def replaced(table: dict[str, Any], place: tuple[Any, ...], value: Any) -> dict[str, Any]:
    """Copy a table with a value at a place; the value Ellipsis removes the place."""
    changed = copy.deepcopy(table)
    node = look_up(changed, place[:-1])
    if value is ...:
        del node[place[-1]]
    else:
        node[place[-1]] = value
    return changed


def wild_values() -> st.SearchStrategy[Any]:
    """Draw values of any type: numbers, texts, tables within lists within tables."""
    leaves = st.one_of(st.sampled_from(SMALL), st.floats(), st.integers(), st.text(max_size=20), st.booleans())
    return st.recursive(leaves, lambda inner: st.one_of(
        st.lists(inner, max_size=4), st.dictionaries(st.text(max_size=5), inner, max_size=3)), max_leaves=8)


@st.composite
def changed_tables(draw: Callable, table: dict[str, Any]) -> dict[str, Any]:
    """Draw a table with up to three places removed or replaced."""
    for _ in range(draw(st.integers(1, 3))):
        here = places(table)
        if here:
            table = replaced(table, draw(st.sampled_from(here)), draw(st.one_of(st.just(...), wild_values())))
    return table


def json_files(table: dict[str, Any]) -> st.SearchStrategy[bytes]:
    """Draw JSON files: a table with changes, or its file with damage."""
    changed = changed_tables(table).map(lambda one: json.dumps(one, default=str).encode())
    return st.one_of(changed, changed, damaged(json.dumps(table).encode()))


@st.composite
def damaged(draw: Callable, content: bytes) -> bytes:
    """Draw a file with bytes replaced, removed, inserted or repeated, or another file altogether."""
    if draw(st.integers(0, 9)) == 0:
        return draw(st.binary(max_size=200))
    for _ in range(draw(st.integers(1, 4))):
        begin = draw(st.integers(0, len(content)))
        end = draw(st.integers(begin, min(len(content), begin + draw(st.sampled_from([0, 1, 4, 100, 10**6])))))
        middle = draw(st.one_of(st.binary(max_size=8), st.just(content[begin:end] * draw(st.integers(0, 20))),
                                st.sampled_from(PIECES)))
        content = content[:begin] + middle + content[end:]
    return content


@st.composite
def array_files(draw: Callable, arrays: dict[str, np.ndarray]) -> bytes:
    """Draw a .npz file with arrays removed, of other shapes, types and values, with headers that lie, or damaged."""
    changed = dict(arrays)
    for _ in range(draw(st.integers(1, 3))):
        name = draw(st.sampled_from([*arrays, "other"]))
        old = changed.get(name, np.zeros(3))
        shape = draw(st.one_of(st.just(old.shape), st.lists(st.integers(0, 7), max_size=4).map(tuple)))
        value = draw(st.sampled_from(FILLS))
        if draw(st.booleans()):
            changed[name] = np.full(shape, value)
        else:
            changed.pop(name, None)
    file = io.BytesIO()
    np.savez(file, **changed)  # pyright: ignore[reportArgumentType]
    kind = draw(st.integers(0, 3))
    if kind != 1:
        return draw(damaged(file.getvalue())) if kind == 2 else file.getvalue()
    lying = io.BytesIO()
    with zipfile.ZipFile(file) as archive, zipfile.ZipFile(lying, "w", zipfile.ZIP_DEFLATED) as other:
        for member in archive.infolist():
            content = archive.read(member)
            old = draw(st.sampled_from([b"(", b", ", b"<f", b"False", b"descr", b"1", b"NUMPY\x01", b"}"]))
            new = draw(st.sampled_from([b"(9999999999, ", b",", b"<c", b"|O", b"-", b"(" * 100, b"V", b"NUMPY\x03"]))
            other.writestr(member, content.replace(old, new, 1))
    return lying.getvalue()


@st.composite
def changed_texts(draw: Callable, content: bytes) -> bytes:
    """Draw a text with up to three of its numbers or quoted words replaced."""
    for _ in range(draw(st.integers(1, 3))):
        here = [found.span() for found in re.finditer(rb'-?\d[\d.e-]*|(?<=")[^"<>]+(?=")', content)]
        if here:
            begin, end = draw(st.sampled_from(here))
            content = content[:begin] + draw(st.sampled_from(TEXTS)) + content[end:]
    return content


@st.composite
def changed_elements(draw: Callable, content: bytes) -> bytes:
    """Draw XML with up to three elements removed, copied into others, or with attributes removed or exchanged."""
    root = ElementTree.fromstring(content)
    for _ in range(draw(st.integers(1, 3))):
        pairs = [(parent, child) for parent in root.iter() for child in parent]
        (parent, child), (other, _) = draw(st.tuples(*2 * [st.sampled_from(pairs)]))
        if draw(st.booleans()) and child.attrib:
            one, two = draw(st.tuples(*2 * [st.sampled_from(sorted(child.attrib))]))
            child.attrib[one], child.attrib[two] = child.attrib[two], child.attrib[one]
            if one == two:
                del child.attrib[one]
        elif draw(st.booleans()) and len(pairs) > 1:
            parent.remove(child)
        else:
            other.append(copy.deepcopy(child))
    return ElementTree.tostring(root)
