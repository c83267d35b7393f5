"""The search on a quick analytic simulator, and experiments with a closed form against hand calculations."""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("sklearn")

from robosim.studies.calibration.emulator import Emulator
from robosim.studies.calibration.experiment import Numbers, Trial, predict, shear_strength, sliding_angle
from robosim.studies.calibration.measurements import CupExperiment, ScoopExperiment, ShearExperiment, TiltExperiment
from robosim.studies.calibration.run import Runs, predict_held_out
from robosim.studies.calibration.search import Posterior, Ranges, Search, choose, sample_posterior, search
from robosim.studies.calibration.verdict import (
    LEAST_PROBABILITY,
    candidates,
    expected_widths,
    judge,
    residual,
    usual_errors,
)
from robosim.studies.verification.cases.beds import shear_ratio

RANGES = Ranges.of({"angle": (20.0, 45.0), "cohesion": (0.0, 60.0)})
TRUE = {"angle": 33.0, "cohesion": 21.0}
RADII = np.linspace(0.0, 3.0, 12)
ERROR = 0.02


def profile(numbers: Numbers, seed: int) -> np.ndarray:
    """A heap's profile, as a formula, with the noise that the places of particles give."""
    own = np.random.default_rng(seed + 1).normal(0.0, 0.004, len(RADII))
    return np.exp(-RADII * numbers["angle"] / 35) * (3 + numbers["cohesion"] / 20) + own


def make_trial(simulate: Callable[[Numbers, int], np.ndarray] = profile, seed: int = 7,
               is_direct: bool = False) -> Trial:
    readings = simulate(TRUE, 999 + seed) + np.random.default_rng(seed).normal(0.0, ERROR, len(RADII))
    return Trial("heap", "heap", readings, np.full(len(RADII), ERROR), simulate, is_direct, False, RADII, "r", "m")


def run_search(trial: Trial, runs: int = 40):
    found = search([trial], RANGES, lambda one, numbers, seed: one.simulate(numbers, seed), runs=runs)
    values = trial.simulate(RANGES.numbers(found.posterior.best), 5)
    return found, judge(RANGES, found, [residual(trial, values)], [])


def test_the_numbers_are_found_within_their_intervals() -> None:
    """A held-out experiment that is not predicted speaks against them; a search that is not settled is said so."""
    trial = make_trial()
    found, verdict = run_search(trial)
    assert verdict.is_calibrated and found.is_settled, verdict.reasons
    angle, cohesion = verdict.findings
    assert abs(angle.best - TRUE["angle"]) < 1.0 and abs(cohesion.best - TRUE["cohesion"]) < 0.15 * TRUE["cohesion"]
    assert all(one.low < one.best < one.high and one.width < 0.2 for one in verdict.findings)
    values = profile(RANGES.numbers(found.posterior.best), 5)
    held_out = residual(trial._replace(name="tall", held_out=True), values + 0.1)
    assert not judge(RANGES, found, verdict.fits, [held_out]).is_calibrated
    assert judge(RANGES, found, verdict.fits, [residual(trial._replace(held_out=True), values)]).is_calibrated
    assert verdict.cautions == ["not checked on a held-out experiment"]
    (unsettled,) = judge(RANGES, found._replace(is_settled=False), verdict.fits, verdict.fits).cautions
    assert unsettled.startswith("search not settled")


@pytest.mark.parametrize("is_direct", [True, False], ids=["closed form", "emulated"])
def test_intervals_contain_the_truth_as_often_as_they_say(is_direct: bool) -> None:
    """Of 20 intervals of 90 % at least 14: fewer have a probability of 0.2 % by the binomial distribution."""
    held = 0
    for seed in range(10):
        trial = make_trial(lambda numbers, _: profile(numbers, -1), seed=seed, is_direct=is_direct)
        found = search([trial], RANGES, lambda one, numbers, k: one.simulate(numbers, k), runs=16)
        low, high = RANGES.scaled(found.posterior.intervals().T)
        held += sum(low[k] <= value <= high[k] for k, value in enumerate(TRUE.values()))
    assert held >= 14


def test_the_posterior_of_a_linear_model_is_its_normal_distribution() -> None:
    """Mean and covariance of a normal likelihood far from the ends of the range."""
    matrix = np.array([[40.0, 12.0], [12.0, 90.0]])
    mean = np.array([0.45, 0.55])
    posterior = sample_posterior(lambda p: -0.5 * np.einsum("mi,ij,mj->m", p - mean, matrix @ matrix, p - mean), 2, 0)
    covariance = np.linalg.inv(matrix @ matrix)
    assert posterior.best == pytest.approx(mean, abs=1e-3)
    assert posterior.samples.mean(0) == pytest.approx(mean, abs=0.2 * math.sqrt(covariance.max()))
    assert np.cov(posterior.samples.T) == pytest.approx(covariance, rel=0.3, abs=0.3 * covariance.max())


def test_the_emulator_reproduces_a_smooth_function_within_its_own_error() -> None:
    rng = np.random.default_rng(0)
    points, asked = rng.random((30, 2)), rng.random((50, 2))

    def outputs(p: np.ndarray) -> np.ndarray:
        return np.array([profile(RANGES.numbers(one), -1) for one in p]) / ERROR

    emulator = Emulator(points, outputs(points))
    mean, variance = emulator.predict(asked)
    assert np.abs(mean - outputs(asked)).max() < 2.0  # standard deviations of the readings, of 150
    z = (mean - outputs(asked)) / np.sqrt(variance)
    assert np.sqrt((z**2).mean()) < 2.0


def test_the_next_runs_are_the_least_certain_and_apart() -> None:
    samples = np.linspace(0.0, 1.0, 21)[:, None]
    uncertain = 1.0 - np.abs(samples[:, 0] - 0.5)
    chosen = np.array(choose(samples, uncertain, np.array([[0.5]]), 3))[:, 0]
    assert np.abs(chosen - 0.5).min() > 0.05
    assert np.abs(np.subtract.outer(chosen, chosen))[np.triu_indices(3, 1)].min() > 0.05


def test_an_expected_width_is_that_of_the_linear_update() -> None:
    """One number of unit variance, read with unit error: the variance halves; what is not read stays."""
    samples = np.random.default_rng(0).normal(size=(20_000, 2))
    widths = expected_widths(samples, samples[:, :1], np.ones(1), ["read", "other"])
    assert widths["read"] == pytest.approx(math.sqrt(0.5), rel=0.03) and widths["other"] == pytest.approx(1.0, rel=0.01)


def test_the_error_of_a_possible_shear_cell_is_a_share_of_each_reading() -> None:
    cell = next(one for name, one in candidates(850.0, False).items() if name.startswith("shear cell"))
    low, high = usual_errors(cell, np.array([[300.0, 1200.0], [340.0, 1360.0]]))
    assert (low, high) == pytest.approx((0.05 * 320.0, 0.05 * 1280.0))
    cup = next(one for name, one in candidates(850.0, False).items() if name.startswith("cup"))
    assert usual_errors(cup, np.full((4, 3), 0.085)) == pytest.approx([850e-6] * 3)


def test_strength_without_pressure_is_the_apex_times_the_ratio() -> None:
    """Without cohesion a layer slides at the same angle, whatever its depth; a thin cohesive one never slides."""
    assert shear_strength(0.0, 30.0, 50.0) == pytest.approx(shear_ratio(30.0) * 50.0 / math.tan(math.radians(30.0)))
    assert shear_strength(100.0, 30.0, 0.0) == pytest.approx(100.0 * shear_ratio(30.0))
    expected = math.degrees(math.atan(shear_ratio(30.0)))
    assert [sliding_angle(depth, 850.0, 30.0, 0.0) for depth in (0.005, 0.5)] == pytest.approx([expected] * 2)
    assert sliding_angle(0.001, 560.0, 35.0, 30.0) == 90.0


@pytest.mark.parametrize("depth", [0.005, 0.02, 0.1])
def test_a_sliding_layer_is_in_balance(depth: float) -> None:
    """Pull of the weight = strength under its pressure, along the base."""
    density, phi, cohesion = 560.0, 35.0, 12.0
    angle = math.radians(sliding_angle(depth, density, phi, cohesion))
    weight = density * 9.81 * depth
    if angle < math.pi / 2:
        assert weight * math.sin(angle) == pytest.approx(shear_strength(weight * math.cos(angle), phi, cohesion))


def test_readings_that_are_predicted() -> None:
    numbers = {"density": 800.0, "friction_angle_deg": 30.0, "cohesion": 0.0, "wall_friction": 0.5}
    cup = CupExperiment(kind="cup", masses=[0.1, 0.1], noise=0.001, volume=2e-4)
    assert predict(cup, numbers) == pytest.approx([0.16, 0.16])
    wall = TiltExperiment(kind="tilt", angles=[25.0], noise=1.0, depth=0.01, slides_on="wall")
    assert predict(wall, numbers) == pytest.approx([math.degrees(math.atan(0.5))])
    shear = ShearExperiment(kind="shear", normal_stress=[100.0, 200.0], shear_stress=[1.0, 1.0], noise=1.0)
    assert predict(shear, numbers) == pytest.approx([100 * shear_ratio(30.0), 200 * shear_ratio(30.0)])
    scoop = ScoopExperiment(kind="scoop", masses=[0.1], noise=0.001, volume=1e-4, rim_radius=0.03)
    cone = math.pi * 0.03**3 * shear_ratio(30.0) / 3  # a flank without cohesion has the ratio as its slope
    assert predict(scoop, numbers) == pytest.approx([800.0 * (1e-4 + cone)])


LINEAR, NOISE = Ranges.of({"a": (0.0, 1.0), "b": (0.0, 1.0)}), 0.01
AXIS, WIDTHS = np.linspace(0.0, 1.0, 15), np.array([0.04, 0.06])
"""Standard deviations of the posterior: they move the readings by several of their errors."""


def read_line(numbers: Numbers, seed: int) -> np.ndarray:
    return numbers["a"] + numbers["b"] * AXIS


def rejected_share(count: int, store: Runs, *, is_direct: bool, offset: float = 0.0) -> float:
    """Share of calibrations of known numbers whose held-out experiment is said not to be predicted."""
    rng, rejected = np.random.default_rng(3), 0
    for k in range(count):
        truth = np.array([0.5, 0.5])
        mean = truth + WIDTHS * rng.normal(size=2)
        found = Search(Posterior(mean + WIDTHS * rng.normal(size=(400, 2)), mean), {}, np.empty((0, 2)), True)
        readings = read_line(LINEAR.numbers(truth), 0) + NOISE * rng.normal(size=15) + offset * np.cos(9 * AXIS)
        trial = Trial(f"tall {k}", "heap", readings, np.full(15, NOISE), read_line, is_direct, True, AXIS, "r", "m")
        rejected += not residual(trial, *predict_held_out(trial, LINEAR, found, store)).is_explained
    return rejected / count


@pytest.mark.parametrize(("is_direct", "count"), [
    (True, 400), pytest.param(False, 60, marks=pytest.mark.slow)], ids=["closed form", "emulated"])
def test_correct_calibrations_are_rejected_as_seldom_as_the_bound_says(is_direct: bool, count: int, tmp_path) -> None:
    """At most as many as the binomial distribution exceeds with a probability of about 1 %."""
    share = rejected_share(count, Runs(tmp_path, "key"), is_direct=is_direct)
    assert share <= LEAST_PROBABILITY + 2.5 * np.sqrt(LEAST_PROBABILITY / count)


def test_a_misfit_that_no_numbers_give_is_rejected(tmp_path: Path) -> None:
    """Readings off by three of their errors in a shape that the numbers do not have."""
    assert rejected_share(20, Runs(tmp_path, "key"), is_direct=True, offset=3 * NOISE) > 0.9
