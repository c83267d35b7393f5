"""`robosim explain`: parts, costs and the cheapest setting within a tolerance."""

import json
from pathlib import Path

import pytest

from robosim.base.errors import ConfigError
from robosim.studies.benchmarks.explain import compare_settings, explain


def result(setting: dict, seconds: float, **readings: float) -> dict:
    return {"setting": setting, "failed": "", "result": {
        "grains": 1, "cell_m": 0.004, "dt_s": 1e-4, "parts": [], "costs": {}, "seconds": seconds, "readings": readings,
        "profile": [{"grain_ns": 70.0, "block_ns": 0.0, "substep_us": 9.0}]}}


def test_settings_are_compared_with_the_finest() -> None:
    """A share of the grains by its difference, a mass relative to it; the scene's own setting has an error, too."""
    rows = compare_settings([result({}, 8.0, mass=2.0, spilled=0.001),
                             result({"cell": 2.0}, 1.0, mass=2.1, spilled=0.001),
                             result({"cell": 1.5}, 2.0, mass=2.02, spilled=0.004)], 0.02)
    assert [row["within"] for row in rows] == [True, False, True]
    assert rows[2]["speedup"] == 4.0 and rows[2]["worst"] == "mass"
    rows = compare_settings([result({}, 8.0, mass=2.0, spilled=0.001),
                             result({"cell": 0.8}, 20.0, mass=2.03, spilled=0.001),
                             result({"cell": 1.5}, 2.0, mass=2.02, spilled=0.004)], 0.01)
    assert [row["within"] for row in rows] == [False, True, True]
    assert [row["speedup"] for row in rows] == [2.5, 1.0, 10.0]


def test_a_softer_material_counts_as_a_cheaper_setting(tmp_path, capsys, monkeypatch) -> None:
    monkeypatch.setattr("robosim.studies.benchmarks.explain.run_settings",
                        lambda *arguments: [result({}, 8.0, mass=2.0), result({"E": 0.25}, 4.0, mass=2.0)])
    assert explain("SpoonPour", tolerance=0.02, out=tmp_path) == 0
    assert "cheapest within 2.0% of own setting: E x 0.25" in capsys.readouterr().out


def test_a_tolerance_above_1_is_refused() -> None:
    with pytest.raises(ConfigError, match="--tolerance 2"):
        explain("SpoonPour", tolerance=2.0)


@pytest.mark.slow
def test_parts_and_costs_are_named(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    assert explain("SpoonTranslate", out=tmp_path) == 0
    stdout = capsys.readouterr().out
    assert "left out:" in stdout and "no wrench is compiled" in stdout and "  field: " in stdout
    own = json.loads((tmp_path / "explain.json").read_text())["results"][0]["result"]
    assert own["readings"]["delivered"] == 1.0
    *stretches, fit = own["profile"]
    assert {row["awake"] for row in stretches} == {own["grains"]} and all(
        row["ns"] == pytest.approx(1e6 * row["ms"] / row["awake"] / row["substeps"]) and row["blocks"] > 1
        for row in stretches) and fit["grain_ns"] > 0
    assert sum(own["costs"].values()) == pytest.approx(own["seconds"] / own["simulated_s"], rel=1e-6)
