"""Tables of dosing episodes: error and its spread in g, success, time, spilled mass, beside the other controllers."""

import pytest

from robosim.dosing import CONTROLLERS
from robosim.studies.evaluation.evaluate import summarize as summarize_episodes
from robosim.studies.evaluation.suite_run import COMPARED, compared, format_summary, summarize
from robosim.tasks.task import load_task

ERRORS = {"pi": (0.1e-3, -0.3e-3), "open_loop": (5e-3, 3e-3)}
ROWS = [{"policy": policy, "episode": k, "return": 8.0, "tcs": 8.0, "is_success": abs(error) < 0.3e-3, "diverged": "",
         "dose_error": error, "dose_error_percent": 1e4 * error, "seconds": 12.0 + k, "spilled": 0.2e-3 * k}
        for policy, errors in ERRORS.items() for k, error in enumerate(errors)]


def test_a_suite_has_error_spread_time_and_spilled_mass() -> None:
    summary = summarize(ROWS)
    assert summary["pi"]["dose_error"]["mean"] == pytest.approx(-0.1e-3)
    assert summary["pi"]["dose_error"]["std"] == pytest.approx(0.2e-3)
    low, high = summary["open_loop"]["dose_error"]["interval"]
    assert low == pytest.approx(3e-3) and high == pytest.approx(5e-3)
    head, first, second = format_summary(summary).splitlines()
    assert head.split()[:2] == ["policy", "success"] and "spread [g]" in head and "spilled [g]" in head
    assert first.split()[-5:] == ["-0.10", "0.20", "12.5", "0.10", "2"] and first.startswith("pi ")
    assert second.split()[-5:] == ["4.00", "1.00", "12.5", "0.10", "2"]


def test_controllers_are_compared_with_each_other_where_a_task_has_their_numbers() -> None:
    assert compared(load_task("DoseSpoon")) == CONTROLLERS
    assert compared(load_task("SpoonPour")) == COMPARED


def test_an_evaluation_has_the_spread_of_the_error() -> None:
    rows = [{"seed": k, "return": 8.0, "tcs": 8.0, "tcs_terms": {}, "is_success": True, "diverged": None,
             "readings": {"dose_error": error, "seconds": 12.0}} for k, error in enumerate(ERRORS["open_loop"])]
    values = summarize_episodes("DoseSpoon", "pi", rows, 2)
    assert values["readings.dose_error"] == pytest.approx(4e-3)
    assert values["readings.dose_error_std"] == pytest.approx(1e-3) and "readings.seconds_std" not in values
