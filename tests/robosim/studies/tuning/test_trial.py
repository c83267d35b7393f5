"""Episodes of a trial with an environment that is made up: which are run, and when they are written."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from pouring_plant import SALT, VIBRATION

from robosim.dosing.numbers import DosingNumbers
from robosim.studies.tuning import trial
from robosim.studies.tuning.trial import run_trial

DOSE = SimpleNamespace(tolerance_percent=5.0, tolerance_g=0.3)
READINGS = {"target_mass": 10e-3, "poured": 10.2e-3, "dose_error": 0.2e-3, "overshoot": 0.2e-3, "spilled": 0.0}


class Environment:
    """Ends each episode after three steps; keeps the seeds, and how many files the folder has as each begins."""

    def __init__(self, path: Path, fails: int | None = None) -> None:
        self.task, self.path, self.fails = SimpleNamespace(dose=DOSE), path, fails
        self.seeds: list[int] = []
        self.stored: list[int] = []
        self.is_closed = False

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


NUMBERS = DosingNumbers.model_validate({"task": "Mine", "tool": "spoon", "curve": SALT, "vibration": VIBRATION})
SEARCH = {"task": "Mine", "controller": "pi", "material": "salt", "randomize": "nominal"}


def run(path: Path) -> list[dict[str, Any]]:
    """Run four episodes from seed 7 on."""
    return run_trial(SEARCH, NUMBERS.model_dump(mode="json"), 7, 4, str(path))


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
