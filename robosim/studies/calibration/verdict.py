"""Verdict: whether the best numbers explain the readings, whether these tell the numbers, and what would help."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from robosim.config.materials import number_names
from robosim.studies.calibration import experiment
from robosim.studies.calibration.emulator import Emulator
from robosim.studies.calibration.experiment import Trial
from robosim.studies.calibration.measurements import (
    CupExperiment,
    Experiment,
    Measurements,
    ShearExperiment,
    TiltExperiment,
)
from robosim.studies.calibration.search import INTERVAL, Ranges, Search, predict

LEAST_PROBABILITY = 0.01
"""Of residuals as large as those of the best numbers, were the errors as stated; below it nothing is calibrated."""
MOST_WIDTH = 0.75
"""Width of an interval over that of the same probability of its range, from which on the data cannot tell a number."""
SHEAR_ERROR = 0.05
"""Usual error of a shear cell, in the shear stress that it reads."""


class Residual(NamedTuple):
    """How far an experiment is from what the best numbers give."""

    name: str
    held_out: bool
    chi_square: float
    readings: int
    probability: float
    """Of a chi square at least as large, were the errors as stated."""
    rms: float
    """Root mean square difference, in `unit`."""
    unit: str

    @property
    def is_explained(self) -> bool:
        """Whether the difference may be due to the errors."""
        return self.probability >= LEAST_PROBABILITY


class Finding(NamedTuple):
    """What is found of a number."""

    name: str
    best: float
    low: float
    high: float
    least: float
    """Of its range; `most` likewise."""
    most: float

    @property
    def width(self) -> float:
        """Width of the interval over that of the same probability of its range."""
        return (self.high - self.low) / (INTERVAL * (self.most - self.least))

    @property
    def is_determined(self) -> bool:
        """Whether the data narrow its range."""
        return self.width <= MOST_WIDTH


class Verdict(NamedTuple):
    """Whether a material is calibrated, with all reasons against it."""

    findings: list[Finding]
    fits: list[Residual]
    """Of the experiments that were fitted, `checks` of those held out."""
    checks: list[Residual]
    probability: float
    """Of the fitted residuals together."""
    reasons: list[str]
    cautions: list[str]
    """What was not shown, though nothing speaks against the numbers."""

    @property
    def is_calibrated(self) -> bool:
        """Whether nothing speaks against it."""
        return not self.reasons


def judge(ranges: Ranges, found: Search, fits: list[Residual], checks: list[Residual]) -> Verdict:
    """Judge a search by the residuals of its best numbers."""
    low, high = ranges.scaled(found.posterior.intervals().T)
    numbers = np.stack([ranges.scaled(found.posterior.best), low, high, ranges.lower, ranges.upper], axis=1)
    findings = [Finding(name, *row) for name, row in zip(ranges.names, numbers.tolist())]
    total, count = sum(one.chi_square for one in fits), sum(one.readings for one in fits)
    probability = float(chi2.sf(total, max(count - len(findings), 1)))
    reasons = []
    if probability < LEAST_PROBABILITY:
        worst = max(fits, key=lambda one: one.chi_square / one.readings)
        reasons.append(f"not calibrated: no numbers within the ranges explain the data; chi square {total:.3g} of "
                       f"{count} readings, probability {probability:.2g} (accepted: {LEAST_PROBABILITY:g} or more); "
                       f"{worst.name} differs most, by {worst.rms:.3g} {worst.unit}")
    reasons += [f"data cannot tell {one.name}: its {INTERVAL:.0%} interval, {one.low:.4g} to {one.high:.4g}, has "
                f"{one.width:.0%} of the width that the range alone gives (accepted: up to {MOST_WIDTH:.0%})"
                for one in findings if not one.is_determined]
    reasons += [f"held-out experiment {one.name} is not predicted: it differs by {one.rms:.3g} {one.unit}, probability "
                f"{one.probability:.2g} (accepted: {LEAST_PROBABILITY:g} or more)" for one in checks
                if not one.is_explained]
    cautions = [] if checks else ["not checked on a held-out experiment"]
    if not found.is_settled:
        cautions.append("search not settled, more runs would narrow the intervals")
    return Verdict(findings, fits, checks, probability, reasons, cautions)


def residual(trial: Trial, values: np.ndarray, covariance: np.ndarray | float = 0.0) -> Residual:
    """Compare a trial with values (n,) in its unit; covariance (n, n): of the values, in its unit squared.
    Chi square is the squared Mahalanobis distance: numbers that are uncertain move all readings together."""
    difference = trial.readings - values
    square, n = float(difference @ np.linalg.solve(np.diag(trial.errors**2) + covariance, difference)), len(difference)
    return Residual(trial.name, trial.held_out, square, n, float(chi2.sf(square, n)),
                    float(np.sqrt((difference**2).mean())), trial.unit)


class Advice(NamedTuple):
    """What a further measurement would do."""

    measurement: str
    widths: dict[str, float]
    """Number -> expected width of its interval over the present one."""


def advise(measurements: Measurements, trials: Sequence[Trial], ranges: Ranges, found: Search,
           possible: dict[str, Emulator]) -> list[Advice]:
    """Rank further measurements by what they would narrow most.
    Each fitted experiment once more, measurements with a closed form, and the file's candidates by their emulators.
    Expected covariances are those of a linear regression of the numbers on the predicted readings over the posterior's
    samples (Bayes linear; Goldstein & Wooff 2007), which needs no data of the measurement."""
    samples = found.posterior.samples[:: max(len(found.posterior.samples) // 400, 1)]
    means = {f"{trial.name} once more ({trial.kind})": predict(trial, samples, ranges, found.emulators)[0]
             for trial in trials if not trial.held_out}
    means |= {f"{name} (candidate)": emulator.predict(samples)[0] for name, emulator in possible.items()}
    read = {name: (mean, np.ones(mean.shape[1])) for name, mean in means.items()}
    card = {key: getattr(measurements.card, field).value for key, field in number_names(measurements.card).items()}
    if "friction_angle_deg" in card:
        for name, one in candidates(card["density"], "wall_friction" in ranges.names).items():
            values = np.array([experiment.predict(one, card | ranges.numbers(point)) for point in samples])
            read[name] = values, usual_errors(one, values) ** 2
    advice = [Advice(name, expected_widths(samples, *one, ranges.names)) for name, one in read.items()]
    return sorted(advice, key=lambda one: np.log(np.maximum(list(one.widths.values()), 1e-6)).sum())


def usual_errors(one: Experiment, values: np.ndarray) -> np.ndarray:
    """Return standard deviations (n,) of a candidate's readings, of their predicted values (s, n).
    Those of a shear cell are a share of each reading's own stress."""
    if isinstance(one, ShearExperiment):
        return np.maximum(SHEAR_ERROR * values.mean(0), 1e-3)  # as in a file of measurements
    return np.full(values.shape[1], one.noise)  # pyright: ignore[reportAttributeAccessIssue]


def candidates(density: float, has_wall: bool) -> dict[str, Experiment]:
    """Return measurements that nearly every laboratory can make, with the errors that they usually have."""
    stress = density * experiment.G * 0.05  # of a layer of 5 cm
    found: dict[str, Experiment] = {
        f"tilted tray, layer of {1e3 * depth:g} mm, 3 x, error 1 deg": TiltExperiment(
            kind="tilt", angles=[30.0] * 3, noise=1.0, depth=depth) for depth in (0.005, 0.05)}
    found[f"shear cell at {stress:.0f} and {4 * stress:.0f} Pa, error {100 * SHEAR_ERROR:.0f} %"] = ShearExperiment(
        kind="shear", normal_stress=[stress, 4 * stress], shear_stress=[stress, stress], noise=SHEAR_ERROR * stress)
    found["cup of 100 ml, 3 x, error 1 %"] = CupExperiment(
        kind="cup", masses=[density * 1e-4] * 3, noise=density * 1e-6, volume=1e-4)
    if has_wall:
        found["tray of the wall's surface, tilted, 3 x, error 1 deg"] = TiltExperiment(
            kind="tilt", angles=[20.0] * 3, noise=1.0, depth=0.01, slides_on="wall")
    return found


def expected_widths(samples: np.ndarray, values: np.ndarray, variances: np.ndarray, names: Sequence[str]
                    ) -> dict[str, float]:
    """Return number -> standard deviation after a measurement over the present one.
    samples: (s, d) numbers; values: (s, n) predicted readings; variances: (n,) of their errors."""
    x, y = samples - samples.mean(0), values - values.mean(0)
    own, cross, seen = x.T @ x / len(x), x.T @ y / len(x), y.T @ y / len(x)
    left = own - cross @ np.linalg.solve(seen + np.diag(variances), cross.T)
    ratio = np.sqrt(np.clip(np.diag(left), 0.0, None) / np.maximum(np.diag(own), 1e-300))
    return dict(zip(names, ratio.tolist()))
