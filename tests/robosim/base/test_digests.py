"""Digests of the code that a result depends on."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from robosim.base import digests
from robosim.base.digests import code_digest, parse_module, source_files


@pytest.fixture
def package(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Path]:
    """A package of modules `case` -> `a` -> `b`, and `c`, which nothing imports."""
    (tmp_path / "mpm").mkdir()
    a = '"""A."""\nfrom mpm import b\n\nX = 1.0\n"""[m]"""\n'
    for name, text in {"__init__": "", "case": "import mpm.a", "a": a, "b": "", "c": ""}.items():
        (tmp_path / "mpm" / f"{name}.py").write_text(text)
    monkeypatch.setattr(digests, "ROOT", tmp_path)
    monkeypatch.setenv("ROBOSIM_CACHE", str(tmp_path / "cache"))
    yield tmp_path / "mpm"
    forget()


def forget() -> None:
    """Forget what this process has read."""
    for function in (code_digest, digests.module_file, digests.read_module, digests._memo):
        function.cache_clear()


def fresh_digest() -> str:
    """The digest that a process would have which starts now."""
    forget()
    return code_digest("mpm.case")


def test_a_digest_changes_with_statements_that_are_imported_and_with_nothing_else(package: Path) -> None:
    """Docstrings, comments and layout do not count; a number does, and a module that something imports."""
    first, source = fresh_digest(), (package / "a.py").read_text()
    for same in (source.replace("A.", "Another text.").replace("[m]", "Length [m]."), f"{source}  # why\n",
                 source.replace("X = 1.0", "X = (\n    1.0)")):
        (package / "a.py").write_text(same)
        assert fresh_digest() == first
    (package / "c.py").write_text("X = 1")
    assert fresh_digest() == first
    found = {first}
    for name, text in (("a", source.replace("1.0", "2.0")), ("b", "X = 1"), ("case", "import mpm.a, mpm.c")):
        (package / f"{name}.py").write_text(text)
        found.add(fresh_digest())
    assert len(found) == 4


def test_modules_are_parsed_once(package: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also by the next process; a damaged memo is computed again."""
    first = fresh_digest()
    monkeypatch.setattr(digests, "parse_module", None)  # raises where it is called
    assert fresh_digest() == first
    monkeypatch.setattr(digests, "parse_module", parse_module)
    (package.parent / "cache" / "code" / digests.MEMO).write_text("{")
    assert fresh_digest() == first


def test_a_digest_covers_all_that_a_run_computes_with() -> None:
    files = {path.relative_to(digests.ROOT).as_posix() for path in source_files("robosim.studies.benchmarks.scene_run")}
    assert {"mpm/stepping/phases.py", "mpm/solver.py", "robosim/coupling/plugin.py"} <= files
