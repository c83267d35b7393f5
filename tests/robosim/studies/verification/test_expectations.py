"""Expectations of the verification cases: they can fail, of planted errors, too; a whole report measures each."""

from collections.abc import Callable

import numpy as np
import pytest

import mpm
from robosim.studies.verification.cases import NAMES, find
from robosim.studies.verification.cases.case import Record
from robosim.studies.verification.cases.expectations import Approach, Order, Power, Ratio, Slope, Within, judge
from robosim.studies.verification.runs import pareto_front, time_to_error


def record(error: float = 0.0, readings: dict[str, float] | None = None, **choices) -> Record:
    return Record(case="bar", choices=choices, particles=1, steps=1, seconds=1.0, compile_seconds=0.0,
                  errors={"rms": error}, readings=readings or {})


@pytest.mark.parametrize(("kind", "y", "found"), [(Power, lambda x: 3.0 * x**1.5, 1.5),
                                                  (Slope, lambda x: 3.0 * x - 1.0, 3.0)])
def test_powers_and_slopes_are_fitted_to_all_runs(kind: type, y: Callable[[float], float], found: float) -> None:
    """Within a tenth they pass, above it they fail; one run, or several of one x, do not measure them."""
    records = [record(readings={"x": x, "y": y(x)}) for x in (0.5, 1.0, 4.0)]
    assert kind("y", "x", found - 0.1, found + 0.1).evaluate(records).found == pytest.approx(found)
    assert [kind("y", "x", found + d, 9.0).evaluate(records).verdict for d in (-0.1, 0.1)] == ["pass", "fail"]
    assert kind("y", "x", 0.0, 9.0).evaluate([records[0], records[0]]).verdict == "not run"


def test_a_range_without_a_lower_end_checks_every_run() -> None:
    claim = Within("rms", 0.02, low=-np.inf)
    assert claim.evaluate([record(-5.0), record(0.01)]).verdict == "pass"
    assert claim.evaluate([record(0.001), record(0.5), record(-5.0)]).found == 0.5
    assert claim.evaluate([record(0.001), record(float("nan"))]).verdict == "fail"


def test_claims_are_evaluated_by_the_worst_run() -> None:
    records = [record(0.01, cells=10), record(-0.03, cells=10, precision="f32"), record(0.0025, cells=20)]
    assert Within("rms", 0.02, {"cells": 10}).evaluate(records).found == -0.03
    assert Within("rms", 0.02, {"cells": 10}).evaluate(records).verdict == "fail"
    assert Within("rms", 0.02, {"cells": 20}).evaluate(records).verdict == "pass"
    assert Within("rms", 0.02, {"cells": 40}).evaluate(records).verdict == "not run"
    assert Within("rms", 0.02, {"cells": 50}).evaluate([record(np.nan, cells=50)]).verdict == "fail"


def test_orders_are_evaluated() -> None:
    second = Order("rms", "cells", (10, 20), 1.9).evaluate([record(0.01, cells=10), record(0.0025, cells=20)])
    assert second.found == pytest.approx(2.0) and second.verdict == "pass"
    halved = [record(0.04, cell=0.2), record(0.01, cell=0.1)]
    assert Order("rms", "cell", (0.2, 0.1), 2.1).evaluate(halved).verdict == "fail"


def test_an_approach_keeps_its_sign_and_falls_at_every_refinement() -> None:
    """An error that passes zero fails, though its magnitude falls; so does one that rises between two runs."""
    def found(*errors: float) -> tuple[float | None, str]:
        claim = Approach("rms", "cells", (12, 16, 24))
        finding = claim.evaluate([record(error, cells=n) for error, n in zip(errors, (12, 16, 24))])
        return finding.found, finding.verdict

    assert found(-0.08, -0.04, -0.02) == (pytest.approx(0.5), "pass")
    assert found(-0.08, -0.04, 0.02) == (pytest.approx(-0.5), "fail")
    assert found(-0.08, 0.02, 0.01) == (pytest.approx(-0.25), "fail")
    assert found(0.08, 0.1, 0.05) == (pytest.approx(1.25), "fail") and found(-0.08, -0.04) == (None, "not run")
    assert found(0.0, 0.0, 0.0)[1] == found(0.0, 0.1, 0.05)[1] == "fail"
    both = [record(0.4, cells=10, E=1.0), record(0.1, cells=10, E=2.0), record(0.2, cells=20, E=1.0)]
    assert Approach("rms", "cells", (10, 20)).evaluate(both).verdict == "fail"
    assert Approach("rms", "cells", (10, 20), {"E": 1.0}).evaluate(both).verdict == "pass"


def test_a_ratio_compares_two_ends() -> None:
    """0.02 over 0.01; a run at neither end does not count, and without one of the ends nothing is measured."""
    runs = [record(0.01, speed=0.01), record(5.0, speed=0.05), record(0.02, speed=0.1)]
    assert Ratio("rms", "speed", (0.01, 0.1), 0.9, 2.1).evaluate(runs).found == pytest.approx(2.0)
    assert Ratio("rms", "speed", (0.01, 0.1), 0.9, 1.1).evaluate(runs).verdict == "fail"
    assert Ratio("rms", "speed", (0.01, 0.1), 0.9, 1.1).evaluate(runs[:2]).verdict == "not run"


def test_pareto_front_and_time_to_an_error() -> None:
    """By hand: 1 % is halfway, in logarithms, between 4 % in 1 s and 0.25 % in 4 s."""
    assert pareto_front([(1.0, 0.04), (2.0, 0.05), (4.0, 0.0025), (0.5, 0.5)]) == [3, 0, 2]
    assert time_to_error(0.01, [(1.0, 0.04), (4.0, 0.0025)]) == pytest.approx(2.0)
    assert time_to_error(0.001, [(1.0, 0.04), (4.0, 0.0025)]) is None


@pytest.mark.parametrize("name", NAMES)
def test_a_whole_report_measures_every_expectation(name: str) -> None:
    """A sweep has the runs that an expectation is limited to; otherwise it would stay "not run" in every report."""
    case = find(name)
    assert case.name == name and case.source and case.quick and case.expectations
    assert case.resolution is None or case.resolution in case.defaults
    runs = [case.defaults | choices for choices in case.sweep]
    for one in case.expectations:
        assert one.evaluate([]).verdict == "not run"
        ends = [{one.resolution: end} for end in one.ends] if isinstance(one, Order | Ratio | Approach) else [{}]
        for where in ({**one.where, **end} for end in ends):
            matching = [choices for choices in runs if where.items() <= choices.items()]
            assert matching, f"{one}: no run at {where}"


def verdicts(name: str, **choices) -> dict[str, str]:
    case = find(name)
    return {finding.claim: finding.verdict for finding in judge(case, [case(**choices)])}


@pytest.mark.long
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
