"""One motion among many materials."""

import json

import pytest

from robosim.config.materials import law_of, load_material, overridden
from robosim.envs import TASKS
from robosim.errors import UnknownName
from robosim.evaluation import materials as command
from robosim.evaluation.material_episode import MATERIALS, OWN, run_episode
from robosim.evaluation.material_tables import format_table, make_rows
from robosim.tasks.task import load_task


def test_thirteen_materials_that_the_sub_tasks_can_step():
    from mpm.materials.stable_step import material_bound

    laws = [law_of(overridden(load_material(base), numbers)) for base, numbers in MATERIALS.values()]
    assert len(laws) == len({repr(law) for law in laws}) == 13
    for task in map(load_task, TASKS):
        assert all(material_bound(task.field.cell, law) > task.field.dt for law in laws)


@pytest.mark.slow
def test_in_its_own_material_a_motion_does_not_deviate():
    """And in a smoother one it does; a carried load arrives in both."""
    assert load_task("SpoonTranslate").material == "salt"
    played = {called: run_episode("SpoonTranslate", "learned", called)
              for called in (OWN, "salt", "salt, 10 deg smoother")}
    rows = make_rows({**dict.fromkeys(MATERIALS, played["salt"]), **played})
    assert rows["salt"]["td_mm"] == 0.0 and 0.0 < rows["salt, 10 deg smoother"]["td_mm"] < 10.0
    for called in ("salt", "salt, 10 deg smoother"):
        assert rows[called]["score"] == pytest.approx(41.0) and rows[called]["delivered"] == 1.0


def answer(score: float, trajectory: list[list[float]], diverged: str | None = None) -> dict:
    return {"score": score, "trajectory": trajectory, "diverged": diverged, "delivered": 1.0, "spilled": 0.0,
            "collisions": None}


def test_deviation_is_the_mean_distance_as_far_as_both_go():
    way = [[0.0, 0.0, 0.1], [0.1, 0.0, 0.1]]
    played = {**dict.fromkeys(MATERIALS, answer(2.0, way)), OWN: answer(1.0, way),
              "sugar": answer(2.0, [[0.0, 0.003, 0.1], [0.1, 0.0, 0.101]]),
              "flour": answer(2.0, [[0.0, 0.003, 0.1]], "escaped"), "sand": answer(2.0, [], "at once")}
    rows = make_rows(played)
    assert list(rows) == list(MATERIALS) and rows["salt"]["td_mm"] == 0.0
    assert rows["sugar"]["td_mm"] == pytest.approx(2.0) and rows["flour"]["td_mm"] == pytest.approx(3.0)
    assert rows["sand"]["td_mm"] is None and "2.0 (-)" in format_table(["SpoonPour"], {"SpoonPour": rows})


def test_what_was_played_is_kept(tmp_path, monkeypatch, capsys):
    """An episode that fails is named and the others stay; another motion is played anew."""
    asked, killed = [], ["SpoonPour", "learned", "flour"]

    def answers(work, jobs):
        for place, (_, words) in enumerate(work):
            asked.append(words)
            yield (place, None, "killed by signal 9") if words == killed else (place, answer(1.0, [[0.0] * 3]), "")

    monkeypatch.setattr(command, "run_jobs", answers)
    tasks = ["SpoonTranslate", "SpoonPour", "SpoonPour"]
    assert command.materials(tasks, tmp_path) == 1
    assert "SpoonPour in flour: killed by signal 9" in capsys.readouterr().err and len(asked) == 28
    assert len(json.loads((tmp_path / "materials.json").read_text())["rows"]) == 13
    killed = []
    assert command.materials(tasks, tmp_path) == 0
    assert asked[28:] == [["SpoonPour", "learned", "flour"]]
    assert len(json.loads((tmp_path / "materials.json").read_text())["rows"]) == 26
    assert (tmp_path / "materials.png").stat().st_size > 10_000 and "1.0 (0.0)" in capsys.readouterr().out
    assert len((tmp_path / "materials.csv").read_text().splitlines()) == 27
    command.materials(["SpoonPour"], tmp_path, name="scripted")
    assert len(asked) == 29 + 14 and asked[29][:2] == ["SpoonPour", "scripted"]


@pytest.mark.parametrize("tasks, name, words", [
    (["Nothing"], "learned", "unknown task 'Nothing'"), (["SpoonPour"], "nobody", "unknown policy 'nobody'")])
def test_what_does_not_exist_is_said_before_any_work(tmp_path, tasks, name, words):
    with pytest.raises(UnknownName, match=words):
        command.materials(tasks, tmp_path / "out", name=name)
    assert not (tmp_path / "out").exists()
