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
from robosim.studies.verification.cases.continuum import motion
from robosim.studies.verification.report import read_peers, report
from robosim.studies.verification.report_page import add_comparison
from robosim.studies.verification.runs import replace_non_finite


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
    assert all(link.startswith("#") for link in re.findall(r'(?:src|href)="([^"]*)"', markup))
    again = StandIn(lambda **_: content["runs"][0]["record"])
    report(["free_fall"], tmp_path, quick=True, launcher=again)
    assert again.asked == [{"case": "free_fall", "choices": {"precision": "f16"}}]  # only the failed run is repeated


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
