"""Studies: rows that are kept and continued, and digests that say whether a stored result is of today."""

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from study_stand_in import StandIn

from robosim.base import digests
from robosim.base.digests import code_digest, parse_module, source_files
from robosim.base.jobs import hold_cores, worker_pool
from robosim.base.study import Job, Store, Study

MODULE = """
import ctypes, math, os, sys, time

def measure(x, out=""):
    print("on the way")
    if x == 1:
        raise ValueError("no such grain")
    if x == 2:
        ctypes.string_at(0)
    return {"x": x, "nan": math.nan, "cores": len(os.sched_getaffinity(0)), "threads": os.environ["OMP_NUM_THREADS"]}

def wait(x):
    time.sleep(30.0 * x)
"""


@pytest.fixture
def jobs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[Job]:
    """Jobs of which the second raises an error and the third ends its process."""
    (tmp_path / "measuring.py").write_text(MODULE)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")]))
    return [Job("measuring:measure", {"x": x}, exercises="robosim.base.errors") for x in range(4)]


def test_a_job_that_fails_costs_its_own_row(tmp_path: Path, jobs: list[Job]) -> None:
    """With the reason; each job is alone on a core; finished rows say what made them and are not made again."""
    rows = Study(tmp_path / "out", 2).rows(jobs, "test")
    crashed = f"killed by signal {signal.SIGSEGV.value}"
    assert [row.failed for row in rows] == ["", "ValueError: no such grain", crashed, ""]
    assert rows[3].value["x"] == 3 and rows[3].value["nan"] != rows[3].value["nan"]
    assert rows[3].value["threads"] == "1" and (sys.platform != "linux" or rows[3].value["cores"] == 1)
    files = sorted((tmp_path / "out" / "rows").glob("*.json"))
    stored = json.loads(files[0].read_text())
    assert len(files) == 2 and {"function", "arguments", "code", "commit", "machine"} <= stored.keys()
    again = StandIn(lambda x: {"x": x})
    rows = Study(tmp_path / "out", launcher=again).rows(jobs, "test")
    assert again.asked == [{"x": 1}, {"x": 2}] and [row.value["x"] for row in rows] == [0, 1, 2, 3]


def test_two_studies_at_a_time_share_no_core_while_one_is_free(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where none is, they share; a core is free again as soon as a study ends."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {3, 5, 8}, raising=False)
    with hold_cores(2) as first, hold_cores(2) as second, hold_cores(1) as third:
        assert (first, second, third) == ([3, 5], [8, 3], [3])
    with hold_cores(9) as alone:
        assert alone == [3, 5, 8]
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "file" / "below"))
    with hold_cores(1) as without_a_folder:
        assert without_a_folder == [3]


def test_a_row_belongs_to_arguments_code_and_what_else_it_depends_on(tmp_path: Path, jobs: list[Job]) -> None:
    """And not to where it writes."""
    job = jobs[0]
    Study(tmp_path, launcher=StandIn(lambda x: x)).rows([job], "test")
    for other, is_known in ((job._replace(places={"out": "b"}), True), (job._replace(arguments={"x": 5}), False),
                            (job._replace(depends="a file"), False), (job._replace(function="measuring:wait"), False),
                            (job._replace(exercises="robosim.base.files"), False)):
        launcher = StandIn(lambda x: x)
        Study(tmp_path, launcher=launcher).rows([other], "test")
        assert (launcher.asked == []) == is_known, other


@pytest.mark.parametrize("damage", ["", "{", "[1]", '{"key": "k", "checksum": "x", "value": 1}'])
def test_a_damaged_row_is_made_anew(tmp_path: Path, damage: str, capsys: pytest.CaptureFixture[str]) -> None:
    store = Store(tmp_path)
    assert store.find("k") is None
    store.keep("k", {"a": [1, (2, 3)]})
    assert store.find("k") == ({"a": [1, [2, 3]]},)
    store.path("k").write_text(damage)
    assert store.find("k") is None and "running the job again" in capsys.readouterr().err


def test_jobs_end_with_a_study_that_is_killed(tmp_path: Path, jobs: list[Job]) -> None:
    script = f"""
from pathlib import Path
from robosim.base.study import Job, Study
Study(Path({str(tmp_path)!r}), 2).rows([Job("measuring:wait", {{"x": 1}}, exercises="robosim.base.errors")], "test")
"""
    study = subprocess.Popen([sys.executable, "-c", script], stderr=subprocess.DEVNULL)
    children: Any = []
    while not children and study.poll() is None:
        time.sleep(0.05)
        children = Path(f"/proc/{study.pid}/task/{study.pid}/children").read_text().split()
    time.sleep(1.0)  # until the job has asked for its end
    study.kill()
    study.wait()
    for _ in range(100):
        if not any(Path(f"/proc/{child}").exists() for child in children):
            return
        time.sleep(0.05)
    pytest.fail(f"{children} goes on")


def test_a_signal_to_the_group_is_left_to_the_parent() -> None:
    with worker_pool(1) as pool:
        worker = pool.submit(os.getpid).result()
        os.kill(worker, signal.SIGTERM)
        assert pool.submit(os.getpid).result() == worker


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
