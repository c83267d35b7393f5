"""Suites of held-out starts, the same for every policy; what a turned start does to the grains; tables of doses."""

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robosim.base.errors import ConfigError, RobosimError, UnknownName
from robosim.base.resources import CHECKOUT
from robosim.base.statistics import bootstrap, interquartile_mean
from robosim.commands.runs.evaluate import check_policy, find_network
from robosim.dosing import CONTROLLERS
from robosim.envs.grain_env import GrainEnv
from robosim.randomization.materials import MATERIALS
from robosim.studies.evaluation import evaluate as one_task
from robosim.studies.evaluation import suite_run
from robosim.studies.evaluation.evaluate import evaluate
from robosim.studies.evaluation.suite_run import COMPARED, compared, evaluate_suite, find_policies, normalise
from robosim.studies.policies import NETWORKS
from robosim.studies.policies.make import check_task, make_policy
from robosim.studies.policies.suites import plan_starts
from robosim.tasks.counting import TOOL
from robosim.tasks.task import load_task

SCORES = CHECKOUT / "docs" / "results" / "data" / "networks"
"""Of the bundled policies, as the pages quote them."""


def test_a_suite_is_the_same_for_all_and_a_short_one_begins_a_long_one() -> None:
    task = load_task("SpoonTranslate")
    wide = plan_starts("wide", task, 48)
    assert plan_starts("wide", task, 10) == wide[:10] and len({start.seed for start in wide}) == 48
    assert {start.world for start in wide} == {("salt", (), "wide")}
    assert {start.label for start in plan_starts("materials", task, 13)} == set(MATERIALS)
    assert {start.world for start in plan_starts("nominal", task, 5)} == {("salt", (), "nominal")}
    assert {start.randomize for start in plan_starts("hard", task, 3)} == {"hard_unseen"}
    with pytest.raises(UnknownName, match="hard, materials, nominal, wide"):
        plan_starts("harder", task, 1)


@pytest.mark.long
def test_a_turned_start_turns_the_load_with_the_tool() -> None:
    """The grains keep their places in the tool's frame and their elastic energy, and creep as little as at home.

    With substeps of 0.2 to 0.4 ms they creep by 0.12 to 0.18 mm there, and turned by 17 degrees by 0.21 to 0.26 mm."""
    shift, turn = (0.02, -0.01, 0.015), 17.0
    env = GrainEnv(task="SpoonTranslate")
    env.reset(seed=0, options={"nominal": True})
    before, energy = env.solver.collider_pose(TOOL), env.solver.energy()
    local = before.inverse().apply(env.solver.positions())
    creep = rest(env, local)
    env.reset(options={"nominal": True, "shift": shift, "turn_deg": turn})
    pose = env.solver.collider_pose(TOOL)
    assert pose.position - before.position == pytest.approx(shift, abs=1e-12)
    cosine = float(np.trace(pose.matrix @ before.matrix.T) - 1.0) / 2.0
    assert np.degrees(np.arccos(cosine)) == pytest.approx(turn, abs=1e-4)
    assert np.abs(pose.inverse().apply(env.solver.positions()) - local).max() < 1e-6
    assert env.solver.energy().elastic == pytest.approx(energy.elastic, rel=1e-4) and rest(env, local) < creep + 1.5e-4
    env.close()


def rest(env: GrainEnv, local: np.ndarray) -> float:
    """Let the tool rest for five actions; return the mean distance [m] along an axis by which its grains move in it."""
    for _ in range(5):
        env.step(np.zeros(3, np.float32))
    return float(np.abs(env.solver.collider_pose(TOOL).inverse().apply(env.solver.positions()) - local).mean())


@pytest.mark.long
@pytest.mark.parametrize("task", ["SpoonPour", pytest.param("SpoonScoop", marks=pytest.mark.slow)])
def test_a_displaced_place_displaces_the_task(task: str) -> None:
    """By whole cells: the grains in the container or the tool move along, and the reward is what it is at home.
    With the place alone, what is carried is farther from the target, what is scooped is out of the tool's reach."""
    config, cells = load_task(task), (2, -1)
    place = (cells[0] * config.field.cell, cells[1] * config.field.cell)
    free = config.action.model_copy(update={"lower": (-9.0, -9.0, -9.0), "upper": (9.0, 9.0, 9.0)})
    config = config.model_copy(update={"action": free, "steps": 100})
    scores, piles = [], []
    for (x, y), shift in (((0.0, 0.0), (0.0, 0.0)), (place, place), (place, (0.0, 0.0))):
        env = GrainEnv(task=config, randomize={"place_x": (x, x), "place_y": (y, y)})
        env.reset(seed=0, options={"nominal": True, "shift": (*shift, 0.0)})
        piles.append(env.solver.positions().mean(0))
        total = sum(env.step(np.full(config.action.dimensions, 0.3, np.float32))[1] for _ in range(10))
        scores.append(float(total))
        env.close()
    assert piles[1] - piles[0] == pytest.approx([*place, 0.0], abs=2e-4)
    assert scores[1] == pytest.approx(scores[0], rel=0.02)
    if task == "SpoonPour":
        assert abs(scores[2] - scores[0]) > 5 * abs(scores[1] - scores[0])


@pytest.mark.long
def test_a_network_is_refused_for_another_version_of_its_task(tmp_path: Path) -> None:
    """By what differs; not for what the command changed on purpose, and not for the suite's own changes."""
    task = load_task("SpoonTranslate")
    learned = json.loads(task.model_dump_json(exclude={"description"}))
    learned["field"]["cell"], learned["goal"] = 0.004, [0.0, 0.0, 0.0]
    path = tmp_path / "p.npz"
    n = GrainEnv(task="SpoonTranslate", obs="moments").observation_space.shape[0]
    network = {"weight_0": np.zeros((3, n), np.float32), "bias_0": np.zeros(3, np.float32), "bound": "tanh",
               "activations": ["none"], "obs": "moments", "task": "SpoonTranslate", "action_repeat": 100}
    np.savez(path, **network, task_table=json.dumps(learned))
    for run in (lambda: evaluate("SpoonTranslate", str(path), None),
                lambda: evaluate_suite("SpoonTranslate", [str(path)], "wide", None)):
        with pytest.raises(ConfigError, match=r"learned on SpoonTranslate with field.cell 0.004, here 0.008; goal "):
            run()
    check_task(str(path), task, {"field", "goal"})
    np.savez(path, **network, task_table=task.model_dump_json(exclude={"description"}))
    assert evaluate_suite("SpoonTranslate", [str(path)], "wide", None, episodes=1, alone=True) == 0
    np.savez(path, **network, task_table="{")
    with pytest.raises(ConfigError, match="task_table: not JSON"):
        check_task(str(path), task)


@pytest.mark.long
@pytest.mark.parametrize(("changed", "message"), [
    ({"obs": "joints,time"}, "p.npz: observes joints, time; this environment has no joints; it has grains, .*time"),
    ({"obs": "tool"}, r"p.npz: takes 5 numbers and gives 3; this environment observes tool, \(3,\), and takes 3"),
    ({"weight_0": np.full((3, 3), np.nan, np.float32)}, "p.npz: weight_0: holds numbers that are not finite")])
def test_a_network_that_does_not_fit_is_refused_before_anything_is_written(
        tmp_path: Path, changed: dict[str, Any], message: str) -> None:
    path, out = tmp_path / "p.npz", tmp_path / "out"
    np.savez(path, **{"weight_0": np.zeros((3, 5), np.float32), "bias_0": np.zeros(3, np.float32), "bound": "tanh",
                      "activations": ["none"], "obs": "tool", "task": "SpoonTranslate", **changed})
    for run in (lambda: evaluate("SpoonTranslate", str(path), out),
                lambda: evaluate_suite("SpoonTranslate", ["scripted", str(path)], "hard", out, episodes=1)):
        with pytest.raises(ConfigError, match=message):
            run()
    with pytest.raises(ConfigError, match="p.npz: .*(this environment observes flat|not finite)"):
        make_policy(str(path), GrainEnv(task="SpoonTranslate"), 0)
    assert not out.exists()


def test_a_suite_that_cannot_be_drawn_is_refused_by_its_range(tmp_path: Path) -> None:
    source = (task := load_task("SpoonScoop")).containers["source"]
    full = source.model_copy(update={"fill_height": 0.9 * source.fill_height * 1.5})
    file, out = tmp_path / "full.yaml", tmp_path / "out"
    file.write_text(task.model_copy(update={"containers": {"source": full}}).model_dump_json())
    with pytest.raises(ConfigError, match="suite hard: randomize: fill = 1.5, surface_slope_deg = .* accepted: up to "):
        evaluate_suite(str(file), ["zero"], "hard", out, episodes=1)
    assert not out.exists()


def test_a_bundled_network_is_a_policy_where_there_is_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without any, "network" is no name of a policy; a task without one is refused by naming those with one."""
    monkeypatch.setattr("robosim.commands.runs.evaluate.trained", lambda task, kind: None)
    with pytest.raises(UnknownName, match="network"):
        check_policy(find_network("network", "SpoonPour"))
    monkeypatch.setattr("robosim.commands.runs.evaluate.trained",
                        lambda task, kind: Path("p.npz") if task == "SpoonPour" else None)
    assert find_network("network", "SpoonPour") == "p.npz" and find_network("zero", "SpoonPour") == "zero"
    with pytest.raises(ConfigError, match="none is bundled for ShovelMove; accepted: for SpoonPour;"):
        find_network("network", "ShovelMove")


@pytest.mark.long
def test_a_suite_scores_policies_from_the_same_starts(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    assert evaluate_suite("SpoonTranslate", ["scripted"], "wide", tmp_path, episodes=2) == 0
    rows = list(csv.DictReader((tmp_path / "evaluation.csv").read_text().splitlines()))
    names = list(dict.fromkeys(row["policy"] for row in rows))
    assert names == ["scripted", "knowing", "recorded", "zero"] and "plotly" in (tmp_path / "index.html").read_text()
    starts = [[(row["seed"], row["tool_x"], row["place_yaw_deg"]) for row in rows if row["policy"] == name]
              for name in names]
    assert starts[0] == starts[1] == starts[2] == starts[3] and len(set(starts[0])) == 2
    summary = json.loads((tmp_path / "evaluation.json").read_text())
    assert summary["is_complete"] and set(summary["policies"]) == set(names)
    scores = {name: values["tcs"]["mean"] for name, values in summary["policies"].items()}
    assert scores["scripted"] > 35.0 and scores["zero"] < -35.0  # 41 and -41 at most
    assert "scripted" in capsys.readouterr().out


def test_a_policy_alone_has_the_figures_that_it_has_beside_others(tmp_path, capsys) -> None:
    rows = {}
    for alone in (False, True):
        assert evaluate_suite("SpoonTranslate", ["zero"], "nominal", tmp_path, episodes=1, alone=alone) == 0
        rows[alone] = list(csv.DictReader((tmp_path / "evaluation.csv").read_text().splitlines()))
    assert rows[True] == rows[False][:1] and {row["policy"] for row in rows[False]} > {"zero"}
    assert "scripted" not in capsys.readouterr().out.splitlines()[-1]


def test_an_interval_covers_the_mean_about_as_often_as_it_says() -> None:
    rng, hits = np.random.default_rng(0), 0
    for _ in range(200):
        low, high = bootstrap(rng.exponential(size=50))
        hits += low <= 1.0 <= high
    assert 0.87 <= hits / 200 <= 0.98  # of a skewed sample a little less than 0.95
    assert bootstrap([3.0] * 10) == (3.0, 3.0)
    runs = np.repeat([[0.0], [1.0], [2.0]], 40, axis=1)  # alike within a run: what differs is the seed alone
    assert bootstrap(runs) == (0.0, 2.0) and bootstrap(runs[1:2]) == (1.0, 1.0)


def test_the_middle_half_ignores_outliers_and_scores_are_between_no_motion_and_the_cap() -> None:
    assert interquartile_mean(np.array([-1e9, 1.0, 2.0, 1e9])) == 1.5
    rows = [{"policy": policy, "episode": k, "tcs": tcs, "cap": 40.0} for policy, scores in (
        ("zero", (-40.0, 0.0)), ("mine", (0.0, 40.0))) for k, tcs in enumerate(scores)]
    normalise(rows)
    assert [row["normalised"] for row in rows] == [0.0, 0.0, 0.5, 1.0]


def test_best_and_last_policies_of_all_seeds_have_a_label_each(tmp_path: Path) -> None:
    for seed in range(3):
        (tmp_path / f"seed_{seed}").mkdir()
        for name in ("best_policy.npz", "last_policy.npz"):
            (tmp_path / f"seed_{seed}" / name).touch()
    found = find_policies(str(tmp_path))
    assert [Path(label).name for label in found] == [tmp_path.name, f"{tmp_path.name}, last"]
    assert [[Path(file).parent.name[-1] for file in files] for files in found.values()] == [["0", "1", "2"]] * 2


def test_what_does_not_fit_is_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "best.npz", actions=np.zeros((100, 3), np.float32), task="SpoonPour", action_repeat=10)
    assert find_policies(str(tmp_path)) == {str(tmp_path): [str(tmp_path / "best.npz")]}
    cases = [({"names": [str(tmp_path)], "suite": "wide"}, "for SpoonPour; accepted: for SpoonTranslate"),
             ({"names": [str(tmp_path.parent)], "suite": "wide"}, "best_policy.npz"),
             ({"names": ["scripted"], "suite": "wide", "material": "sand"}, "--material sand with --suite wide")]
    for arguments, message in cases:
        with pytest.raises(RobosimError, match=message):
            evaluate_suite("SpoonTranslate", out=None, episodes=1, **arguments)
    with pytest.raises(UnknownName):
        check_policy("best")
    for shift in ((0.0, 0.0), "left", (0.0, 0.0, np.nan)):
        with pytest.raises(ConfigError, match="three lengths"):
            GrainEnv(task="SpoonTranslate").reset(seed=0, options={"shift": shift})


BUNDLED = [(path.stem, name) for name, kind in NETWORKS.items()
           for path in sorted((CHECKOUT / "policies" / "trained" / kind).glob("*.npz"))]


@pytest.mark.parametrize(("task", "name"), BUNDLED)
def test_a_bundled_policy_was_learned_on_the_task_as_it_is(task: str, name: str) -> None:
    """And has the scores that the page quotes."""
    check_task(find_network(name, task), load_task(task))
    assert {path.name for path in SCORES.glob(f"{task}_*.csv")} >= {f"{task}_wide.csv", f"{task}_hard.csv"}


@pytest.mark.slow
@pytest.mark.parametrize(("task", "name"), BUNDLED)
def test_a_bundled_policy_finds_its_committed_score_again(task: str, name: str, tmp_path: Path) -> None:
    """The first starts of those that the page quotes; another processor's sums may move single grains."""
    assert evaluate_suite(task, [find_network(name, task)], "hard", tmp_path, episodes=3, alone=True) == 0
    rows = [list(csv.DictReader(path.read_text().splitlines())) for path in (
        SCORES / f"{task}_hard.csv", tmp_path / "evaluation.csv")]
    stored, found = [row for row in rows[0] if NETWORKS[name] in Path(row["policy"]).parts[-2:]][:3], rows[1]
    assert len(found) == len(stored) == 3
    for one, other in zip(found, stored):
        assert float(one["tcs"]) == pytest.approx(float(other["tcs"]), abs=0.1 * float(other["cap"])), one["seed"]


ERRORS = {"pi": (0.1e-3, -0.3e-3), "open_loop": (5e-3, 3e-3)}
ROWS = [{"policy": policy, "episode": k, "return": 8.0, "tcs": 8.0, "is_success": abs(error) < 0.3e-3, "diverged": "",
         "dose_error": error, "dose_error_percent": 1e4 * error, "seconds": 12.0 + k, "spilled": 0.2e-3 * k}
        for policy, errors in ERRORS.items() for k, error in enumerate(errors)]


def test_a_suite_has_error_spread_time_and_spilled_mass() -> None:
    summary = suite_run.summarize(ROWS)
    assert summary["pi"]["dose_error"]["mean"] == pytest.approx(-0.1e-3)
    assert summary["pi"]["dose_error"]["std"] == pytest.approx(0.2e-3)
    low, high = summary["open_loop"]["dose_error"]["interval"]
    assert low == pytest.approx(3e-3) and high == pytest.approx(5e-3)
    head, first, second = suite_run.format_summary(summary).splitlines()
    assert head.split()[:2] == ["policy", "success"] and "spread [g]" in head and "spilled [g]" in head
    assert first.split()[-5:] == ["-0.10", "0.20", "12.5", "0.10", "2"] and first.startswith("pi ")
    assert second.split()[-5:] == ["4.00", "1.00", "12.5", "0.10", "2"]


def test_controllers_are_compared_with_each_other_where_a_task_has_their_numbers() -> None:
    assert compared(load_task("DoseSpoon")) == CONTROLLERS and compared(load_task("SpoonPour")) == COMPARED


def test_an_evaluation_has_the_spread_of_the_error() -> None:
    rows = [{"seed": k, "return": 8.0, "tcs": 8.0, "tcs_terms": {}, "is_success": True, "diverged": None,
             "readings": {"dose_error": error, "seconds": 12.0}} for k, error in enumerate(ERRORS["open_loop"])]
    values = one_task.summarize("DoseSpoon", "pi", rows, 2)
    assert values["readings.dose_error"] == pytest.approx(4e-3)
    assert values["readings.dose_error_std"] == pytest.approx(1e-3) and "readings.seconds_std" not in values
