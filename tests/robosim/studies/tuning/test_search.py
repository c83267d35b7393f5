"""The search of numbers on a plain model of a tool that pours, and the episodes of a trial as they are stored."""

import json
import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from pouring_plant import SALT, VIBRATION, Dose, Plant, shifted
from study_stand_in import StandIn

from robosim.dosing.command import accepted_error
from robosim.dosing.controllers import make_controller
from robosim.dosing.numbers import DosingNumbers, load_dosing
from robosim.studies.tuning import search, trial

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
    monkeypatch.setattr(trial, "load_task", lambda name: None)
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
