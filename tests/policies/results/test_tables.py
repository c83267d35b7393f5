"""Tables of runs: which runs are pooled, what is noted, and the published numbers."""

import json
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest

import mpm
from policies.learning.presets import load_preset
from policies.results.curves import group_curves
from policies.results.rows import preset_digest
from policies.results.summary import summarise
from policies.results.tables import check, collect_rows, print_paper, tables
from robosim.base.digests import exercised_code
from robosim.base.errors import ConfigError
from robosim.base.resources import config_names
from robosim.tasks.outcome import build_reward
from robosim.tasks.task import load_task


def write_run(folder: Path, seed: int, score: float, *, method: str = "dg_sac", task: str = "SpoonPour",
              material: str = "salt", starts: str = "nominal", action_repeat: int = 10,
              demonstrations: dict[str, str] | None = None, n_envs: int = 1, code: dict[str, str] | None = None,
              commit: str = "c", command: str = "/home/x/bin/robosim train dg_sac", **changes) -> None:
    folder.mkdir(parents=True)
    preset = load_preset(method).model_copy(update=changes).model_dump()
    (folder / "manifest.json").write_text(json.dumps({
        "method": method, "task": task, "seed": seed, "material": material, "starts": starts,
        "action_repeat": action_repeat, "n_envs": n_envs, "preset": preset, "demonstrations": demonstrations or {},
        "commit": commit, "task_digest": "t", "field": "f", "code": code, "command": command}))
    (folder / "status.json").write_text(json.dumps({
        "state": "finished", "episodes": 10, "seconds": 20.0, "last": {"return": score, "tcs": score - 2.0},
        "replayed": {"tcs": score}, "evaluated": {"best": {"tcs": score - 1.0}}}))


def make_cells(folder: Path, is_mixed: bool = False) -> dict:
    """Make the tables of a folder; return line -> task -> (runs, mean score)."""
    assert tables([folder], folder / "tables", is_mixed) == 0
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
    ({"n_envs": 8}, ("1 environments at once", "8 environments at once")),
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
    assert stored["tables"][f"{method}, {lines[1]}"]["SpoonPour"]["tcs_of_best_return"]["published"] is None
    cell = stored["tables"][f"{method}, {lines[1]}"]["SpoonPour"]["tcs_last10"]
    place = stored["published"]["tasks"].index("SpoonPour")
    assert cell["published"] == stored["published"]["tcs"].get(method, {place: None})[place]


def test_means_over_different_runs_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """A seed that counts twice, other settings of the method, other demonstrations, other code; nothing is written.
    With --mixed they are noted; there is no note where nothing differs."""
    write_run(tmp_path / "a", 0, 10.0)
    write_run(tmp_path / "b", 1, 20.0)
    make_cells(tmp_path)
    assert "mean over" not in capsys.readouterr().out
    write_run(tmp_path / "c", 1, 30.0, demonstrations={"demonstration_0.npz": "a"})
    write_run(tmp_path / "d", 2, 30.0, options={"learning_rate": 1e-3, "gamma": 0.5}, code={"mpm": "1"})
    refused = r"seed 1 more than once; .*2 different demonstrations.*--label.*--mixed"
    with pytest.raises(mpm.InvalidValue, match=refused):
        tables([tmp_path], tmp_path / "refused")
    assert not (tmp_path / "refused").exists() and make_cells(tmp_path, True) == {"dg_sac": {"SpoonPour": (4, 22.5)}}
    notes = [line for line in capsys.readouterr().out.splitlines() if "different runs" in line]
    assert notes == [f"mean over different runs: dg_sac, SpoonPour: {text}" for text in (
        "seed 1 more than once", "2 different settings of the method", "2 different demonstrations",
        "2 different versions of the code")]


def test_ablations_have_the_name_of_their_observation(tmp_path: Path) -> None:
    """As in the paper."""
    write_run(tmp_path / "a", 0, 10.0, method="dg_sac_literal")
    write_run(tmp_path / "b", 0, 20.0, method="dg_sac_literal", obs="none")
    assert set(make_cells(tmp_path)) == {"dg_sac_literal", "none"}


def test_rows_of_earlier_tables(tmp_path: Path) -> None:
    """A tables.json adds its runs, each once; other files are refused."""
    write_run(tmp_path / "a" / "0", 0, 10.0)
    write_run(tmp_path / "a" / "1", 1, 20.0)
    write_run(tmp_path / "b" / "0", 2, 60.0)
    assert tables([tmp_path / "a"], tmp_path / "first") == 0
    first = tmp_path / "first" / "tables.json"
    assert tables([tmp_path / "b", first, tmp_path / "a"], tmp_path / "second") == 0
    stored = json.loads((tmp_path / "second" / "tables.json").read_text())
    cell = stored["tables"]["dg_sac"]["SpoonPour"]["tcs_of_best_return"]
    assert (cell["n"], cell["mean"]) == (3, 30.0)
    (tmp_path / "other.json").write_text("[]")
    with pytest.raises(mpm.InvalidValue, match=r"other.json: not a tables.json"):
        tables([tmp_path / "other.json"], tmp_path / "third")


def test_summaries_follow_their_definitions() -> None:
    """Mean, deviation of a sample, interquartile mean; one run has neither spread nor interval."""
    several = summarise([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 100.0])
    assert (several["n"], several["mean"], several["iqm"]) == (8, 16.0, 4.5)
    assert several["std"] == pytest.approx((8092.0 / 7.0) ** 0.5) and 2.0 <= several["low"] < 4.5 < several["high"]
    one = summarise([3.0])
    assert (one["std"], one["low"], one["high"]) == (0.0, 3.0, 3.0)


def test_the_bundled_table_has_distinct_runs_within_the_tasks_bounds() -> None:
    """No score is above the highest of its task's reward; presets are those of today."""
    path = Path(__file__).resolve().parents[3] / "policies" / "trained" / "tables.json"
    rows, unfinished = collect_rows([path])
    assert len(rows) == len(json.loads(path.read_text())["runs"]) and not unfinished
    highest = {task: build_reward(load_task(task)).extremes()[1] for task in config_names("tasks")}
    presets = {name: load_preset(name).model_dump() for name in config_names("training")}
    for row in rows:
        assert row["method"] not in presets or row["preset"] == preset_digest(presets[row["method"]]), row
        assert max(row["tcs_of_best_return"], row["tcs_last10"]) <= highest[row["task"]] + 1e-9, row
        assert row["episodes"] <= row["max_episodes"] and 0.0 <= row["delivered"] + row["spilled"] <= 1.0 + 1e-9, row


def test_each_score_has_a_column_beside_the_published_one(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """The evaluation, the last ten episodes and the best motion are not taken for each other."""
    write_run(tmp_path / "a", 0, 10.0)
    write_run(tmp_path / "b", 0, 9.0, method="dg_sac_literal")
    make_cells(tmp_path)
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    theirs = ["18.6", "±", "0.3"]
    assert ["SpoonPour", "dg_sac", "1", "9.0", "8.0", "10.0", *theirs] in lines
    assert ["SpoonPour", "dg_sac_literal", "1", "8.0", "7.0", "9.0", *theirs] in lines


def test_rows_older_than_the_code_are_named(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """By the modules that changed; also rows of a dirty tree, of other settings, and those that cannot tell."""
    assert mpm.Solver  # which is loaded when it is first named
    now = exercised_code()
    assert {"policies.results.tables", "policies.commands.tables"}.isdisjoint(now) and "mpm.solver" in now
    assert len(now) > 30
    write_run(tmp_path / "a", 0, 10.0, code=now)
    assert check([tmp_path / "a"]) == 0 and "all made by the code of today" in capsys.readouterr().out
    for name, changes in (("b", {"code": {**now, "mpm.solver": "0", "mpm.gone": "1"}}), ("c", {}),
                          ("d", {"code": now, "commit": "c-dirty"}),
                          ("e", {"code": now, "options": {"learning_rate": 1e-3, "gamma": 0.5}})):
        write_run(tmp_path / name, ord(name), 10.0, **changes)
    assert check([tmp_path]) == 1
    printed = capsys.readouterr().out
    for text in ("mpm.solver, mpm.gone have changed:\n  dg_sac SpoonPour seed 98, commit c",
                 "did not store the digests", "no commit has:\n  dg_sac SpoonPour seed 100",
                 "settings of dg_sac have changed:\n  dg_sac SpoonPour seed 101"):
        assert text in printed, text
    assert tables([tmp_path / "a"], tmp_path / "out") == 0
    stored = json.loads((tmp_path / "out" / "tables.json").read_text())
    assert stored["runs"][0]["command"] == "robosim train dg_sac"  # whatever the machine's folders
    assert list(stored["code"].values()) == [now] and stored["runs"][0]["code"] in stored["code"]
    assert check([tmp_path / "out" / "tables.json"]) == 0  # as a file has them
    with pytest.raises(ConfigError, match="holds other files, such as a; accepted: a new or empty"):
        tables([tmp_path / "a"], tmp_path)


def test_curves_are_means_of_ten_episodes_and_are_drawn(tmp_path: Path) -> None:
    """Kept in a tables.json, from which they are drawn again; a run without scores has none."""
    for seed, offset in ((0, 0.0), (1, 4.0)):
        write_run(tmp_path / "runs" / str(seed), seed, 10.0)
        scores = "\n".join(f"{k},{k + offset}" for k in range(25))
        (tmp_path / "runs" / str(seed) / "episodes.csv").write_text(f"episode,tcs\n{scores}\n")
    write_run(tmp_path / "runs" / "c", 0, 10.0, method="sac")
    assert tables([tmp_path / "runs"], tmp_path / "first") == 0
    rows, _ = collect_rows([tmp_path / "first" / "tables.json"])
    assert [row["curve"] for row in rows] == [[4.5, 14.5, 22.0], [8.5, 18.5, 26.0], None]
    picture = matplotlib.image.imread(tmp_path / "first" / "curves.png")
    assert picture.shape[1] > 400 and np.ptp(picture[..., :3]) > 0.9
    assert tables([tmp_path / "first" / "tables.json"], tmp_path / "second") == 0
    assert (tmp_path / "second" / "curves.png").read_bytes() == (tmp_path / "first" / "curves.png").read_bytes()
    assert group_curves(rows) == {"SpoonPour": {"dg_sac": [row["curve"] for row in rows[:2]]}}


def test_tables_of_the_paper_name_what_has_no_run(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """Ours stand above the published figures, with the number of runs; rows of other code are marked."""
    for seed, score in enumerate((12.0, 16.0)):
        write_run(tmp_path / f"{seed}", seed, score, code=exercised_code())
    write_run(tmp_path / "old", 0, 7.0, method="sac", code={"mpm": "1"})
    assert print_paper([tmp_path]) == 1
    lines = capsys.readouterr().out.splitlines()
    scores = lines[1: lines.index("")]
    columns = [line.split("  ") for line in scores]
    named = {cells[0]: [cell.strip() for cell in cells[1:] if cell.strip()] for cells in columns}
    pour = named["method"].index("SpoonPour")
    assert named["dg_sac"][pour] == "12.0 ± 2.8 (n 2)" and named["dg_sac, published"][pour] == "18.6 ± 0.3"
    assert named["sac"][pour] == "5.0 (n 1)*" and named["ppo"][pour] == "no run"
    assert named["dg_sac"][named["method"].index("SpoonScoop")] == "no run"
    missing = lines[-1].removeprefix("no run of ")
    assert "ppo SpoonPour" in missing and ", dg_sac SpoonPour" not in missing and "all SpoonPour" not in missing
