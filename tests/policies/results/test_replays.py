"""Rows whose runs are run again after the code has changed."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from policies.results.replays import kind
from policies.results.tables import check, repeat, tables

DEMONSTRATION = Path(__file__).parents[3] / "policies" / "trained" / "demonstrations" / "SpoonPour.npz"


def test_runs_of_one_kind_differ_in_seed_and_folder_alone() -> None:
    """Whatever the order of the options."""
    row = {"command": "robosim train bc SpoonPour --seed 2 --out a/seed_2 --demos d.npz --set options.gamma=0.5"}
    assert kind(row) == "robosim train bc SpoonPour --demos d.npz --set options.gamma=0.5"


@pytest.mark.slow
def test_rows_count_as_of_today_where_their_scores_are_found_again(tmp_path: Path,
                                                                   capsys: pytest.CaptureFixture) -> None:
    """A row of changed code is old until its run is repeated, and stays old where a score differs."""
    subprocess.run([sys.executable, "-m", "robosim", "train", "bc", "SpoonPour", "--demos", str(DEMONSTRATION), "--out",
                    str(tmp_path / "run"), "--episodes", "2"], check=True, capture_output=True)
    assert tables([tmp_path / "run"], tmp_path / "out") == 0
    path = tmp_path / "out" / "tables.json"
    table = json.loads(path.read_text())
    table["runs"][0]["commit"] = "c"
    (code,) = table["code"].values()
    code["mpm.solver"] = "0"
    path.write_text(json.dumps(table))
    assert check([path]) == 1
    assert repeat([path]) == 0 and "DIFFERS" not in capsys.readouterr().out
    assert check([path]) == 0
