"""The pages of training runs and of demonstrations say first how they ended, whatever files there are."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from policies.results.pages import write_demonstration_page, write_run_page


def write_run(folder: Path, state: str, **status: object) -> None:
    folder.mkdir()
    (folder / "manifest.json").write_text(json.dumps({
        "method": "sac", "task": "SpoonPour", "seed": 3, "preset": {"gamma": 0.987}, "commit": "abc1234",
        "command": "robosim train sac SpoonPour", "code": {"mpm": "0"}}))
    (folder / "status.json").write_text(json.dumps({"state": state, "seconds": 90.0, **status}))
    for name, count in (("episodes.csv", 12), ("evaluations.csv", 2)):
        with (folder / name).open("w", newline="") as file:
            table = csv.DictWriter(file, ["episode", "return", "tcs", "delivered", "simulating", "updating"])
            table.writeheader()
            table.writerows({"episode": k + 1, "return": 10.0 * k, "tcs": 2.5 * k, "delivered": 0.1, "simulating": 0.5,
                             "updating": 1.0} for k in range(count))


def test_the_page_of_a_run_has_its_verdict_curves_and_configuration(tmp_path: Path) -> None:
    best = {"tcs": 41.25, "is_success": 1.0, "episodes": 1, "return": 88.0}
    write_run(tmp_path / "run", "finished", evaluated={"best": best})
    assert write_run_page(tmp_path / "run") == tmp_path / "run" / "index.html"
    text = (tmp_path / "run" / "index.html").read_text()
    assert '<p class="verdict pass">best policy without exploration: score 41.25' in text
    assert "robosim train sac SpoonPour" in text and "abc1234" in text and "0.987" in text
    for name in ("without exploration", "mean of 10", "share of the grains", "time of an episode [s]"):
        assert name in text


@pytest.mark.parametrize(("state", "reason"), [("failed", "every action is saturated"), ("interrupted", "Ctrl-C")])
def test_a_run_that_did_not_finish_says_why(state: str, reason: str, tmp_path: Path) -> None:
    write_run(tmp_path / "run", state, reason=reason)
    write_run_page(tmp_path / "run")
    assert f'<p class="verdict fail">{state} after 12 episodes: {reason}' in (tmp_path / "run/index.html").read_text()


def test_a_folder_without_a_run_gets_no_page(tmp_path: Path) -> None:
    assert write_run_page(tmp_path) is None and write_demonstration_page(tmp_path) is None
    assert not list(tmp_path.iterdir())


def test_the_page_of_demonstrations_counts_those_that_succeed_among_the_tasks_own_grains(tmp_path: Path) -> None:
    rows = []
    for k, success in enumerate((True, False)):
        np.savez(tmp_path / f"demonstration_{k}.npz", losses=np.array([3.0, 2.0, 1.0 + k]),
                 norms=np.array([[1.0, 0.0], [0.1, 0.0]]))
        scores = {"tcs": 40.0 - k, "is_success": success, "delivered": 1.0, "spilled": 0.0, "retained": 0.0}
        rows.append({"demonstration": f"demonstration_{k}.npz", "start": {"seed": k}, "loss": 1.0 + k, "iterations": 3,
                     "check": [[0.5, 0.51]], "in glycerol": {**scores, "is_success": True},
                     "among grains of salt": scores})
    (tmp_path / "demonstrations.json").write_text(json.dumps({
        "task": "SpoonPour", "material": "glycerol", "method": "descent", "demonstrations": rows}))
    write_demonstration_page(tmp_path)
    text = (tmp_path / "index.html").read_text()
    assert '<p class="verdict fail">1 of 2 succeed among grains of salt, mean score 39.50' in text
    assert "step of the rollout" in text and text.count("demonstration_1.npz") >= 4
