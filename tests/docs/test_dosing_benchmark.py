"""Entries of others to the dosing benchmark: what is accepted, refused by field, and computed."""

import json

import pytest
from dosing_benchmark import main, measure, read_entry
from pages import ROOT, blocks

EXAMPLE = next(block.text for block in blocks(ROOT / "docs" / "results" / "dosing.md") if block.language == "json")


def test_metrics_are_those_computed_by_hand() -> None:
    """Of 10 g each: 10.1, 9.9, 11 g, and none: errors 1, -1 and 10 %, whose squares about 10 / 3 sum to 206 / 3."""
    doses = [{"draw": k, "material": "NaCl", "target_g": 10.0, "dosed_g": g, "seconds": 2.0 + k, "spilled_g": 0.1 * k}
             for k, g in enumerate([10.1, 9.9, 11.0, None])]
    row, = measure(read_entry(json.dumps(json.loads(EXAMPLE) | {"draws": 4, "doses": doses})))
    assert row == pytest.approx(["NaCl", 4, 0.5, 10 / 3, (206 / 6) ** 0.5, 1.0, 3.5, 0.15])


@pytest.mark.parametrize("right, wrong, said", [
    ('"draws": 2', '"draws": 3', "draws 2 of 3 are missing"), ('"draws": 2', '"draws": 1', "draws 1; accepted: 0 to 0"),
    ('"draw": 1', '"draw": 0', "draws 0 are there twice"), ("0.201", "-0.201", "doses.0.dosed_g"),
    ('"seconds": 120.0', '"mass": 1.0', "doses.1.seconds"), ('"robot"', '"film"', "kind"),
    ('"target_g": 0.2, "dosed_g": n', '"target_g": "0.2", "dosed_g": n', "doses.1.target_g")])
def test_a_wrong_entry_is_refused_by_field(right: str, wrong: str, said: str, tmp_path, capsys) -> None:
    (path := tmp_path / "entry.json").write_text(EXAMPLE)
    assert main(["check", str(path)]) == 0 and "2 of 200 draws" in capsys.readouterr().out
    assert EXAMPLE.count(right) == 1 and path.write_text(EXAMPLE.replace(right, wrong))
    assert main(["check", str(path)]) == 1 and said in capsys.readouterr().err
