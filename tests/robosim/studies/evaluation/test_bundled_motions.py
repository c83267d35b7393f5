"""Bundled motions: their recorded scores against the paper's, and that each of them still earns its own."""

import json
import math

import pytest
import yaml

from robosim.base.resources import folder, trained
from robosim.envs import TASKS
from robosim.studies.evaluation.material_episode import OWN, play_in_material
from robosim.tasks.task import TaskConfig, load_task

BUNDLED = [name for name in TASKS if trained(name)]
GRAINS = 0.015
"""Share of the counted grains by whose fate a score may differ from machine to machine."""


def recorded(name: str) -> dict:
    """The row of a motion in its own material, as `robosim materials` wrote it."""
    path = trained(name)
    assert path is not None
    rows = json.loads(path.with_name("materials.json").read_text())["rows"]
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


@pytest.mark.parametrize("name", BUNDLED)
def test_a_score_of_no_motion_is_far_outside_what_grains_may_change(name: str) -> None:
    assert 3 * score_of_grains(load_task(name)) < recorded(name)["score"]


@pytest.mark.slow
@pytest.mark.parametrize("name", BUNDLED)
def test_a_motion_earns_its_recorded_score(name: str) -> None:
    """From the nominal start, up to the fate of a few grains; without a collision where it scoops."""
    episode, row = play_in_material(name, "learned", OWN), recorded(name)
    assert episode["score"] == pytest.approx(row["score"], abs=score_of_grains(load_task(name)))
    assert episode["delivered"] == pytest.approx(row["delivered"], abs=GRAINS + 1e-9)
    assert episode["collisions"] == row["collisions"] and episode["diverged"] is None
