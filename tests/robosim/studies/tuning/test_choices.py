"""Choices of a search, within their ranges and around the best so far; costs; the mean of measured pour curves."""

import numpy as np
import pytest

from robosim.base.errors import ConfigError
from robosim.dosing import CONTROLLERS
from robosim.dosing.numbers import DosingNumbers
from robosim.dosing.pour_curve import PourCurve
from robosim.studies.tuning.curve import STEP_DEG, mean_curve
from robosim.studies.tuning.search import GENERATION, RANGES, Range, draw_choice
from robosim.studies.tuning.trial import WORST, episode_cost, summarize_doses

NUMBERS = DosingNumbers.model_validate({
    "task": "Mine", "tool": "spoon", "vibration": {"amplitude": 5e-4, "frequency": 50},
    "curve": {"material": "salt", "load": 0.05, "rate_deg": 4, "tilts_deg": [20, 60], "masses": [0, 0.05],
              "source": "made up for tests"}})
ROW = {"target_mass": 10e-3, "accepted_error": 0.3e-3, "dose_error": 0.3e-3,
       "spilled": 0.0, "seconds": 10.0, "is_success": True, "diverged": ""}


@pytest.mark.parametrize("name", CONTROLLERS)
def test_every_number_of_a_controller_is_searched_around_its_default(name: str) -> None:
    own = getattr(NUMBERS, name)
    assert set(RANGES[name]) == set(type(own).model_fields) - {"lag"}
    for key, one in RANGES[name].items():
        assert one.low <= getattr(own, key) <= one.high, key
        assert one.value(one.place(getattr(own, key))) == pytest.approx(getattr(own, key), rel=1e-3)


def test_places_of_a_range() -> None:
    one = Range(0.01, 100.0)
    assert one.value(0.5) == pytest.approx(1.0) and one.place(1.0) == pytest.approx(0.5)
    assert (one.value(-3.0), one.value(3.0)) == (0.01, 100.0)
    # values outside are at the ends
    assert Range(2.0, 30.0).place(0.0) == Range(-1.0, 2.0, False).place(-5.0) == 0.0
    assert Range(2.0, 30.0).place(31.0) == 1.0


@pytest.mark.parametrize("fast_deg", [0.5, 3.0])
def test_rates_of_choices_are_those_that_the_tool_may_have(fast_deg: float) -> None:
    """Also below the ranges, and from an angle of 0, which has no logarithm."""
    own = {"search_deg": fast_deg, "fastest_deg": fast_deg, "before_deg": 0.0}
    slow = DosingNumbers.model_validate(NUMBERS.model_dump() | {"motion": {"fast_deg": fast_deg}, "pi": own})
    for k in range(1, 40):
        drawn = draw_choice("pi", slow, k, 0, {}, [slow]).pi
        assert max(drawn.search_deg, drawn.fastest_deg) <= fast_deg
        assert RANGES["pi"]["before_deg"].low <= drawn.before_deg


@pytest.mark.parametrize("name", CONTROLLERS)
def test_choices_lie_within_their_ranges_and_are_numbers_of_a_file(name: str) -> None:
    choices = [NUMBERS]
    for k in range(1, 40):
        choices.append(draw_choice(name, NUMBERS, k, 0, {}, choices))
        for key, one in RANGES[name].items():
            assert one.low <= getattr(getattr(choices[-1], name), key) <= one.high
        others = {n: getattr(choices[-1], n) for n in CONTROLLERS if n != name}
        assert others == {n: getattr(NUMBERS, n) for n in others}


def test_a_choice_depends_on_earlier_generations_alone() -> None:
    choices = [NUMBERS]
    costs = {0: 3.0}
    for k in range(1, 1 + 2 * GENERATION):
        before = draw_choice("pi", NUMBERS, k, 0, costs, choices)
        own = (k - 1) // GENERATION * GENERATION + 1  # the first of its generation
        with_own = draw_choice("pi", NUMBERS, k, 0, costs | dict.fromkeys(range(own, k), 0.0), choices)
        assert before == with_own
        choices.append(before)
        costs[k] = 2.0 + abs(k - 4)
    assert draw_choice("pi", NUMBERS, 7, 1, costs, choices) != choices[7]


def test_later_choices_come_closer_to_the_best() -> None:
    choices, costs = [NUMBERS], {0: 1.0}
    for k in range(1, 61):
        choices.append(draw_choice("shaker", NUMBERS, k, 0, costs, choices))
        costs[k] = 2.0
    places = np.array([[one.place(getattr(c.shaker, key)) for key, one in RANGES["shaker"].items()] for c in choices])
    away = np.abs(places - places[0]).mean(axis=1)
    assert away[-GENERATION:].mean() < 0.4 * away[1:1 + GENERATION].mean()


@pytest.mark.parametrize(("changed", "cost"), [
    ({}, 1.0), ({"dose_error": -0.6e-3, "spilled": 0.3e-3}, 3.0), ({"dose_error": 5e-3}, WORST),
    ({"accepted_error": 0.6e-3}, 0.5), ({"accepted_error": 0.0, "dose_error": 0.0}, 0.0),
    ({"accepted_error": 0.0, "dose_error": 1e-6}, WORST)])
def test_the_cost_of_an_episode(changed: dict[str, float], cost: float) -> None:
    """In accepted errors, 0.3 g of 10 g are one, and for its time; one that diverged costs most."""
    assert episode_cost(ROW | changed, 20.0) == pytest.approx(cost + 0.25)
    worst = ROW | {"dose_error": 1.0, "spilled": 1.0, "seconds": 20.0}
    assert episode_cost(ROW | changed | {"diverged": "it did"}, 20.0) >= episode_cost(worst, 20.0)


def test_figures_of_episodes() -> None:
    figures = summarize_doses([ROW, ROW | {"dose_error": -0.1e-3, "is_success": False}], 20.0)
    assert figures["error_g"] == pytest.approx(0.1) and figures["error_g_std"] == pytest.approx(0.2)
    assert figures["error_g_abs"] == pytest.approx(0.2) and figures["success_rate"] == 0.5


def ramp(begin: float, end: float, mass: float, last: float = 100.0) -> list[tuple[float, float]]:
    """Return points of a run that pours a mass [kg] evenly between two tilts [deg]."""
    return [(float(t), float(mass * np.clip((t - begin) / (end - begin), 0.0, 1.0))) for t in np.arange(0.5, last, 0.5)]


def test_the_mean_of_two_runs_lies_between_them() -> None:
    tilts, masses = mean_curve([ramp(20.0, 60.0, 0.04), ramp(30.0, 70.0, 0.02)], 100.0)
    assert (tilts[0], tilts[-1]) == (20.0, 70.0) and np.diff(tilts) == pytest.approx(STEP_DEG)
    assert masses[0] == 0.0 and masses[-1] == pytest.approx(0.03)
    assert masses[tilts.index(50.0)] == pytest.approx((0.03 + 0.01) / 2.0, abs=1e-5)


def test_a_mean_is_a_pour_curve_also_where_a_grain_comes_back() -> None:
    points = ramp(20.0, 60.0, 0.04)
    points[90] = (points[90][0], points[90][1] - 2e-3)
    tilts, masses = mean_curve([points], 100.0)
    curve = PourCurve(material="salt", load=0.04, rate_deg=4.0, tilts_deg=tuple(tilts), masses=tuple(masses),
                      source="made up for tests")
    assert np.all(np.diff(masses) >= 0.0) and curve.mass(np.radians(30.0)) == pytest.approx(0.01, abs=2e-5)


def test_runs_that_are_refused() -> None:
    with pytest.raises(ConfigError, match="episode 1 has no tilt: the lip was not above the cup in time; accepted: "):
        mean_curve([ramp(20.0, 60.0, 0.04), []], 100.0)
    wrapped = [(170.0, 0.01), (179.9, 0.02), (-179.9, 0.02)]
    with pytest.raises(ConfigError, match="episode 0: a tilt of -179.9 deg after 179.9 deg; accepted: rising"):
        mean_curve([wrapped], 180.0)
