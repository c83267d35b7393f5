"""Reports: claims that can fail, runs that are never repeated, pages that open from disk."""

import contextlib
import inspect
import json
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import mpm
from robosim.benchmarks.explain import explain, judged
from robosim.errors import ConfigError, UnknownName
from robosim.reports import provenance
from robosim.reports.page import Page
from robosim.reports.provenance import code_digest, source_files
from robosim.verification import results as module
from robosim.verification.analysis import findings, finite, front, seconds_to
from robosim.verification.cases import NAMES, find
from robosim.verification.cases.continuum import bar
from robosim.verification.cases.coupling import closed_system
from robosim.verification.cases.criteria import Order, Power, Rising, Within
from robosim.verification.cases.granular import slope
from robosim.verification.cases.record import Record
from robosim.verification.compare import compared
from robosim.verification.work_precision import peers, report


def made(error: float, seconds: float = 1.0, **choices) -> Record:
    return Record(case="bar", choices=choices, particles=1, steps=1, seconds=seconds, compile_seconds=0.0,
                  errors={"rms": error})


def test_a_power_is_read_off_the_runs() -> None:
    """y = 3 x^1.5 passes as a power from 1.4 to 1.6, not as one from 1.6 to 2; one width tells nothing."""
    runs = [Record(case="bar", choices={}, particles=1, steps=1, seconds=1.0, compile_seconds=0.0, errors={},
                   readings={"x": x, "y": 3.0 * x**1.5}) for x in (0.5, 1.0, 4.0)]
    assert Power("y", "x", 1.4, 1.6).judge(runs).found == pytest.approx(1.5)
    assert Power("y", "x", 1.4, 1.6).judge(runs).verdict == "pass"
    assert Power("y", "x", 1.6, 2.0).judge(runs).verdict == "fail"
    assert Power("y", "x", 1.4, 1.6).judge(runs[:1]).verdict == "not run"


def test_a_band_without_a_lower_end_sees_every_run() -> None:
    band = Within("rms", 0.02, low=-np.inf)
    assert band.judge([made(-5.0), made(0.01)]).verdict == "pass"
    assert band.judge([made(0.001), made(0.5), made(-5.0)]).found == 0.5
    assert band.judge([made(0.001), made(float("nan"))]).verdict == "fail"


def test_claims_are_judged_by_the_worst_run() -> None:
    runs = [made(0.01, cells=10), made(-0.03, cells=10, precision="f32"), made(0.0025, cells=20)]
    assert Within("rms", 0.02, {"cells": 10}).judge(runs).found == -0.03
    assert Within("rms", 0.02, {"cells": 10}).judge(runs).verdict == "fail"
    assert Within("rms", 0.02, {"cells": 20}).judge(runs).verdict == "pass"
    assert Within("rms", 0.02, {"cells": 40}).judge(runs).verdict == "not run"
    assert Within("rms", 0.02, {"cells": 50}).judge([made(np.nan, cells=50)]).verdict == "fail"
    second = Order("rms", "cells", (10, 20), 1.9).judge([runs[0], runs[2]])
    assert second.found == pytest.approx(2.0) and second.verdict == "pass"
    assert Order("rms", "cell", (0.2, 0.1), 2.1).judge([made(0.04, cell=0.2), made(0.01, cell=0.1)]).verdict == "fail"
    assert Rising("rms", "slip").judge([made(1.0, slip=0.1), made(0.5, slip=0.2)]).verdict == "fail"


def test_front_and_price() -> None:
    """Against answers found by hand: an error of 1 % halfway, in logarithms, between 4 % in 1 s and 0.25 % in 4 s."""
    assert front([(1.0, 0.04), (2.0, 0.05), (4.0, 0.0025), (0.5, 0.5)]) == [3, 0, 2]
    assert seconds_to(0.01, [(1.0, 0.04), (4.0, 0.0025)]) == pytest.approx(2.0)
    assert seconds_to(0.001, [(1.0, 0.04), (4.0, 0.0025)]) is None


@pytest.mark.parametrize("name", NAMES)
def test_every_case_claims_what_its_runs_can_tell(name: str) -> None:
    case = find(name)
    known = {key for choices in (*case.SWEEP, *case.QUICK) for key in choices}
    assert case.CHECKS and case.QUICK and case.SOURCE
    assert case.KNOB is None or case.KNOB in known
    for check in case.CHECKS:
        assert check.judge([]).verdict == "not run"


@pytest.mark.parametrize("name", NAMES)
def test_every_claim_is_told_by_a_whole_report(name: str) -> None:
    """What a claim asks for is among the sweep's runs, where arguments that the sweep leaves open have their default,
    and the record says so. Otherwise the claim would stay "not run" however much is run."""
    case = find(name)
    source, arguments = inspect.getsource(case.measure), inspect.signature(case.measure).parameters
    runs = [{key: argument.default for key, argument in arguments.items()} | choices for choices in case.SWEEP]
    for check in case.CHECKS:
        ends = [{check.knob: end} for end in check.ends] if isinstance(check, Order) else [{}]
        for wanted in ({**check.where, **end} for end in ends):
            found = [choices for choices in runs if wanted.items() <= choices.items()]
            assert found, f"{check}: no run at {wanted}"
            assert not isinstance(check, Rising) or len({choices[check.knob] for choices in found}) > 1
            assert all(f'"{key}": {key}' in source for key in wanted), f"{check}: the record says nothing of {wanted}"


def test_a_report_is_made_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Lines of finished runs are kept and not run again, a failed one becomes a row with its reason; the page needs
    nothing but itself, and its points tell their values."""
    monkeypatch.setattr(find("free_fall"), "QUICK", [{"precision": "f64", "steps": 20}, {"precision": "f16"}])
    assert report(["free_fall"], tmp_path, quick=True) == 1
    first = (tmp_path / "report.jsonl").read_text().splitlines()
    told = json.loads((tmp_path / "report.json").read_text())
    assert [bool(run["failed"]) for run in told["runs"]] == [False, True]
    assert "f16" in told["runs"][1]["failed"]
    assert {c["verdict"] for c in told["cases"]["free_fall"]["claims"]} == {"pass", "not run"}
    page = (tmp_path / "index.html").read_text()
    assert "<title>precision f64" in page and "No result at precision f16" in page
    outside = [link for link in re.findall(r'(?:src|href)="([^"]*)"', page) if not link.startswith("#")]
    assert not outside
    run = []
    monkeypatch.setattr(module, "run_jobs", lambda work, jobs: run.append(work) or iter(()))
    with pytest.raises(KeyError):  # only what failed would be run again
        report(["free_fall"], tmp_path, quick=True)
    assert [json.loads(words[1]) for _, words in run[0]] == [{"precision": "f16"}]
    assert (tmp_path / "report.jsonl").read_text().splitlines() == first


def test_other_code_is_run_again(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The version of a case changes with what it imports at any remove, and with nothing else."""
    for name, text in {"__init__": "", "case": "import mpm.a", "a": "from mpm import b", "b": "", "c": ""}.items():
        (tmp_path / "mpm").mkdir(exist_ok=True)
        (tmp_path / "mpm" / f"{name}.py").write_text(text)
    monkeypatch.setattr(provenance, "ROOT", tmp_path)

    def version(changed: str) -> str:
        with (tmp_path / "mpm" / f"{changed}.py").open("a") as file:
            file.write("\n")
        code_digest.cache_clear()
        return code_digest("mpm.case")

    seen = [version("c"), version("c"), version("b"), version("case")]
    code_digest.cache_clear()
    assert seen[0] == seen[1] and len(set(seen)) == 3


def test_shapes_of_tools_are_code_that_counts() -> None:
    for name in ("robosim.benchmarks.settings", "robosim.evaluation.material_episode",
                 "robosim.verification.cases.robot.arm_limits"):
        assert {"spoon.py", "scoop.py", "bottle.py", "shovel.py"} <= {path.name for path in source_files(name)}


@pytest.mark.parametrize("content", ["{", '{"case": "bar"}\n', "[1, 2]\n"])
def test_a_foreign_file_is_named_and_kept(tmp_path: Path, content: str) -> None:
    (tmp_path / "report.jsonl").write_text(content)
    with pytest.raises(ConfigError, match="line 1.*left as it is"):
        report(["free_fall"], tmp_path)
    assert (tmp_path / "report.jsonl").read_text() == content
    (tmp_path / "points.json").write_text(content)
    with pytest.raises(ConfigError, match=r"points\.json"):
        peers(tmp_path / "points.json")


def test_a_line_that_was_cut_is_run_again(tmp_path: Path) -> None:
    """And numbers that are none reach the page as nothing."""
    path = tmp_path / "report.jsonl"
    run = module.Run("bar", {"cells": 13}, "code", made(np.nan, cells=13))
    module.written(path, run)
    whole = path.read_text()
    path.write_text(whole + whole[:40])
    again = module.read(path)
    assert len(again) == 1 and np.isnan(again[0].record.errors["rms"]) and path.read_text() == whole
    assert finite({"a": [np.inf, 1.0], "b": (np.nan, "x")}) == {"a": [None, 1.0], "b": [None, "x"]}


def test_unknown_names_are_told_with_the_list(tmp_path: Path) -> None:
    with pytest.raises(UnknownName, match="free_fall"):
        report(["fre_fall"], tmp_path)
    with pytest.raises(UnknownName, match="SpoonPour"):
        explain("SpoonPure")
    with pytest.raises(ConfigError, match="--tolerance 2"):
        explain("SpoonPour", tolerance=2.0)


def test_two_reports_are_compared() -> None:
    def one(error: float, seconds: float) -> dict:
        record = {"errors": {"rms": error}, "seconds": seconds}
        return {"made_by": {"commit": "c", "machine": "m"}, "runs": [{"case": "bar", "choices": {}, "record": record}]}

    rows = compared(Page("x"), one(0.02, 1.0), one(0.01, 1.0))
    assert rows[0][5] == pytest.approx(0.5)
    assert compared(Page("x"), one(0.02, 1.0), one(0.0201, 1.01)) == []
    lost = {**one(0.0, 0.0), "runs": [{"case": "bar", "choices": {}, "record": None, "failed": "too long"}]}
    assert [row[2::3] for row in compared(Page("x"), one(0.02, 1.0), lost)] == [["no result: too long", np.inf, None]]
    assert [row[2::3] for row in compared(Page("x"), lost, one(0.02, 1.0))] == \
        [["a result where there was none: too long", 0.0, None]]
    with pytest.raises(ConfigError, match=r"report\.json"):
        compared(Page("x"), {}, one(0.01, 1.0))


def test_the_cheapest_setting_within_the_tolerance() -> None:
    def result(setting: dict, seconds: float, mass: float, spilled: float) -> dict:
        return {"setting": setting, "failed": "",
                "answer": {"seconds": seconds, "readings": {"mass": mass, "spilled": spilled}}}

    rows = judged([result({}, 8.0, 2.0, 0.001), result({"cell": 2.0}, 1.0, 2.1, 0.001),
                   result({"cell": 1.5}, 2.0, 2.02, 0.004)], 0.02)
    assert [row["within"] for row in rows] == [True, False, True]
    assert rows[2]["cheaper"] == 4.0 and rows[2]["worst"] == "mass"
    rows = judged([result({}, 8.0, 2.0, 0.001), result({"cell": 0.8}, 20.0, 2.03, 0.001),
                   result({"cell": 1.5}, 2.0, 2.02, 0.004)], 0.01)
    assert [row["within"] for row in rows] == [False, True, True]  # the scene's own has an error, too
    assert [row["cheaper"] for row in rows] == [2.5, 1.0, 10.0]


def test_the_cheapest_setting_counts_where_it_cannot_be_written(
        tmp_path: Path, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch) -> None:
    """A softer material is not the scene's file to say: that holds the scene's own setting, and the answer is still
    that a cheaper one was found."""
    def result(setting: dict, seconds: float) -> dict:
        return {"setting": setting, "failed": "", "answer": {
            "grains": 1, "cell": 0.004, "dt": 1e-4, "parts": [], "costs": {}, "seconds": seconds,
            "readings": {"mass": 2.0}}}

    monkeypatch.setattr("robosim.benchmarks.explain.ran", lambda *which: [result({}, 8.0), result({"E": 0.25}, 4.0)])
    assert explain("SpoonPour", tolerance=0.02, out=tmp_path, apply=True) == 0
    said = capsys.readouterr().out
    assert "cheapest within 2.0% of as it is: E x 0.25" in said and "written, with as it is" in said


@pytest.mark.slow
def test_explain_names_parts_and_costs(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    assert explain("SpoonTranslate", out=tmp_path) == 0
    said = capsys.readouterr().out
    assert "leaves out:" in said and "no wrench is compiled" in said and "  field: " in said
    own = json.loads((tmp_path / "explain.json").read_text())["results"][0]["answer"]
    assert own["readings"]["delivered"] == 1.0
    assert sum(own["costs"].values()) == pytest.approx(own["seconds"] / own["simulated"], rel=1e-6)


# planted errors: each makes a claim fail that holds without it --------------------------------------------------------
def verdicts(case: str, *records: Record) -> dict[str, str]:
    return {finding.claim: finding.verdict for finding in findings(case, list(records))}


def test_a_reaction_that_is_scaled_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    """The ball is given nine tenths of what the grains lose."""
    whole = mpm.Solver.collider_impulse

    def scaled(self: mpm.Solver, *which, **about) -> mpm.Wrench:
        return mpm.Wrench(*(0.9 * part for part in whole(self, *which, **about)))

    choices = {"precision": "f32", "mass_ratio": 1.0, "material": "sand"}
    monkeypatch.setattr(mpm.Solver, "collider_impulse", scaled)
    assert "fail" in verdicts("closed_system", closed_system.measure(**choices)).values()


@pytest.mark.slow
def test_a_wall_that_is_off_by_half_a_cell_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    """The bar begins half a cell off the wall that holds it."""
    box = mpm.sample_box
    choices = {"cells": 50, "courant": 0.2, "precision": "f64", "periods": 1}
    claim = "frequency at cells 50, courant 0.2, precision f64"
    assert verdicts("bar", bar.measure(**choices))[claim] == "pass"
    monkeypatch.setattr(bar.mpm, "sample_box", lambda low, high, spacing: box(low, high, spacing) + [spacing, 0, 0])
    assert verdicts("bar", bar.measure(**choices))[claim] == "fail"


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.9, 1.1])
def test_a_friction_that_is_off_by_a_tenth_fails(monkeypatch: pytest.MonkeyPatch, factor: float) -> None:
    alpha = mpm.DruckerPrager.alpha.fget
    monkeypatch.setattr(mpm.DruckerPrager, "alpha", property(lambda self: factor * alpha(self)))
    assert verdicts("slope", slope.measure(cells=32))["acceleration at cells 32"] == "fail"


def gone(group: int) -> bool:
    """Whether nothing of a group of processes runs any more, after ten seconds at most."""
    for _ in range(200):
        told = []
        for path in Path("/proc").glob("[0-9]*/stat"):
            with contextlib.suppress(OSError):  # it has just ended
                told.append(path.read_text().rpartition(")")[2].split())
        if not any(int(words[2]) == group and words[0] != "Z" for words in told):
            return True
        time.sleep(0.05)
    return False


@pytest.mark.slow
@pytest.mark.parametrize("command", [["report", "free_fall", "spin", "--quick"], ["stability", "payload", "arm_pose"]])
def test_a_killed_report_goes_on(tmp_path: Path, command: list[str]) -> None:
    """SIGKILL after the first result; the same command keeps it, and ends with all of them."""
    kept = tmp_path / ("report.jsonl" if command[0] == "report" else "stability.json")
    words = [sys.executable, "-m", "robosim", *command, "--out", str(tmp_path)]
    process = subprocess.Popen(words, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL, start_new_session=True)
    while not kept.is_file():
        time.sleep(0.05)
    process.send_signal(signal.SIGKILL)
    process.wait()
    if sys.platform == "linux":
        assert gone(process.pid)
    before = kept.read_text()
    done = len(before.splitlines()) if command[0] == "report" else len(json.loads(before)["cells"])
    assert subprocess.run(words, capture_output=True, check=False).returncode == 0
    after = kept.read_text()
    if command[0] == "report":
        planned = module.planned(["free_fall", "spin"], quick=True)
        assert after.startswith(before) and len(after.splitlines()) == len(planned)
    else:
        cells = json.loads(after)["cells"]
        assert len(cells) == 11 and cells[:done] == json.loads(before)["cells"]


@pytest.mark.slow
def test_the_page_works_in_a_browser(tmp_path: Path) -> None:
    browser = shutil.which("chromium") or shutil.which("chromium-browser")
    if browser is None:
        pytest.skip("needs chromium")
    page = Page("sorts")
    page.add_table(["n"], [[3.0], [1.0], [2.0]])
    path = tmp_path / "index.html"
    path.write_text(page.html().replace("</script>", ';document.querySelector("th").click();</script>'))
    seen = subprocess.run([browser, "--headless", "--no-sandbox", "--dump-dom", path.as_uri()], capture_output=True,
                          text=True, timeout=60, check=True).stdout
    assert re.findall(r'data-value="([0-9.]+)"', seen) == ["1.0", "2.0", "3.0"]
