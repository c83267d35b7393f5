"""`robosim report`: finished runs are not repeated, pages open from disk, reports are compared."""

import contextlib
import json
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from robosim.base.errors import ConfigError, UnknownName
from robosim.reports.page import Page
from robosim.studies.verification import runs
from robosim.studies.verification.analysis import replace_non_finite
from robosim.studies.verification.cases import find
from robosim.studies.verification.cases.record import Record
from robosim.studies.verification.report import read_peers, report
from robosim.studies.verification.report_page import add_comparison


def test_a_report_runs_every_case_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Finished runs are kept, a failed run is a row with its reason; the page is self-contained and its points have
    tooltips."""
    monkeypatch.setattr(find("free_fall"), "QUICK_SWEEP", [{"precision": "f64", "steps": 20}, {"precision": "f16"}])
    assert report(["free_fall"], tmp_path, quick=True) == 1
    first = (tmp_path / "report.jsonl").read_text().splitlines()
    content = json.loads((tmp_path / "report.json").read_text())
    assert [bool(run["failed"]) for run in content["runs"]] == [False, True]
    assert "f16" in content["runs"][1]["failed"]
    assert {c["verdict"] for c in content["cases"]["free_fall"]["claims"]} == {"pass", "not run"}
    page = (tmp_path / "index.html").read_text()
    assert "precision f64" in page and "No result at precision f16" in page
    markup = re.sub(r"<script>.*?</script>", "", page, flags=re.DOTALL)
    assert all(link.startswith("#") for link in re.findall(r'(?:src|href)="([^"]*)"', markup))
    started = []
    monkeypatch.setattr(runs, "run_jobs", lambda work, jobs, runner: started.append(work) or iter(()))
    with pytest.raises(KeyError):  # only the failed run is repeated
        report(["free_fall"], tmp_path, quick=True)
    assert [json.loads(arguments[1]) for _, arguments in started[0]] == [{"precision": "f16"}]
    assert (tmp_path / "report.jsonl").read_text().splitlines() == first


@pytest.mark.parametrize("content", ["{", '{"case": "bar"}\n', "[1, 2]\n"])
def test_a_foreign_file_is_named_and_kept(tmp_path: Path, content: str) -> None:
    (tmp_path / "report.jsonl").write_text(content)
    with pytest.raises(ConfigError, match="line 1.*left as it is"):
        report(["free_fall"], tmp_path)
    assert (tmp_path / "report.jsonl").read_text() == content
    (tmp_path / "points.json").write_text(content)
    with pytest.raises(ConfigError, match=r"points\.json"):
        read_peers(tmp_path / "points.json")


def test_a_line_that_was_cut_off_is_removed(tmp_path: Path) -> None:
    path = tmp_path / "report.jsonl"
    record = Record(case="bar", choices={"cells": 13}, particles=1, steps=1, seconds=1.0, compile_seconds=0.0,
                    errors={"rms": np.nan})
    runs.append_run(path, runs.Run("bar", {"cells": 13}, "code", record))
    complete = path.read_text()
    path.write_text(complete + complete[:40])
    again = runs.read_runs(path)
    assert len(again) == 1 and path.read_text() == complete
    assert again[0].record is not None and np.isnan(again[0].record.errors["rms"])


def test_numbers_that_are_not_finite_become_null() -> None:
    assert replace_non_finite({"a": [np.inf, 1.0], "b": (np.nan, "x")}) == {"a": [None, 1.0], "b": [None, "x"]}


def test_an_unknown_case_is_named_with_the_list(tmp_path: Path) -> None:
    with pytest.raises(UnknownName, match="free_fall"):
        report(["fre_fall"], tmp_path)


def test_two_reports_are_compared() -> None:
    def content(record: dict | None, failed: str = "") -> dict:
        run = {"case": "bar", "choices": {}, "record": record, "failed": failed}
        return {"made_by": {"commit": "c", "machine": "m"}, "runs": [run]}

    def measured(error: float, seconds: float) -> dict:
        return content({"errors": {"rms": error}, "seconds": seconds})

    rows = add_comparison(Page("x"), measured(0.02, 1.0), measured(0.01, 1.0))
    assert rows[0][5] == pytest.approx(0.5)
    assert add_comparison(Page("x"), measured(0.02, 1.0), measured(0.0201, 1.01)) == []
    failed = content(None, "too long")
    assert [row[2::3] for row in add_comparison(Page("x"), measured(0.02, 1.0), failed)] == \
        [["no result: too long", np.inf, None]]
    assert [row[2::3] for row in add_comparison(Page("x"), failed, measured(0.02, 1.0))] == \
        [["a result where there was none: too long", 0.0, None]]
    with pytest.raises(ConfigError, match=r"report\.json"):
        add_comparison(Page("x"), {}, measured(0.01, 1.0))


def has_ended(group: int) -> bool:
    """Whether no process of a group runs any more, within ten seconds."""
    for _ in range(200):
        stats = []
        for path in Path("/proc").glob("[0-9]*/stat"):
            with contextlib.suppress(OSError):  # it has just ended
                stats.append(path.read_text().rpartition(")")[2].split())
        if not any(int(fields[2]) == group and fields[0] != "Z" for fields in stats):
            return True
        time.sleep(0.05)
    return False


@pytest.mark.slow
@pytest.mark.parametrize("command", [["report", "free_fall", "spin", "--quick"], ["stability", "payload", "arm_pose"]])
def test_a_killed_command_continues(tmp_path: Path, command: list[str]) -> None:
    """SIGKILL after the first result; the same command keeps it and completes the others."""
    results = tmp_path / ("report.jsonl" if command[0] == "report" else "stability.json")
    arguments = [sys.executable, "-m", "robosim", *command, "--out", str(tmp_path)]
    process = subprocess.Popen(arguments, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL, start_new_session=True)
    while not results.is_file():
        time.sleep(0.05)
    process.send_signal(signal.SIGKILL)
    process.wait()
    if sys.platform == "linux":
        assert has_ended(process.pid)
    before = results.read_text()
    done = len(before.splitlines()) if command[0] == "report" else len(json.loads(before)["cells"])
    assert subprocess.run(arguments, capture_output=True, check=False).returncode == 0
    after = results.read_text()
    if command[0] == "report":
        planned = runs.plan_runs(["free_fall", "spin"], quick=True)
        assert after.startswith(before) and len(after.splitlines()) == len(planned)
    else:
        cells = json.loads(after)["cells"]
        assert len(cells) == 11 and cells[:done] == json.loads(before)["cells"]
