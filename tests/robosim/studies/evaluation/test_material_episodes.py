"""Bundled motions: their recorded scores against the paper's, and in their own and in other materials."""

import json
import math

import pytest
import yaml
from study_stand_in import StandIn

from mpm.materials.stable_step import accepted_bound
from robosim.base.resources import folder, trained
from robosim.config.materials import load_material, overridden
from robosim.envs import TASKS
from robosim.randomization.materials import MATERIALS
from robosim.randomization.randomization import Randomization
from robosim.randomization.ranges import MATERIAL
from robosim.studies.evaluation import materials as command
from robosim.studies.evaluation.materials import OWN, play_in_material
from robosim.tasks.task import TaskConfig, load_task

BUNDLED = [name for name in TASKS if trained(name)]
GRAINS = 0.015  # share of the counted grains by whose fate a score may differ from machine to machine


def recorded(name: str) -> dict:
    """The row of a motion in its own material, as `robosim materials` wrote it."""
    rows = json.loads(trained(name).with_name("materials.json").read_text())["rows"]
    return next(row for row in rows if row["task"] == name and row["material"] == load_task(name).material)


def score_of_grains(task: TaskConfig) -> float:
    """Score that the allowed share of grains is worth if it misses the target and is lost or not poured."""
    weights = task.model_dump()["reward"]
    return math.ceil(GRAINS * task.grains.counted) * (2 * weights["target"] + 2 * weights["poured"] - weights["lost"])


@pytest.mark.parametrize("name", BUNDLED)
def test_the_recorded_score_reaches_the_paper(name: str) -> None:
    """The mean of DG-SAC, less its standard deviation over five runs (arXiv 2406.09178)."""
    published = yaml.safe_load((folder("configs") / "published" / "arxiv_2406_09178.yaml").read_text())
    mean, deviation = published["tcs"]["dg_sac"][published["tasks"].index(name)]
    assert recorded(name)["score"] >= mean - deviation


@pytest.mark.slow
@pytest.mark.parametrize("name", BUNDLED)
def test_a_motion_earns_its_recorded_score(name: str) -> None:
    """From the nominal start, up to the fate of a few grains; without a collision where it scoops."""
    episode, row = play_in_material(name, "recorded", OWN), recorded(name)
    assert episode["score"] == pytest.approx(row["score"], abs=score_of_grains(load_task(name)))
    assert episode["delivered"] == pytest.approx(row["delivered"], abs=GRAINS + 1e-9)
    assert episode["collisions"] == row["collisions"] and episode["diverged"] is None


def test_the_time_step_suits_all_thirteen_materials():
    laws = [overridden(load_material(base), numbers).make_law() for base, numbers in MATERIALS.values()]
    assert len(laws) == len({repr(law) for law in laws}) == 13
    for task in map(load_task, TASKS):
        step = Randomization(task, load_material("salt"), {MATERIAL: tuple(MATERIALS)}).step
        assert min(accepted_bound(task.field.cell, law) for law in laws) > step > 0.0002
        assert task.step_dt / step == pytest.approx(round(task.step_dt / step))
    stiff = Randomization(task, load_material("salt"), {"E": (1e5, 6e6)}).step
    assert stiff < accepted_bound(task.field.cell, overridden(load_material("salt"), {"E": 6e6}).make_law())
    assert Randomization(task, load_material("salt"), {"fill": (0.5, 1.0)}).step is None


def make_episode(score: float, trajectory: list[list[float]], diverged: str | None = None) -> dict:
    return {"score": score, "trajectory": trajectory, "diverged": diverged, "delivered": 1.0, "spilled": 0.0,
            "collisions": None}


def test_deviation_is_the_mean_distance_up_to_the_shorter_end():
    trajectory = [[0.0, 0.0, 0.1], [0.1, 0.0, 0.1]]
    episodes = {**dict.fromkeys(MATERIALS, make_episode(2.0, trajectory)), OWN: make_episode(1.0, trajectory),
                "sugar": make_episode(2.0, [[0.0, 0.003, 0.1], [0.1, 0.0, 0.101]]),
                "flour": make_episode(2.0, [[0.0, 0.003, 0.1]], "escaped"), "sand": make_episode(2.0, [], "at once")}
    rows = command.make_rows(episodes)
    assert list(rows) == list(MATERIALS) and rows["salt"]["td_mm"] == 0.0
    assert rows["sugar"]["td_mm"] == pytest.approx(2.0) and rows["flour"]["td_mm"] == pytest.approx(3.0)
    assert rows["sand"]["td_mm"] is None and ["sand", "2.0 (-)"] in command.pivot(["SpoonPour"], {"SpoonPour": rows})


def test_finished_episodes_are_kept(tmp_path, capsys):
    """An episode that fails is named and the others are kept; another motion is run from the start."""
    killed = [("SpoonPour", "flour")]

    def run(task, name, label):
        if (task, label) in killed:
            raise RuntimeError("killed by signal 9")
        return make_episode(1.0, [[0.0] * 3])

    tasks, launcher = ["SpoonTranslate", "SpoonPour", "SpoonPour"], StandIn(run)
    assert command.materials(tasks, tmp_path, launcher=launcher) == 1
    assert "SpoonPour in flour: killed by signal 9" in capsys.readouterr().err and len(launcher.asked) == 28
    assert len(json.loads((tmp_path / "materials.json").read_text())["rows"]) == 13
    killed, launcher.asked = [], []
    assert command.materials(tasks, tmp_path, launcher=launcher) == 0
    assert launcher.asked == [{"task": "SpoonPour", "name": "recorded", "label": "flour"}]
    assert len(json.loads((tmp_path / "materials.json").read_text())["rows"]) == 26
    assert "1.0 (0.0)" in capsys.readouterr().out and "1.0 (0.0)" in (tmp_path / "index.html").read_text()
    assert len((tmp_path / "materials.csv").read_text().splitlines()) == 27
    command.materials(["SpoonPour"], tmp_path, name="scripted", launcher=launcher)
    assert len(launcher.asked) == 1 + 14 and launcher.asked[1]["name"] == "scripted"
