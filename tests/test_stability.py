"""Stiff and extreme cases behave or refuse, as defined in `robosim.stability`."""

import warnings

import numpy as np
import pytest

import mpm
from robosim.stability import AXES, Verdict, run_matrix

QUICK = [("friction_angle_deg", 0.0), ("drop_height", 5.0), ("lone_grain", "corner"), ("degenerate", "inverted")]


def judged(axis: str, value: float | str) -> Verdict:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mpm.StrongCompression)
        return AXES[axis][0](value)


@pytest.mark.parametrize(("axis", "value"), QUICK)
def test_extreme_cell_is_stable(axis: str, value: float | str) -> None:
    verdict = judged(axis, value)
    assert verdict.verdict == "stable", verdict


@pytest.mark.parametrize("number", [0.8, 1.0])
def test_steps_above_the_bound_are_refused_with_both_numbers(number: float) -> None:
    verdict = judged("courant", number)
    assert verdict.verdict == "refused" and "above the bound 0.0003873 s" in verdict.reason


@pytest.mark.slow
@pytest.mark.parametrize(("axis", "value"), [(axis, value) for axis in AXES for value in AXES[axis][1]])
def test_every_cell_is_stable_or_refused(axis: str, value: float | str) -> None:
    verdict = judged(axis, value)
    refused = axis == "courant" and value > 0.734
    assert verdict.verdict == ("refused" if refused else "stable"), verdict


def test_unstable_cells_fail_the_command(monkeypatch: pytest.MonkeyPatch, tmp_path) -> None:
    broken = Verdict("lone_grain", "free", "unstable", "made up")
    monkeypatch.setitem(AXES, "lone_grain", (lambda value: broken, ("free",)))
    assert run_matrix(["lone_grain"], tmp_path) == 1
    assert "made up" in (tmp_path / "stability.json").read_text()


def test_series_gives_way_to_eigenvalues_at_large_strain() -> None:
    """Squeezed to 70 % the series is 1e-5 off: the solver takes the eigenvalues, and the series again at rest."""
    cell = 0.01
    positions = mpm.sample_box((0, 0, 0), (0.04, 0.04, 0.04), cell / 2)
    rollers = mpm.Walls(lower=("roller",) * 3, upper=("roller",) * 3)
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.04, 0.04, 0.06), cell), walls=rollers, gravity=(0, 0, 0),
                        bodies=[mpm.Body(mpm.Elastic(E=1e5, nu=0.3, density=1500.0), positions, volume=1.25e-7)])
    assert solver.integrator == "series"
    state = solver.state()
    squeezed = state["e"].copy()
    squeezed[:, 2] = 0.7**2 - 1
    solver.load(state | {"e": squeezed})
    solver.advance(solver.dt)
    assert solver.integrator == "exact"
    solver.load(state | {"e": np.zeros_like(squeezed)})
    solver.advance(solver.dt)
    assert solver.integrator == "series"
