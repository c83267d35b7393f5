"""A rehearsal that only holds with an exact model says so; the worst of every figure is that of all runs."""

import json
from pathlib import Path
from typing import Any

import pytest
from study_stand_in import StandIn

from robosim.commands.main import main
from robosim.config.rehearsal import load_rehearsal
from robosim.rehearsal.metrics import get_bounds
from robosim.robot.model_errors import draw_model_errors
from robosim.studies.robustness import perturbed_runs
from robosim.studies.robustness.perturbed_runs import perturb

HELD = {name: bound.low if bound.low > 0.0 else 0.0 for name, bound in get_bounds(load_rehearsal("spoon")).items()}


def runs(missed: dict[int, tuple[str, float]], crashed: tuple[int, ...] = ()) -> StandIn:
    """Runs that are not made: reports by the seed of the errors."""

    def make_report(name: str, seed: int, options: dict[str, Any]) -> dict[str, Any]:
        if seed in crashed:
            raise RuntimeError("killed by signal 9")
        report: dict[str, Any] = {**HELD, "missed": [], "torque_limit_ratio_max": 0.3 + 0.01 * seed}
        if seed in missed:
            figure, value = missed[seed]
            report |= {figure: value, "missed": [f"{figure} = {value}; accepted: ..."]}
        return report | {"model_errors": draw_model_errors(seed, 7).figures() if seed else None}

    return StandIn(make_report)


@pytest.mark.parametrize(("missed", "status", "said"), [
    ({}, 0, "every bound held in 4 of 4 runs"),
    ({2: ("delivered_fraction", 0.7)}, 1, "holds only with the exact model: missed in 1 of 3 runs"),
    ({0: ("delivered_fraction", 0.8)}, 1, "missed with the exact model; missed in 0 of 3 runs with errors")])
def test_the_verdict_tells_exact_runs_from_those_with_errors(
        missed: dict[int, tuple[str, float]], status: int, said: str, tmp_path: Path,
        capsys: pytest.CaptureFixture[str]) -> None:
    assert perturb("spoon", tmp_path, 3, launcher=runs(missed)) == status and said in capsys.readouterr().out
    page = (tmp_path / "index.html").read_text()
    assert said in page and "0.33" in page  # the worst torque


def test_the_worst_is_the_largest_or_where_there_is_no_upper_bound_the_smallest() -> None:
    rows = {seed: {"delivered_fraction": delivered, "spilled_fraction": spilled}
            for seed, (delivered, spilled) in enumerate([(0.95, 0.0), (0.91, 0.02), (1.0, 0.01)])}
    bounds = get_bounds(load_rehearsal("spoon"))
    assert perturbed_runs.find_worst(rows, "delivered_fraction", bounds["delivered_fraction"]) == (0.91, 1)
    assert perturbed_runs.find_worst(rows, "spilled_fraction", bounds["spilled_fraction"]) == (0.02, 1)
    rows[2]["delivered_fraction"] = None  # of a run that scooped nothing
    assert perturbed_runs.find_worst(rows, "delivered_fraction", bounds["delivered_fraction"]) == (None, 2)


def test_finished_runs_are_kept_and_a_crash_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    first = runs({}, crashed=(2,))
    assert perturb("spoon", tmp_path, 3, launcher=first) == 1
    assert "no result with errors 2: killed by signal 9" in capsys.readouterr().err
    again = runs({})
    assert perturb("spoon", tmp_path, 4, launcher=again) == 0 and [one["seed"] for one in again.asked] == [2, 4]
    other = runs({})
    perturb("spoon", tmp_path, 1, launcher=other, options={"material": "sugar"})
    assert [one["seed"] for one in other.asked] == [0, 1]


def test_options_that_do_not_go_together_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["rehearse", "spoon", "--perturb", "2", "--model-errors", "3", "--out", str(tmp_path)]) == 2
    assert "--model-errors 3 with --perturb; accepted: without" in capsys.readouterr().err
    assert main(["rehearse", "spoon", "--jobs", "2", "--out", str(tmp_path)]) == 2
    assert "--jobs 2 without --perturb; accepted: with it" in capsys.readouterr().err
    assert main(["rehearse", "spoon", "--perturb", "2", "--motions", str(tmp_path), "--trajectory", "script", "--out",
                 str(tmp_path / "out")]) == 2
    assert "accepted: with --trajectory recorded" in capsys.readouterr().err and not (tmp_path / "out").exists()


def test_crashes_do_not_count_as_held(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert perturb("spoon", tmp_path / "a", 2, launcher=runs({}, crashed=(0,))) == 1
    assert "no result with the exact model; missed in 0 of 2 runs with errors; 1 without" in capsys.readouterr().out
    assert perturb("spoon", tmp_path / "b", 2, launcher=runs({}, crashed=(1, 2))) == 1
    assert "held with the exact model; no result with errors; 2 without" in capsys.readouterr().out


@pytest.mark.slow
def test_a_rehearsal_with_errors_is_another_one_and_says_which(tmp_path: Path) -> None:
    status = main(["rehearse", "shovel", "--perturb", "1", "--jobs", "2", "--out", str(tmp_path)])
    rows = json.loads((tmp_path / "perturbed.json").read_text())["rows"]
    assert status == int(any(row["missed"] for row in rows.values()))
    exact, drawn = rows["0"], rows["1"]
    assert exact["model_errors"] is None and drawn["model_errors"] == draw_model_errors(1, 7).figures()
    assert drawn["tool_tracking_error_max_m"] > exact["tool_tracking_error_max_m"]
