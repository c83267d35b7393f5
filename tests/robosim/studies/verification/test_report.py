"""`robosim report`: finished runs are not repeated, pages open from disk, reports are compared."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from study_stand_in import StandIn

from robosim.base.errors import ConfigError
from robosim.reports.page import Page
from robosim.studies.verification.cases.case import Record
from robosim.studies.verification.cases.continuum import motion
from robosim.studies.verification.cases.expectations import Order, Within
from robosim.studies.verification.report import read_peers, report
from robosim.studies.verification.report_page import add_comparison
from robosim.studies.verification.runs import Run, picture_of, replace_non_finite, summarize_case


@pytest.mark.long
def test_a_report_runs_every_case_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Finished runs are kept, a failed run is a row with its reason; the page is self-contained and its points have
    tooltips."""
    monkeypatch.setattr(motion, "free_fall", replace(
        motion.free_fall, quick=[{"precision": "f64", "steps": 20}, {"precision": "f16"}]))
    assert report(["free_fall"], tmp_path, quick=True) == 1
    content = json.loads((tmp_path / "report.json").read_text())
    assert [bool(run["failed"]) for run in content["runs"]] == [False, True] and "f16" in content["runs"][1]["failed"]
    assert {c["verdict"] for c in content["cases"]["free_fall"]["claims"]} == {"pass", "not run"}
    page = (tmp_path / "index.html").read_text()
    assert "precision f64" in page and "No result at precision f16" in page
    markup = re.sub(r"<script>.*?</script>", "", page, flags=re.DOTALL)
    assert all(link.startswith(("#", "data:")) for link in re.findall(r'(?:src|href)="([^"]*)"', markup))
    again = StandIn(lambda **_: content["runs"][0]["record"])
    report(["free_fall"], tmp_path, quick=True, launcher=again)
    assert again.asked == [{"case": "free_fall", "choices": {"precision": "f16"}}]  # only the failed run is repeated


def make_run(choices: dict, failed: str = "", picture: str = "", particles: int = 8, **errors: float) -> Run:
    record = Record("free_fall", choices, particles, 1, 1.0, 0.0, errors, picture=picture)
    return Run("free_fall", choices, "code", None if failed else record, failed)


@pytest.mark.parametrize(("errors", "failed", "verdict"), [
    ({"max": 0.5, "rms": 0.5}, "", "pass"), ({"max": 0.5, "rms": 2.0}, "", "weak"),
    ({"max": 2.0, "rms": 0.5}, "", "fail"), ({"max": np.nan, "rms": 0.5}, "", "fail"),
    ({"max": 0.5, "rms": 0.5}, "stopped", "fail"), ({}, "", "not run")])
def test_the_verdict_of_a_case(errors: dict, failed: str, verdict: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Weak: all but the main error; a run that gave nothing, and an order that is not reached, count, too."""
    monkeypatch.setattr(motion, "free_fall", replace(motion.free_fall, main_error="max", expectations=(
        Within("max", 1.0), Within("rms", 1.0))))
    runs = [make_run({"speed": 1.0}, **errors)] if errors else []
    result = summarize_case("free_fall", runs + [make_run({}, failed)] * bool(failed))
    assert result["verdict"] == verdict
    assert result["range"] == ([errors["max"]] * 2 if np.isfinite(errors.get("max", np.nan)) else result["range"])


def test_an_order_alone_makes_a_case_weak(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(motion, "free_fall", replace(motion.free_fall, main_error="max", expectations=(
        Within("max", 1.0), Order("max", "speed", (1.0, 2.0), 1.5))))
    runs = [make_run({"speed": speed}, max=error) for speed, error in ((1.0, 0.4), (2.0, -0.2))]
    result = summarize_case("free_fall", runs)
    assert result["verdict"] == "weak" and result["range"] == [-0.2, 0.4]


def test_the_largest_run_lends_its_picture() -> None:
    runs = [make_run({}, picture=text, particles=n) for text, n in (("a", 5), ("b", 7), ("", 9))]
    assert picture_of([run.record for run in runs if run.record]) == "b" and picture_of([]) == ""


@pytest.mark.parametrize("content", ["{", '{"case": "bar"}\n', "[1, 2]\n"])
def test_a_foreign_file_is_named(tmp_path: Path, content: str) -> None:
    (tmp_path / "points.json").write_text(content)
    with pytest.raises(ConfigError, match=r"points\.json"):
        read_peers(tmp_path / "points.json")


def test_numbers_that_are_not_finite_become_null() -> None:
    assert replace_non_finite({"a": [np.inf, 1.0], "b": (np.nan, "x")}) == {"a": [None, 1.0], "b": [None, "x"]}


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
