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


@pytest.mark.slow
def test_auto_takes_the_eigenvalues_where_the_series_ends() -> None:
    """Squeezed to 60 % the series is 1e-4 off; small strains are left to it, to the bit."""
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
