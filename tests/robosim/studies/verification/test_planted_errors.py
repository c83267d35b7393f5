"""Planted errors: each makes an expectation fail that passes without it."""

import pytest

import mpm
from robosim.studies.verification.cases import find
from robosim.studies.verification.cases.expectations import judge


def verdicts(name: str, **choices) -> dict[str, str]:
    """Verdicts on a run of a case."""
    case = find(name)
    return {finding.claim: finding.verdict for finding in judge(case, [case(**choices)])}


def test_a_scaled_reaction_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    """The ball receives nine tenths of the momentum that the particles lose."""
    whole = mpm.Solver.collider_impulse

    def scaled(self: mpm.Solver, *which, **about) -> mpm.Wrench:
        return mpm.Wrench(*(0.9 * part for part in whole(self, *which, **about)))

    monkeypatch.setattr(mpm.Solver, "collider_impulse", scaled)
    assert "fail" in verdicts("closed_system", precision="f32", material="sand").values()


@pytest.mark.slow
def test_a_wall_half_a_cell_off_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    """The bar starts half a cell from the wall that holds it."""
    box = mpm.sample_box
    choices = {"cells": 50, "courant": 0.2, "precision": "f64", "periods": 1}
    claim = "frequency at cells 50, courant 0.2, precision f64"
    assert verdicts("bar", **choices)[claim] == "pass"
    monkeypatch.setattr(mpm, "sample_box", lambda low, high, spacing: box(low, high, spacing) + [spacing, 0, 0])
    assert verdicts("bar", **choices)[claim] == "fail"


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.9, 1.1])
def test_friction_wrong_by_a_tenth_fails(monkeypatch: pytest.MonkeyPatch, factor: float) -> None:
    alpha = mpm.DruckerPrager.alpha.fget
    monkeypatch.setattr(mpm.DruckerPrager, "alpha", property(lambda self: factor * alpha(self)))
    assert verdicts("slope", cells=32)["acceleration at cells 32"] == "fail"
