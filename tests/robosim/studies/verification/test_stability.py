"""Stiff and extreme cases are stable or refused, as defined in `robosim.studies.verification.stability`."""

import json
from dataclasses import replace

import numpy as np
import pytest
from study_stand_in import StandIn

import mpm
from robosim.studies.verification.cases.case import Cost, make_record
from robosim.studies.verification.stability import field
from robosim.studies.verification.stability.field import AXES, run_cell
from robosim.studies.verification.stability_report import stability

REFUSED = {("courant", 1.1), ("courant", 1.5), ("arm_host_step", 5e-3), ("arm_host_step", 1e-2),
           ("arm_pose", "stretched"), ("arm_pose", "near a limit"),
           ("arm_pose", "beyond reach")}
"""Cells that are refused with the bound and the value; all others are stable."""
QUICK = [("friction_angle_deg", 0.0), ("drop_height", 5.0), ("degenerate", "inverted"),
         ("arm_host_step", 2e-3), ("payload", 60.0), ("arm_pose", "wrist aligned"),
         ("rest", "0.75 x 4"), ("rest", "E 1e4 Pa")]


@pytest.mark.parametrize("number", [1.1, 1.5])
def test_steps_above_the_bound_are_refused_with_both_numbers(number: float) -> None:
    result = run_cell("courant", number)
    assert result.verdict == "refused" and "above the bound 0.0005358 s" in result.reason


def test_a_plate_must_stay_within_the_bands_of_its_case(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = field.lock_gate
    for errors, verdict in (({"force": 0.01, "torque": 0.02, "crossed": 0.0}, "stable"),
                            ({"force": -0.05, "torque": 0.02, "crossed": 0.1}, "unstable")):
        record = make_record([Cost(1, 1, 1.0)], errors)
        monkeypatch.setattr(field, "lock_gate", replace(whole, simulate=lambda record=record, **choices: record))
        result = run_cell("shell_thickness", 0.5)
        assert result.verdict == verdict
    assert result.reason == "force off by -5.00%, crossed off by 10.00%"


@pytest.mark.parametrize(("axis", "value"), [
    pytest.param(axis, value, marks=[pytest.mark.slow] * ((axis, value) not in QUICK))
    for axis in AXES for value in AXES[axis][1]])
def test_every_cell_is_stable_or_refused(axis: str, value: float | str) -> None:
    result = run_cell(axis, value)
    assert result.verdict == ("refused" if (axis, value) in REFUSED else "stable"), result


def test_unstable_cells_fail_the_command(monkeypatch: pytest.MonkeyPatch, tmp_path) -> None:
    """A cell whose process ends without a result is unstable, with its last line on stderr; finished cells are kept."""
    monkeypatch.setitem(AXES, "payload", (AXES["payload"][0], (1.0, "heavy")))
    assert stability(["payload"], tmp_path) == 1
    cells = json.loads((tmp_path / "stability.json").read_text())["cells"]
    assert [cell["verdict"] for cell in cells] == ["stable", "unstable"] and "TypeError" in cells[1]["reason"]
    page = (tmp_path / "index.html").read_text()
    assert 'class="unstable" title=' in page and "1 stable, 0 refused, 1 unstable" in page
    again = StandIn(lambda axis, value: cells[0])
    assert stability(["payload"], tmp_path, launcher=again) == 0
    assert again.asked == [{"axis": "payload", "value": "heavy"}]  # without a result: again


@pytest.mark.slow
def test_auto_uses_eigenvalues_outside_the_range_of_the_series() -> None:
    """Compressed to 60 % the series is wrong by 1e-4; for small strains it is used, with the same bits."""
    cell = 0.01
    positions = mpm.sample_box((0, 0, 0), (0.04, 0.04, 0.04), cell / 2)
    rollers = mpm.Walls.all("roller")
    ends = {}
    for integrator in ("series", "auto", "exact"):
        for stretch in (0.95, 0.6):
            material = mpm.VonMises(E=1e5, nu=0.3, density=1500.0, yield_stress=3e3)
            solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.04, 0.04, 0.06), cell), walls=rollers, gravity=(0, 0, 0),
                                bodies=[mpm.Body(material, positions, volume=1.25e-7)], integrator=integrator)
            state = solver.state()
            state["e"][:, 2] = stretch**2 - 1
            solver.load(state)
            solver.advance(solver.dt)
            ends[integrator, stretch] = solver.state()["e"].astype(float)
    assert (ends["auto", 0.95] == ends["series", 0.95]).all()
    assert (ends["auto", 0.6] == ends["exact", 0.6]).all()
    assert np.abs(ends["series", 0.6] - ends["exact", 0.6]).max() > 1e-5
