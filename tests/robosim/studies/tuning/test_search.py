"""Tuning: choices of numbers, their search, and pour curves."""

import json
import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from pouring_plant import SALT, VIBRATION, Dose, Plant, shifted
from study_stand_in import StandIn

from robosim.base.errors import ConfigError
from robosim.dosing import CONTROLLERS
from robosim.dosing.command import accepted_error
from robosim.dosing.controllers import make_controller
from robosim.dosing.numbers import DosingNumbers, load_dosing
from robosim.dosing.pour_curve import PourCurve
from robosim.studies.tuning import search, trial
from robosim.studies.tuning.curve import STEP_DEG, mean_curve
from robosim.studies.tuning.search import GENERATION, RANGES, Range, draw_choice
from robosim.studies.tuning.trial import WORST, episode_cost, summarize_doses

CLUMSY = DosingNumbers.model_validate({"task": "Mine", "tool": "spoon", "curve": SALT, "vibration": VIBRATION,
                                       "open_loop": {"share": 1.4}})
"""An open loop that pours 40 % too much of what its curve was measured with."""
TASK = SimpleNamespace(material="salt", model_dump=lambda **_: {"steps": 10})


class Processes(StandIn):
    """In place of processes: each choice runs on the plant; one of them may fail, and Ctrl-C may come."""

    def __init__(self, fails: int = -1, interrupted: int = -1) -> None:
        super().__init__(self._run)
        self.fails, self.interrupted = fails, interrupted

    def _run(self, search: dict[str, Any], numbers: dict[str, Any], seed: int, count: int) -> list[dict[str, Any]]:
        if len(self.asked) - 1 == self.interrupted:
            raise KeyboardInterrupt
        if len(self.asked) - 1 == self.fails:
            raise RuntimeError("killed by signal 9")
        return [self._episode(DosingNumbers.model_validate(numbers), search["controller"], seed + k)
                for k in range(count)]

    @staticmethod
    def _episode(numbers: DosingNumbers, controller: str, seed: int) -> dict[str, Any]:
        target = (5e-3, 20e-3, 45e-3)[seed % 3]
        dose = Dose(make_controller(controller, numbers, Plant.dt), Plant(shifted(SALT, 0.0), seed), target)
        return {"seed": seed, "is_success": abs(dose.error) < 0.3e-3, "diverged": "", "target_mass": target,
                "accepted_error": accepted_error(target), "poured": target + dose.error, "dose_error": dose.error,
                "overshoot": max(dose.error, 0.0), "seconds": dose.seconds, "spilled": 0.0}


@pytest.fixture
def tune(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Any:
    """Return a function that runs a search of CLUMSY in a folder and returns exit status and the stored search."""
    def run(processes: Processes, numbers: DosingNumbers = CLUMSY, **more: Any) -> tuple[int, dict[str, Any]]:
        monkeypatch.setattr(search, "load_task", lambda name: TASK)
        monkeypatch.setattr(search, "numbers_of", lambda task, name: numbers)
        options = search.SearchOptions(**{"choices": 20, "episodes": 3} | more)
        status = search.tune("Mine", "open_loop", tmp_path / "out", options, launcher=processes)
        return status, json.loads((tmp_path / "out" / "tune.json").read_text())

    return run


def test_a_search_improves_on_the_given_numbers(tune: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, stored = tune(Processes())
    costs = [one["figures"]["cost"] for one in stored["choices"]]
    assert status == 0 and stored["is_complete"] and len(costs) == 20
    assert stored["best"] == min(range(20), key=costs.__getitem__) and costs[stored["best"]] < 0.6 * costs[0]
    best = load_dosing(str(tmp_path / "out" / "numbers.yaml"))
    assert best.open_loop == DosingNumbers.model_validate(stored["choices"][stored["best"]]["numbers"]).open_loop
    assert best.open_loop.share < 1.4 and best.curve == CLUMSY.curve
    assert "(given)" in capsys.readouterr().out


@pytest.mark.long
def test_a_search_that_was_interrupted_goes_on_to_the_same_end(tune: Any, tmp_path: Path) -> None:
    _, whole = tune(Processes())
    shutil.rmtree(tmp_path / "out")
    with pytest.raises(KeyboardInterrupt):
        tune(Processes(interrupted=9))
    rest = Processes()
    status, stored = tune(rest)
    assert status == 0 and len(rest.asked) == 11
    assert [one["numbers"] for one in stored["choices"]] == [one["numbers"] for one in whole["choices"]]


def test_a_process_that_fails_is_an_exit_status_and_runs_again(tune: Any, capsys: pytest.CaptureFixture[str]) -> None:
    status, stored = tune(Processes(fails=2))
    assert status == 1 and not stored["is_complete"]
    assert "failed: choice 2: killed by signal 9" in capsys.readouterr().err
    again = Processes()
    assert tune(again)[0] == 0 and len(again.asked) == 1 + 13


def test_more_choices_continue_a_search(tune: Any) -> None:
    tune(Processes(), choices=7)
    more = Processes()
    assert tune(more, choices=13)[0] == 0 and len(more.asked) == 6


@pytest.mark.parametrize("changed", [{"episodes": 4}, {"seed": 5}, {"randomize": "wide"}, {"material": "sugar"},
                                     {"numbers": CLUMSY.model_copy(update={"curve": shifted(SALT, 1.0)})}], ids=str)
def test_a_search_does_not_go_on_with_something_else(tune: Any, changed: dict[str, Any]) -> None:
    """Its choices are run from the first one on; those of the other search stay in the folder."""
    _, first = tune(Processes(), choices=2)
    other = Processes()
    assert tune(other, choices=2, **changed)[0] == 0 and len(other.asked) == 2
    again = Processes()
    assert tune(again, choices=2)[1]["choices"] == first["choices"] and again.asked == []


READINGS = {"target_mass": 10e-3, "poured": 10.2e-3, "dose_error": 0.2e-3, "overshoot": 0.2e-3, "spilled": 0.0}


class Environment:
    """Ends each episode after three steps; keeps the seeds, and how many files the folder has as each begins."""

    def __init__(self, path: Path, fails: int | None = None) -> None:
        self.task = SimpleNamespace(dose=SimpleNamespace(tolerance_percent=5.0, tolerance_g=0.3))
        self.path, self.fails, self.seeds, self.stored, self.is_closed = path, fails, list[int](), list[int](), False

    def reset(self, *, seed: int, options: None) -> tuple[None, dict[str, Any]]:
        if seed == self.fails:
            raise RuntimeError("killed")
        self.seeds.append(seed)
        self.stored.append(len(list(self.path.glob("*.json"))))
        self.steps = 0
        return None, {}

    def step(self, action: float) -> tuple[Any, ...]:
        self.steps += 1
        readings = READINGS | {"seconds": 2.0 * self.steps}
        return None, 0.0, self.steps == 3, False, {"readings": readings, "is_success": True, "diverged": ""}

    def close(self) -> None:
        self.is_closed = True


def run(path: Path) -> list[dict[str, Any]]:
    searched = {"task": "Mine", "controller": "pi", "material": "salt", "randomize": "nominal"}
    return trial.run_trial(searched, CLUMSY.model_dump(mode="json"), 7, 4, str(path))


def use(monkeypatch: pytest.MonkeyPatch, env: Environment) -> Environment:
    monkeypatch.setattr(trial, "load_task", lambda name: SimpleNamespace(receiver="receiver"))
    monkeypatch.setattr(trial, "make_environment", lambda task, start, obs: env)
    monkeypatch.setattr(trial, "DosingPolicy", lambda name, env, numbers: lambda observation: 0.0)
    return env


def test_each_episode_is_written_as_it_ends(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    env = use(monkeypatch, Environment(tmp_path))
    rows = run(tmp_path)
    assert env.seeds == [7, 8, 9, 10] and env.stored == [0, 1, 2, 3] and env.is_closed
    assert rows[0] == READINGS | {"seed": 7, "is_success": True, "diverged": "", "seconds": 6.0,
                                  "accepted_error": pytest.approx(0.5e-3)}


def test_episodes_that_the_folder_has_are_not_run_again(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    use(monkeypatch, Environment(tmp_path, fails=9))
    with pytest.raises(RuntimeError, match="killed"):
        run(tmp_path)
    again = use(monkeypatch, Environment(tmp_path))
    rows = run(tmp_path)
    assert again.seeds == [9, 10] and [row["seed"] for row in rows] == [7, 8, 9, 10]
    none = use(monkeypatch, Environment(tmp_path))
    assert run(tmp_path) == rows and none.seeds == []


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
