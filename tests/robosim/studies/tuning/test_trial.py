"""Episodes of a trial with an environment that is made up: which are run, and when they are written."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import yaml
from pouring_plant import SALT, VIBRATION

from robosim.studies.tuning import trial
from robosim.studies.tuning.trial import TrialJob, run_trial

DOSE = SimpleNamespace(tolerance_percent=5.0, tolerance_g=0.3)
READINGS = {"target_mass": 10e-3, "poured": 10.2e-3, "dose_error": 0.2e-3, "overshoot": 0.2e-3, "spilled": 0.0}


class Environment:
    """Ends each episode after three steps; keeps the seeds, and what the file holds as each begins."""

    def __init__(self, path: Path, fails: int | None = None) -> None:
        self.task, self.path, self.fails = SimpleNamespace(dose=DOSE), path, fails
        self.seeds: list[int] = []
        self.stored: list[list[int]] = []
        self.is_closed = False

    def reset(self, seed: int) -> None:
        if seed == self.fails:
            raise RuntimeError("killed")
        self.seeds.append(seed)
        self.stored.append([row["seed"] for row in json.loads(self.path.read_text())] if self.path.is_file() else [])
        self.steps = 0

    def step(self, action: float) -> tuple[Any, ...]:
        self.steps += 1
        readings = READINGS | {"seconds": 2.0 * self.steps}
        return None, 0.0, self.steps == 3, False, {"readings": readings, "is_success": True, "diverged": ""}

    def close(self) -> None:
        self.is_closed = True


@pytest.fixture
def job(tmp_path: Path) -> TrialJob:
    numbers = tmp_path / "numbers.yaml"
    numbers.write_text(yaml.safe_dump({"task": "Mine", "tool": "spoon", "curve": SALT.model_dump(mode="json"),
                                       "vibration": VIBRATION}))
    return TrialJob("Mine", "pi", str(numbers), str(tmp_path / "episodes.json"), 7, 4, "salt", "nominal")


def use(monkeypatch: pytest.MonkeyPatch, env: Environment) -> Environment:
    monkeypatch.setattr(trial, "load_task", lambda name: None)
    monkeypatch.setattr(trial, "make_environment", lambda task, start, obs: env)
    monkeypatch.setattr(trial, "DosingPolicy", lambda name, env, numbers: lambda: 0.0)
    return env


def test_each_episode_is_written_as_it_ends(monkeypatch: pytest.MonkeyPatch, job: TrialJob) -> None:
    env = use(monkeypatch, Environment(Path(job.episodes)))
    rows = run_trial(job)
    assert env.seeds == [7, 8, 9, 10] and env.stored == [[], [7], [7, 8], [7, 8, 9]] and env.is_closed
    assert rows == json.loads(Path(job.episodes).read_text())
    assert rows[0] == READINGS | {"seed": 7, "is_success": True, "diverged": "", "seconds": 6.0,
                                  "accepted_error": pytest.approx(0.5e-3)}


def test_episodes_that_the_file_has_are_not_run_again(monkeypatch: pytest.MonkeyPatch, job: TrialJob) -> None:
    use(monkeypatch, Environment(Path(job.episodes), fails=9))
    with pytest.raises(RuntimeError, match="killed"):
        run_trial(job)
    again = use(monkeypatch, Environment(Path(job.episodes)))
    rows = run_trial(job)
    assert again.seeds == [9, 10] and [row["seed"] for row in rows] == [7, 8, 9, 10]
    none = use(monkeypatch, Environment(Path(job.episodes)))
    assert run_trial(job) == rows and none.seeds == []
