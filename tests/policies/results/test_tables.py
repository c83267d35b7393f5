"""Tables of runs: which runs are pooled, what is noted, and the published numbers."""

import json
from pathlib import Path

import numpy as np
import pytest

import mpm
from policies.learning.bundled import bundled_names
from policies.learning.preset_files import ROW_KEYS, load_preset
from policies.results.summary import summarise
from policies.results.tables import collect_rows, preset_digest, tables
from robosim.tasks.reward import Reward
from robosim.tasks.task import load_task


def write_run(folder: Path, seed: int, score: float, *, method: str = "dg_sac", task: str = "SpoonPour",
              material: str = "salt", starts: str = "nominal", action_repeat: int = 10,
              demonstrations: dict[str, str] | None = None, **changes) -> None:
    """Write the two files of a finished run that tables are made of."""
    folder.mkdir(parents=True)
    preset = load_preset(method).model_copy(update=changes).model_dump()
    (folder / "manifest.json").write_text(json.dumps({
        "method": method, "task": task, "seed": seed, "material": material, "starts": starts,
        "action_repeat": action_repeat, "preset": preset, "demonstrations": demonstrations or {}, "commit": "c"}))
    (folder / "status.json").write_text(json.dumps({
        "state": "finished", "episodes": 10, "seconds": 20.0, "last": {"return": score}, "replayed": {"tcs": score}}))


def make_cells(folder: Path) -> dict:
    """Make the tables of a folder; return line -> task -> (runs, mean score)."""
    assert tables([folder], folder / "tables") == 0
    stored = json.loads((folder / "tables" / "tables.json").read_text())["tables"]
    return {line: {task: (cell["tcs_of_best_return"]["n"], cell["tcs_of_best_return"]["mean"])
                   for task, cell in row.items()} for line, row in stored.items()}


def test_seeds_are_pooled(tmp_path: Path) -> None:
    """A line has no settings that all runs of its method share, whatever another method's are."""
    write_run(tmp_path / "a", 0, 10.0)
    write_run(tmp_path / "b", 1, 20.0)
    write_run(tmp_path / "c", 0, 30.0, task="ShovelMove")
    write_run(tmp_path / "d", 0, 5.0, method="sac", action_repeat=20)
    assert make_cells(tmp_path) == {"dg_sac": {"SpoonPour": (2, 15.0), "ShovelMove": (1, 30.0)},
                              "sac": {"SpoonPour": (1, 5.0)}}


@pytest.mark.parametrize("setting, lines", [
    ({"material": "sugar"}, ("salt", "sugar")),
    ({"starts": "random"}, ("nominal starts", "random starts")),
    ({"action_repeat": 20}, ("action repeat 10", "action repeat 20")),
    ({"method": "rlpd", "obs": "flat"}, ("observes moments", "observes flat")),
    ({"episodes": 151}, ("at most 150 episodes", "at most 151 episodes")),
    ({"action_repeat": 20, "starts": "random"}, ("nominal starts, action repeat 10",
                                                 "random starts, action repeat 20"))])
def test_runs_with_other_settings_are_another_line(tmp_path: Path, setting: dict, lines: tuple[str, str]) -> None:
    """Also over several sub-tasks; both have the published number."""
    method = setting.get("method", "dg_sac")
    write_run(tmp_path / "a", 0, 10.0, method=method)
    write_run(tmp_path / "b", 0, 30.0, **{"method": method, **setting})
    write_run(tmp_path / "c", 0, 40.0, **{"method": method, "task": "ShovelMove", **setting})
    assert make_cells(tmp_path) == {f"{method}, {lines[0]}": {"SpoonPour": (1, 10.0)},
                              f"{method}, {lines[1]}": {"SpoonPour": (1, 30.0), "ShovelMove": (1, 40.0)}}
    stored = json.loads((tmp_path / "tables" / "tables.json").read_text())
    cell = stored["tables"][f"{method}, {lines[1]}"]["SpoonPour"]["tcs_of_best_return"]
    place = stored["published"]["tasks"].index("SpoonPour")
    assert cell["published"] == stored["published"]["tcs"].get(method, {place: None})[place]


def test_means_over_different_runs_are_noted(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """A seed that counts twice, other settings of the method, other demonstrations; no note where nothing differs."""
    write_run(tmp_path / "a", 0, 10.0)
    write_run(tmp_path / "b", 1, 20.0)
    make_cells(tmp_path)
    assert "mean over" not in capsys.readouterr().out
    write_run(tmp_path / "c", 1, 30.0, demonstrations={"demonstration_0.npz": "a"})
    write_run(tmp_path / "d", 2, 30.0, options={"gamma": 0.5})
    assert make_cells(tmp_path) == {"dg_sac": {"SpoonPour": (4, 22.5)}}
    notes = [line for line in capsys.readouterr().out.splitlines() if "different runs" in line]
    assert notes == [f"mean over different runs: dg_sac, SpoonPour: {text}" for text in (
        "seed 1 more than once", "2 different settings of the method", "2 different demonstrations")]


def test_ablations_have_the_name_of_their_observation(tmp_path: Path) -> None:
    """As in the paper."""
    write_run(tmp_path / "a", 0, 10.0)
    write_run(tmp_path / "b", 0, 20.0, obs="none")
    assert set(make_cells(tmp_path)) == {"dg_sac", "none"}


def test_rows_of_earlier_tables(tmp_path: Path) -> None:
    """A tables.json adds its runs, each once, also with earlier names of columns; other files are refused."""
    write_run(tmp_path / "a" / "0", 0, 10.0)
    write_run(tmp_path / "a" / "1", 1, 20.0)
    write_run(tmp_path / "b" / "0", 2, 60.0)
    assert tables([tmp_path / "a"], tmp_path / "first") == 0
    first = tmp_path / "first" / "tables.json"
    table = json.loads(first.read_text())
    renamed = {new: old for old, new in ROW_KEYS.items()}
    table["runs"] = [{renamed.get(key, key): value for key, value in row.items()} for row in table["runs"]]
    assert set(renamed.values()) < set(table["runs"][0])
    first.write_text(json.dumps(table))
    assert tables([tmp_path / "b", first, tmp_path / "a"], tmp_path / "second") == 0
    stored = json.loads((tmp_path / "second" / "tables.json").read_text())
    cell = stored["tables"]["dg_sac"]["SpoonPour"]["tcs_of_best_return"]
    assert (cell["n"], cell["mean"]) == (3, 30.0)
    (tmp_path / "other.json").write_text("[]")
    with pytest.raises(mpm.InvalidValue, match=r"other.json: not a tables.json"):
        tables([tmp_path / "other.json"], tmp_path / "third")


def test_further_tables(tmp_path: Path) -> None:
    """Gain of down-sampling, turn of the tools, other materials, with the paper's numbers."""
    for name, obs, seconds in (("a", "all", 90.0), ("b", "flat", 30.0)):
        write_run(tmp_path / name, 0, 10.0, task="SpoonScoop", obs=obs)
        path = tmp_path / name / "status.json"
        status = json.loads(path.read_text())
        status["replayed"]["turn_error_deg"] = 2.2
        path.write_text(json.dumps(status | {"seconds": seconds}))
    write_run(tmp_path / "c", 0, 10.0, material="sugar")  # another setting, not compared
    for policy, score in (("learned", 52.0), ("scripted", 42.0)):  # one column each
        (tmp_path / policy).mkdir()
        (tmp_path / policy / "materials.json").write_text(json.dumps({"policy": policy, "rows": [
            {"task": "SpoonPour", "material": "sugar", "score": score, "td_mm": 3.0, "delivered": 1.0},
            {"task": "SpoonPour", "material": "flour", "score": 12.0, "td_mm": None, "delivered": 0.2}]}))
    make_cells(tmp_path)
    stored = json.loads((tmp_path / "tables" / "tables.json").read_text())
    assert stored["gain_of_down_sampling"] == {"SpoonScoop": pytest.approx(3.0)}
    assert {(row["method"], row["task"], row["off_deg"]) for row in stored["turns"]} == {
        ("all", "SpoonScoop", 2.2), ("dg_sac, salt", "SpoonScoop", 2.2)}
    page = (tmp_path / "tables" / "index.html").read_text()
    for text in ("3.00</td><td>4.67", "2.0%</td><td>-110</td><td>3.0 (2.8%)", "52.0 (3.0)", "42.0 (3.0)",
                  "12.0 (-)", "SpoonPour, scripted"):
        assert text in page, text
    before = {**stored["runs"][0]}
    del before["turn_error_deg"]  # as a file of an earlier version
    (tmp_path / "old").mkdir()
    (tmp_path / "old" / "tables.json").write_text(json.dumps({"runs": [before]}))
    assert tables([tmp_path / "old" / "tables.json"], tmp_path / "again") == 0


def test_summaries_follow_their_definitions() -> None:
    """Mean, deviation of a sample, interquartile mean; one run has neither spread nor interval."""
    several = summarise([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 100.0], np.random.default_rng(0))
    assert (several["n"], several["mean"], several["iqm"]) == (8, 16.0, 4.5)
    assert several["std"] == pytest.approx((8092.0 / 7.0) ** 0.5) and 2.0 <= several["low"] < 4.5 < several["high"]
    one = summarise([3.0], np.random.default_rng(0))
    assert (one["std"], one["low"], one["high"]) == (0.0, 3.0, 3.0)


def test_the_bundled_table_has_distinct_runs_within_the_tasks_bounds() -> None:
    """No score is above the highest of its task's reward; presets are those of today, where a row has their digest."""
    path = Path(__file__).resolve().parents[3] / "policies" / "trained" / "tables.json"
    rows, unfinished = collect_rows([path])
    assert len(rows) == len(json.loads(path.read_text())["runs"]) and not unfinished
    highest = {task: Reward(load_task(task)).extremes()[1] for task in bundled_names("tasks")}
    presets = {name: load_preset(name).model_dump() for name in bundled_names("training")}
    for row in rows:
        assert row["preset"] in (None, preset_digest(presets[row["method"]])), row
        assert max(row["tcs_of_best_return"], row["tcs_last10"]) <= highest[row["task"]] + 1e-9, row
        assert row["episodes"] <= row["max_episodes"] and 0.0 <= row["delivered"] + row["spilled"] <= 1.0 + 1e-9, row
