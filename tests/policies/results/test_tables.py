"""Tables over runs: what is pooled, and what is told apart."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

import mpm
from policies.learning.presets import load_preset
from policies.results.tables import summary, tables


def finished(folder: Path, seed: int, score: float, *, method: str = "dg_sac", task: str = "SpoonPour",
             material: str = "salt", starts: str = "nominal", hold: int = 10, shown: dict[str, str] | None = None,
             **preset) -> None:
    """The two files of a run that its tables are made of."""
    folder.mkdir(parents=True)
    told = load_preset(method).model_copy(update=preset).model_dump()
    (folder / "manifest.json").write_text(json.dumps({
        "method": method, "task": task, "seed": seed, "material": material, "starts": starts, "hold": hold,
        "preset": told, "demonstrations": shown or {}, "commit": "c"}))
    (folder / "status.json").write_text(json.dumps({
        "state": "finished", "episodes": 10, "seconds": 20.0, "last": {"return": score}, "replayed": {"tcs": score}}))


def made(folder: Path) -> dict:
    """Runs and mean score of each cell: line -> task -> (n, mean)."""
    assert tables([folder], folder / "tables") == 0
    told = json.loads((folder / "tables" / "tables.json").read_text())["tables"]
    return {line: {task: (cell["best"]["n"], cell["best"]["mean"]) for task, cell in row.items()}
            for line, row in told.items()}


def test_seeds_are_pooled(tmp_path: Path) -> None:
    """And nothing is said of settings that all runs of a method share; another method's settings are its own."""
    finished(tmp_path / "a", 0, 10.0)
    finished(tmp_path / "b", 1, 20.0)
    finished(tmp_path / "c", 0, 30.0, task="ShovelMove")
    finished(tmp_path / "d", 0, 5.0, method="sac", hold=20)
    assert made(tmp_path) == {"dg_sac": {"SpoonPour": (2, 15.0), "ShovelMove": (1, 30.0)},
                              "sac": {"SpoonPour": (1, 5.0)}}


@pytest.mark.parametrize("setting, lines", [
    ({"material": "sugar"}, ("salt", "sugar")),
    ({"starts": "random"}, ("nominal starts", "random starts")),
    ({"hold": 20}, ("actions held for 10 steps", "actions held for 20 steps")),
    ({"method": "rlpd", "obs": "flat"}, ("observes moments", "observes flat")),
    ({"episodes": 151}, ("150 episodes wanted", "151 episodes wanted")),
    ({"hold": 20, "starts": "random"}, ("nominal starts, actions held for 10 steps",
                                        "random starts, actions held for 20 steps"))])
def test_what_differs_is_a_line_of_its_own(tmp_path: Path, setting: dict, lines: tuple[str, str]) -> None:
    """Also over several sub-tasks; published numbers stand beside both."""
    method = setting.get("method", "dg_sac")
    finished(tmp_path / "a", 0, 10.0, method=method)
    finished(tmp_path / "b", 0, 30.0, **{"method": method, **setting})
    finished(tmp_path / "c", 0, 40.0, **{"method": method, "task": "ShovelMove", **setting})
    assert made(tmp_path) == {f"{method}, {lines[0]}": {"SpoonPour": (1, 10.0)},
                              f"{method}, {lines[1]}": {"SpoonPour": (1, 30.0), "ShovelMove": (1, 40.0)}}
    told = json.loads((tmp_path / "tables" / "tables.json").read_text())
    cell = told["tables"][f"{method}, {lines[1]}"]["SpoonPour"]["best"]
    place = told["published"]["tasks"].index("SpoonPour")
    assert cell["published"] == told["published"]["tcs"].get(method, {place: None})[place]


def test_what_a_mean_hides_is_told(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """A seed that counts twice, other numbers in a method's file, other demonstrations; nothing where all is well."""
    finished(tmp_path / "a", 0, 10.0)
    finished(tmp_path / "b", 1, 20.0)
    made(tmp_path)
    assert "differs" not in capsys.readouterr().out
    finished(tmp_path / "c", 1, 30.0, shown={"demonstration_0.npz": "a"})
    finished(tmp_path / "d", 2, 30.0, options={"gamma": 0.5})
    assert made(tmp_path) == {"dg_sac": {"SpoonPour": (4, 22.5)}}
    told = [line for line in capsys.readouterr().out.splitlines() if "differs" in line]
    assert told == [f"mean over what differs: dg_sac, SpoonPour: {words}" for words in (
        "seed 1 more than once", "2 different settings of the method", "2 different demonstrations")]


def test_ablations_keep_their_name(tmp_path: Path) -> None:
    """dg_sac with another observation is named after what it sees, as the paper's own rows are."""
    finished(tmp_path / "a", 0, 10.0)
    finished(tmp_path / "b", 0, 20.0, obs="none")
    assert set(made(tmp_path)) == {"dg_sac", "none"}


def test_earlier_tables_count(tmp_path: Path) -> None:
    """A tables.json of runs whose folders are gone adds them; what is in both counts once; other files are refused."""
    finished(tmp_path / "a" / "0", 0, 10.0)
    finished(tmp_path / "a" / "1", 1, 20.0)
    finished(tmp_path / "b" / "0", 2, 60.0)
    assert tables([tmp_path / "a"], tmp_path / "first") == 0
    kept = tmp_path / "first" / "tables.json"
    assert tables([tmp_path / "b", kept, tmp_path / "a"], tmp_path / "second") == 0
    cell = json.loads((tmp_path / "second" / "tables.json").read_text())["tables"]["dg_sac"]["SpoonPour"]["best"]
    assert (cell["n"], cell["mean"]) == (3, 30.0)
    (tmp_path / "other.json").write_text("[]")
    with pytest.raises(mpm.InvalidValue, match=r"other.json: not a tables.json"):
        tables([tmp_path / "other.json"], tmp_path / "third")


def test_further_tables(tmp_path: Path) -> None:
    """What down-sampling saves, the turn of tools that scoop, other materials: beside the paper's."""
    for name, obs, seconds in (("a", "all", 90.0), ("b", "flat", 30.0)):
        finished(tmp_path / name, 0, 10.0, task="SpoonScoop", obs=obs)
        path = tmp_path / name / "status.json"
        told = json.loads(path.read_text())
        told["replayed"]["turn_error_deg"] = 2.2
        path.write_text(json.dumps(told | {"seconds": seconds}))
    finished(tmp_path / "c", 0, 10.0, material="sugar")  # of another material, which the gain is not about
    for policy, score in (("learned", 52.0), ("scripted", 42.0)):  # neither takes the other's place
        (tmp_path / policy).mkdir()
        (tmp_path / policy / "materials.json").write_text(json.dumps({"policy": policy, "rows": [
            {"task": "SpoonPour", "material": "sugar", "score": score, "td_mm": 3.0, "delivered": 1.0},
            {"task": "SpoonPour", "material": "flour", "score": 12.0, "td_mm": None, "delivered": 0.2}]}))
    made(tmp_path)
    told = json.loads((tmp_path / "tables" / "tables.json").read_text())
    assert told["gain_of_down_sampling"] == {"SpoonScoop": pytest.approx(3.0)}
    assert {(row["method"], row["task"], row["off_deg"]) for row in told["turns"]} == {
        ("all", "SpoonScoop", 2.2), ("dg_sac, salt", "SpoonScoop", 2.2)}
    page = (tmp_path / "tables" / "index.html").read_text()
    for words in ("3.00</td><td>4.67", "2.0%</td><td>-110</td><td>3.0 (2.8%)", "52.0 (3.0)", "42.0 (3.0)",
                  "12.0 (-)", "SpoonPour, scripted"):
        assert words in page, words
    before = {**told["runs"][0]}
    del before["turn_error_deg"]  # as a file of an earlier version
    (tmp_path / "old").mkdir()
    (tmp_path / "old" / "tables.json").write_text(json.dumps({"runs": [before]}))
    assert tables([tmp_path / "old" / "tables.json"], tmp_path / "again") == 0


def test_summaries_are_those_of_the_definition() -> None:
    """Mean, deviation of a sample, mean of the middle half; of one run neither spread nor interval."""
    found = summary([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 100.0], np.random.default_rng(0))
    assert (found["n"], found["mean"], found["iqm"]) == (8, 16.0, 4.5)
    assert found["std"] == pytest.approx((8092.0 / 7.0) ** 0.5) and 2.0 <= found["low"] < 4.5 < found["high"]
    one = summary([3.0], np.random.default_rng(0))
    assert (one["std"], one["low"], one["high"]) == (0.0, 3.0, 3.0)


def test_the_comparison_in_the_readme_is_that_of_the_runs_that_ship() -> None:
    """Mean of the best motions, in brackets that of the last ten episodes, of every cell that holds runs."""
    root = Path(__file__).resolve().parents[3]
    runs = json.loads((root / "policies" / "trained" / "tables.json").read_text())["runs"]
    block = re.split("<!-- /?comparison -->", (root / "README.md").read_text())[1]
    head, _, *lines = [[cell.strip() for cell in line.split("|")[1:-1]] for line in block.strip().splitlines()]
    for method, *cells in lines:
        for task, told in zip(head[1:], cells, strict=True):
            own = [run for run in runs if (run["method"], run["task"]) == (method.strip("`"), task)]
            wanted = [np.mean([run[key] for run in own]) for key in ("best", "tcs")] if own else []
            found = [float(number) for number in re.findall(r"-?\d+\.\d", re.sub(r"\*.*\*", "", told))]
            assert found == pytest.approx(wanted, abs=0.051), (method, task)
