"""The stored report of verification cases: new runs replace a case's earlier ones; every case has a section."""

import json
from dataclasses import asdict
from pathlib import Path

import pytest
import yaml
from generators.results import verification
from generators.results.measured import DATA
from measuring.verification import store

from robosim.studies.verification.cases import NAMES, find
from robosim.studies.verification.cases.case import Record
from robosim.studies.verification.runs import Run, summarize_case


def report_of(name: str, error: float, pictures: tuple[str, ...], commit: str) -> dict:
    """Return what `robosim report` writes of a case with a run for each picture."""
    choices = {"precision": "f64", "cells": 16}
    runs = [Run(name, choices, "old", Record(name, choices, 10 * n, 1, 1.0, 0.0, {find(name).main_error: error},
                                             picture=picture)) for n, picture in enumerate(pictures, 1)]
    return {"made_by": {"commit": commit}, "cases": {name: summarize_case(name, runs)},
            "runs": [asdict(run) for run in runs]}


def test_a_case_that_is_measured_again_replaces_its_runs(tmp_path: Path) -> None:
    target = tmp_path / "report.json"
    store(report_of("bar", 0.3, ("old",), "a"), target)
    store(report_of("heap", 0.1, (), "a"), target)
    store(report_of("bar", 0.2, ("small", "large"), "b"), target)
    stored = json.loads(target.read_text())
    assert [run["record"]["errors"]["frequency"] for run in stored["runs"]] == [0.2, 0.2]
    assert [run["record"]["picture"] for run in stored["runs"]] == ["", "large"]  # one of each case is kept
    assert set(stored["cases"]) == {"bar", "heap"} and stored["made_by"]["commit"] == "a, b"


def test_every_case_says_what_limits_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    assert set(yaml.safe_load((DATA / "reasons.yaml").read_text())) == set(NAMES)
    (tmp_path / "reasons.yaml").write_text("bor:\n  line: x\n")
    monkeypatch.setattr(verification, "DATA", tmp_path)
    with pytest.raises(ValueError, match="bor"):
        verification.reasons.__wrapped__()


def test_the_page_has_a_line_and_a_section_of_every_case(monkeypatch: pytest.MonkeyPatch) -> None:
    """One that fails is marked, and listed among the limits; what was not run says so; older code is said."""
    bad = report_of("free_fall", 0.3, ("",), "a")
    monkeypatch.setattr(verification, "report", lambda: {**bad, "made_by": {"command": "c", "commit": "a"}})
    assert bad["cases"]["free_fall"]["verdict"] == "fail"
    lines = [line for line in verification.overview().splitlines() if line.startswith("| [")]
    assert len(lines) == len(NAMES) and sum("**fail** (older code)" in line for line in lines) == 1
    assert "[`free_fall`](../results/cases/continuum.md#free-fall)" in verification.limits()
    assert verification.limits().count("| [") == 1
    section = verification.case_section("free_fall")
    assert "Measured before" in section and "case_free_fall.svg" in section and "**Verdict: fail.**" in section
    assert "Not run." in verification.case_section("heap") and verification.figure("heap") == ""
    assert verification.figure("free_fall").startswith("<?xml")


def test_code_in_a_docstring_stays_as_it_is() -> None:
    assert verification.escape("a_b < `c_d`, e*f") == r"a\_b \< `c_d`, e\*f"
