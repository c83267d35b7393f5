"""The command: card, figures and page, exit status, continuation, and the field itself."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import synthetic_heaps
import yaml
from synthetic_heaps import write_heaps

pytest.importorskip("sklearn")

from robosim.commands.main import main
from robosim.config.materials import MaterialConfig, load_material, overridden
from robosim.studies.calibration import experiment, flows
from robosim.studies.calibration import run as run_module
from robosim.studies.calibration.experiment import shear_strength, sliding_angle
from robosim.studies.calibration.flows import simulate_pour
from robosim.studies.calibration.measurements import HeapExperiment, PourExperiment

ANGLE, COHESION, DENSITY = 34.0, 12.0, 860.0


def direct_table(**change: Any) -> dict[str, Any]:
    """Measurements with closed forms, of a material whose numbers are known."""
    stresses = [50.0, 100.0, 200.0, 400.0]
    rng = np.random.default_rng(5)
    return {"description": "sugar of the lab", "material": "sugar",
            "sought": {"friction_angle_deg": [25, 45], "cohesion": [0, 60], "density": [700, 1000]},
            "experiments": {
                "cell": {"kind": "shear", "normal_stress": stresses, "noise": 2.0, "shear_stress": [
                    float(shear_strength(s, ANGLE, COHESION) + rng.normal(0, 2.0)) for s in stresses]},
                "cup": {"kind": "cup", "volume": 1e-4, "noise": 5e-4,
                        "masses": [float(DENSITY * 1e-4 + rng.normal(0, 5e-4)) for _ in range(3)]},
                "tray": {"kind": "tilt", "depth": 0.03, "noise": 1.0, "held_out": True, "angles": [
                    float(sliding_angle(0.03, DENSITY, ANGLE, COHESION) + rng.normal(0, 1.0)) for _ in range(3)]}},
            **change}


def run(folder: Path, table: dict[str, Any], *options: str) -> int:
    (folder / "lab.yaml").write_text(yaml.safe_dump(table))
    return main(["calibrate", str(folder / "lab.yaml"), "--out", str(folder / "out"), *options])


def figures(folder: Path) -> dict[str, Any]:
    return json.loads((folder / "out" / "calibration.json").read_text())


def test_experiments_with_a_closed_form_give_a_card_that_robosim_takes(tmp_path: Path) -> None:
    assert run(tmp_path, direct_table()) == 0
    found = figures(tmp_path)
    assert (found["is_calibrated"], found["reasons"], found["runs"]) == (True, [], 0)
    for name, true, bound in (("friction_angle_deg", ANGLE, 1.5), ("cohesion", COHESION, 3.0),
                              ("density", DENSITY, 15.0)):
        assert abs(found["numbers"][name]["best"] - true) < bound
        assert found["numbers"][name]["low"] < true < found["numbers"][name]["high"]
    assert [one["name"] for one in found["held_out"]] == ["tray"]
    card = load_material(str(tmp_path / "out" / "material.yaml"))
    assert card.density.value == found["numbers"]["density"]["best"]
    assert "calibrated; 90 % interval 8" in card.density.source
    assert card.make_law().friction_angle_deg == found["numbers"]["friction_angle_deg"]["best"]
    page = (tmp_path / "out" / "index.html").read_text()
    assert "sugar of the lab" in page and "shear cell at" in page


def test_data_that_cannot_tell_a_number_end_with_status_1(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One normal stress gives a sum of friction and cohesion alone; the advice is what separates them."""
    table = direct_table()
    table["experiments"] = {"cell": {"kind": "shear", "normal_stress": [20.0], "shear_stress": [25.0], "noise": 20.0},
                            "cup": table["experiments"]["cup"]}
    assert run(tmp_path, table) == 1 and not (tmp_path / "out" / "material.yaml").exists()
    card = load_material(str(tmp_path / "out" / "material_NOT_CALIBRATED.yaml"))
    assert card.friction_angle.source.startswith("NOT CALIBRATED, the data cannot tell it")
    error, best = capsys.readouterr().err, figures(tmp_path)["advice"][0]["measurement"]
    assert "data cannot tell friction_angle_deg: its 90% interval" in error and "narrow the numbers most" in error
    assert "shear cell" in best or "tilted tray" in best


def test_a_material_that_no_numbers_explain_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = direct_table()
    table["experiments"]["cell"]["shear_stress"] = [120.0, 60.0, 300.0, 90.0]
    assert run(tmp_path, table) == 1
    found = figures(tmp_path)
    assert found["probability"] < 1e-6 and found["fitted"][0]["rms"] > 50.0
    error = capsys.readouterr().err
    assert "not calibrated: no numbers within the ranges explain the data" in error and "cell differs most, by" in error


def write_quick_heaps(folder: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Path, list[int]]:
    """Heaps of a formula in place of the field; the list has the seed of every simulation."""
    seeds: list[int] = []

    def simulate(one: HeapExperiment, card: MaterialConfig, friction: float, distances: np.ndarray, seed: int = 0
                 ) -> np.ndarray:
        seeds.append(seed)
        phi, cohesion = card.friction_angle.value, card.cohesion.value
        slope = 0.4 * np.tan(np.radians(phi)) + 2 * cohesion / (850 * 9.81 * one.height)
        peak = (3 * one.radius**2 * one.height * slope**2) ** (1 / 3)
        return np.maximum(peak - slope * distances, 0.0)

    monkeypatch.setattr(experiment, "simulate_heap", simulate)
    monkeypatch.setattr(synthetic_heaps, "simulate_heap", simulate)
    path = write_heaps(folder, material="sugar", numbers={"friction_angle_deg": ANGLE, "cohesion": COHESION},
                       sought={"friction_angle_deg": [25, 45], "cohesion": [0, 40]},
                       heights={"low": 0.03, "tall": 0.12, "middle": 0.06}, held_out=("middle",), model_error=1e-4)
    seeds.clear()
    return path, seeds


def test_heaps_are_calibrated_and_finished_runs_are_not_repeated(tmp_path, monkeypatch, capsys) -> None:
    path, seeds = write_quick_heaps(tmp_path, monkeypatch)
    command = ["calibrate", str(path), "--runs", "20", "--out", str(tmp_path / "out")]
    assert main(command) == 0, capsys.readouterr().err
    first = figures(tmp_path)
    assert abs(first["numbers"]["friction_angle_deg"]["best"] - ANGLE) < 1.0
    assert abs(first["numbers"]["cohesion"]["best"] / COHESION - 1) < 0.15
    assert {one["name"]: one["held_out"] for one in first["fitted"] + first["held_out"]} == {
        "low": False, "tall": False, "middle": True}
    n = len(seeds)
    assert n == 2 * first["runs"] + 2 * 3 + run_module.SAMPLE_RUNS
    assert main(command) == 0 and len(seeds) == n and figures(tmp_path) == first


def test_an_interrupted_search_continues_to_the_same_result(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, seeds = write_quick_heaps(tmp_path, monkeypatch)
    command = ["calibrate", str(path), "--runs", "16", "--out", str(tmp_path / "out")]
    simulate = experiment.simulate_heap

    def fail(*arguments: Any) -> np.ndarray:
        if len(seeds) == 17:
            raise KeyboardInterrupt("SIGTERM")
        return simulate(*arguments)

    monkeypatch.setattr(experiment, "simulate_heap", fail)
    assert main(command) == 130 and json.loads((tmp_path / "out" / "status.json").read_text())["state"] == "interrupted"
    assert not (tmp_path / "out" / "index.html").exists()
    assert len(list((tmp_path / "out" / "rows").glob("*.json"))) == 17
    monkeypatch.setattr(experiment, "simulate_heap", simulate)
    main(command)
    continued, n = figures(tmp_path), len(seeds)
    shutil.rmtree(tmp_path / "out" / "rows")
    main(command)
    assert len(seeds) - n == n and figures(tmp_path) == continued


def test_an_experiment_that_could_be_made_is_ranked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In the formula, a column ten times as low depends on cohesion ten times as much."""
    path, _ = write_quick_heaps(tmp_path, monkeypatch)
    table = yaml.safe_load(path.read_text())
    heap_table = {key: value for key, value in table["experiments"]["tall"].items() if key not in ("data", "unit")}
    del table["experiments"]["low"], table["experiments"]["middle"]
    table["candidates"] = {"flat": {**heap_table, "height": 0.012}, "again": heap_table}
    path.write_text(yaml.safe_dump(table))
    assert main(["calibrate", str(path), "--runs", "16", "--out", str(tmp_path / "out")]) in (0, 1)
    advice = {one["measurement"]: one["widths"]["cohesion"] for one in figures(tmp_path)["advice"]}
    assert advice["flat (candidate)"] < 0.5 * advice["again (candidate)"]
    assert advice["again (candidate)"] == pytest.approx(advice["tall once more (heap)"], abs=0.2)
    table["candidates"] = {"cup": {"kind": "cup"}}
    path.write_text(yaml.safe_dump(table))
    assert main(["calibrate", str(path), "--out", str(tmp_path / "out")]) == 2


def test_the_volume_of_a_simulated_heap_is_that_of_its_column() -> None:
    """Heights at rings integrate to the column's volume, for any places of the particles."""
    rng = np.random.default_rng(0)
    particles = 0.05 * np.sqrt(rng.random(20_000))  # a disc of even height
    volume, cell = 1e-9, 0.005
    radii = np.linspace(0.0, 0.08, 4001)
    heights = flows.ring_heights(particles, volume, cell, radii)
    whole = np.trapezoid(heights * 2 * np.pi * radii, radii)
    assert whole == pytest.approx(4 * 20_000 * volume, rel=0.02)
    even = 4 * 20_000 * volume / (np.pi * 0.05**2)
    assert heights[radii < 0.04] == pytest.approx(np.full((radii < 0.04).sum(), even), rel=0.12)


@pytest.mark.slow
@pytest.mark.parametrize(("material", "true", "sought", "middle", "runs"), [
    ("flour", (37.0, 19.0), ([28, 46], [0, 60]), 0.08, "60"), ("sugar", (32.0, 9.0), ([25, 45], [0, 40]), 0.10, "40")])
def test_the_field_s_heaps_give_back_the_numbers_that_they_were_made_with(
        material: str, true: tuple[float, float], sought: tuple[list[int], list[int]], middle: float, runs: str,
        tmp_path: Path) -> None:
    """Two columns, 2 mm noise, other places of the particles than the search has; 60 to 100 s of a core."""
    names = ("friction_angle_deg", "cohesion")
    path = write_heaps(tmp_path, material=material, numbers=dict(zip(names, true)), sought=dict(zip(names, sought)),
                       heights={"low": 0.06, "middle": middle})
    assert main(["calibrate", str(path), "--runs", runs, "--out", str(tmp_path / "out")]) == 0
    found = figures(tmp_path)["numbers"]
    assert abs(found["friction_angle_deg"]["best"] - true[0]) < 1.0
    assert abs(found["cohesion"]["best"] / true[1] - 1) < 0.15


@pytest.mark.slow
def test_a_column_that_stands_does_not_tell_the_friction(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write_heaps(tmp_path, material="flour", numbers={"friction_angle_deg": 37.0, "cohesion": 60.0},
                       sought={"friction_angle_deg": [28, 46], "cohesion": [30, 100]}, heights={"low": 0.05})
    assert main(["calibrate", str(path), "--runs", "20", "--out", str(tmp_path / "out")]) == 1
    assert "data cannot tell friction_angle_deg" in capsys.readouterr().err


@pytest.mark.parametrize("count", [1, 50])
def test_a_heaped_scoop_tells_no_more_than_the_error_of_its_closed_form(count: int, tmp_path: Path) -> None:
    """However often its mass is read: with a known friction, mass / density is the volume, in error by model_error."""
    scoop = {"kind": "scoop", "volume": 1e-4, "rim_radius": 0.03, "noise": 1e-4, "masses": [0.105] * count}
    widths = []
    for model_error in (0.004, None, 0.0):
        table = direct_table(sought={"density": [500, 1300]})
        table["experiments"] = {"scoop": scoop if model_error is None else {**scoop, "model_error": model_error}}
        run(tmp_path, table)
        found = figures(tmp_path)["numbers"]["density"]
        widths.append((found["high"] - found["low"]) / (2 * 1.645 * found["best"]) * 0.105)
    assert widths[0] == pytest.approx(np.hypot(0.004, 1e-4 / np.sqrt(count)), rel=0.15) and widths[1] > 10 * widths[2]


def test_wall_friction_is_sought_and_stands_in_the_card(tmp_path: Path) -> None:
    table = direct_table(sought={"wall_friction": [0.1, 1.0]})
    table["experiments"] = {"plate": {"kind": "tilt", "depth": 0.01, "slides_on": "wall", "noise": 1.0,
                                      "angles": [21.5, 22.4, 21.9]}}
    assert run(tmp_path, table) == 0
    card = load_material(str(tmp_path / "out" / "material.yaml"))
    assert card.wall_friction.value == pytest.approx(np.tan(np.radians(21.93)), abs=0.01)
    assert card.make_law() == load_material("sugar").make_law()


def test_what_was_not_checked_is_said_on_stdout_in_the_card_and_in_the_figures(tmp_path, capsys) -> None:
    table = direct_table()
    assert run(tmp_path, table) == 0 and "not checked" not in capsys.readouterr().out
    assert (figures(tmp_path)["is_checked"], figures(tmp_path)["cautions"]) == (True, [])
    del table["experiments"]["tray"]
    assert run(tmp_path, table) == 0 and "not checked on a held-out experiment" in capsys.readouterr().out
    card = load_material(str(tmp_path / "out" / "material.yaml"))
    assert card.density.source.startswith("calibrated, not checked on a held-out experiment; 90 % interval")
    assert figures(tmp_path)["is_checked"] is False
    assert figures(tmp_path)["cautions"] == ["not checked on a held-out experiment"]
    assert "not checked on a held-out experiment" in (tmp_path / "out" / "index.html").read_text()


@pytest.mark.slow
def test_the_field_pours_what_is_in_the_box_later_with_more_friction() -> None:
    table = PourExperiment.model_validate({
        "kind": "pour", "data": "m.csv", "unit": "g", "noise": 0.001, "length": 0.06, "depth": 0.05, "width": 0.08,
        "fill_height": 0.04, "tilt_speed": 90.0, "end_angle": 120.0, "cells": 6})
    times = np.linspace(0.0, 1.6, 9)
    masses = [simulate_pour(table, overridden(load_material("sugar"), {"friction_angle_deg": phi}), 0.4, times)
              for phi in (28.0, 40.0)]
    for mass in masses:
        assert mass[0] == 0.0 and (np.diff(mass) >= -1e-9).all()
        assert 0.5 * 850 * 0.06 * 0.08 * 0.04 < mass[-1] <= 850 * 0.06 * 0.08 * 0.04 * (1 + 1e-9)
    assert masses[1][:-1].sum() < masses[0][:-1].sum()
