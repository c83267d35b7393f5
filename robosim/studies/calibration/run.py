"""`robosim calibrate`: from a file of measurements to a card and a page, or to the reasons why there is no card."""

import sys
from collections.abc import Sequence
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from plotly.graph_objects import Scatter

from robosim.base.digests import code_digest, digest
from robosim.base.files import ROWS
from robosim.base.output_folder import OutputFolder
from robosim.base.progress import Progress
from robosim.base.study import Store
from robosim.config.materials import MaterialConfig, number_names
from robosim.config.settings import Setting
from robosim.reports.page import Page
from robosim.reports.plot import COLOURS, Plot
from robosim.studies.calibration.emulator import Emulator
from robosim.studies.calibration.experiment import Numbers, Trial, make_candidates, make_trial
from robosim.studies.calibration.measurements import WALL_FRICTION, Measurements, load_measurements
from robosim.studies.calibration.search import Ranges, Search, search
from robosim.studies.calibration.verdict import Advice, Residual, Verdict, advise, judge, residual

CARD, REFUSED = "material.yaml", "material_NOT_CALIBRATED.yaml"
"""Names of the card; of one that missed a bound the name says so."""
CHECK_SEED = 1_000_000
"""Seed of the runs with the best numbers: none of the search's."""
CHECK_RUNS, SAMPLE_RUNS = 3, 16
"""Runs of a fitted experiment with the best numbers; of one held out and of a candidate with samples of the
posterior."""


def make_page(title: str, verdict: Verdict, found: Search, ranges: Ranges, trials: Sequence[Trial],
              fits: dict[str, np.ndarray], advice: list[Advice]) -> Page:
    """Make the page. fits: what each trial reads with the best numbers, in its unit."""
    page = Page(f"Calibration: {title}")
    page.set_verdict("; ".join([*(verdict.reasons or ["calibrated"]), *verdict.cautions]), holds=verdict.is_calibrated)
    page.add_heading("Numbers")
    page.add_table(["number", "best", "90 %, from", "to", "range, from", "to", "interval / range", "narrowed"],
                   [[one.name, one.best, one.low, one.high, one.least, one.most, one.width,
                     "pass" if one.is_determined else "fail"] for one in verdict.findings])
    page.add_heading("Experiments")
    page.add_table(["experiment", "role", "readings", "chi square", "probability", "rms difference", "unit",
                    "explained"],
                   [[one.name, "held out" if one.held_out else "fitted", one.readings, one.chi_square, one.probability,
                     one.rms, one.unit, "pass" if one.is_explained else "fail"]
                    for one in (*verdict.fits, *verdict.checks)])
    page.add_text(f"Probability of the fitted residuals together: {verdict.probability:.3g}. Simulated "
                  f"{len(found.points)} x; the emulators "
                  + ("add nothing to the errors of the readings." if found.is_settled else
                     "still add to the errors of the readings: more runs would narrow the intervals."))
    for trial in trials:
        page.add_plot(draw_fit(trial, fits[trial.name]))
    samples = ranges.scaled(found.posterior.samples)
    if len(ranges.names) > 1:
        page.add_heading("Samples of the numbers")
        for i, j in combinations(range(len(ranges.names)), 2):
            page.add_plot(draw_samples(samples, ranges, i, j, ranges.scaled(found.posterior.best)))
        page.add_table(["correlation", *ranges.names],
                       [[name, *row] for name, row in zip(ranges.names, found.posterior.correlation().tolist())])
    page.add_heading("Which measurement would narrow them most")
    page.add_table(["measurement", *(f"{name}: interval, x" for name in ranges.names)],
                   [[one.measurement, *one.widths.values()] for one in advice])
    return page


def draw_fit(trial: Trial, values: np.ndarray) -> str:
    """Draw the readings of a trial with their errors, and what the best numbers give; return HTML."""
    plot = Plot(f"{trial.name} ({trial.kind}, {'held out' if trial.held_out else 'fitted'})", trial.axis_name,
                f"[{trial.unit}]", logarithmic=False, height=320)
    plot.figure.add_trace(Scatter(
        x=trial.axis, y=trial.readings, mode="markers", name="measured", marker={"color": COLOURS[0], "size": 7},
        error_y={"type": "data", "array": trial.errors, "color": COLOURS[0], "thickness": 1}))
    plot.figure.add_trace(Scatter(x=trial.axis, y=values, mode="lines", name="best numbers",
                                  line={"color": COLOURS[1]}))
    return plot.html()


def draw_samples(samples: np.ndarray, ranges: Ranges, i: int, j: int, best: np.ndarray) -> str:
    """Draw the samples (s, d) of two numbers within their ranges, and the best (d,); return HTML."""
    plot = Plot("", ranges.names[i], ranges.names[j], logarithmic=False, height=380)
    plot.figure.update_layout(xaxis_range=[ranges.lower[i], ranges.upper[i]],
                              yaxis_range=[ranges.lower[j], ranges.upper[j]])
    for points, name, marker in (
            (samples[:: max(len(samples) // 1000, 1)], "samples", {"size": 3, "opacity": 0.4, "color": COLOURS[0]}),
            (best[None], "best", {"size": 10, "symbol": "x", "color": COLOURS[1]})):
        plot.figure.add_trace(Scatter(x=points[:, i], y=points[:, j], mode="markers", name=name, marker=marker))
    return plot.html()


class Runs:
    """Simulations of a folder, kept on the disk: a run that is asked for again is not simulated again.
    inputs: what all of them depend on."""

    def __init__(self, folder: Path, inputs: Any) -> None:
        self._store, self._inputs = Store(folder / ROWS), digest(inputs)

    def simulate(self, trial: Trial, numbers: Numbers, seed: int) -> np.ndarray:
        """Return what a trial would read (n,), stored or simulated."""
        if trial.is_direct:
            return trial.simulate(numbers, seed)
        run = {"trial": trial.name, "seed": seed, **{key: f"{value:.12g}" for key, value in numbers.items()}}
        key = digest([self._inputs, run])
        found = self._store.find(key)
        if found is None:
            found = ([float(value) for value in trial.simulate(numbers, seed)],)
            self._store.keep(key, *found, run=run)
        return np.array(found[0])


def calibrate(path: Path, out: Path, *, runs: int = 60, seed: int = 0, settings: tuple[Setting, ...] = ()) -> int:
    """Calibrate the material of a file of measurements, and write card, figures and page into a folder.
    runs: most simulations of each experiment. Returns 0 when the material is calibrated, 1 otherwise. Raises
    ConfigError for measurements that cannot be used, mpm.SimulationDiverged."""
    measurements = load_measurements(path, settings)
    trials = [make_trial(measurements, name, one) for name, one in measurements.experiments.items()]
    ranges = Ranges.of(measurements.config.sought)
    with OutputFolder(out) as folder:
        folder.clear((CARD, REFUSED, "calibration.json", "index.html"))
        store = Runs(folder.path, list_inputs(measurements))
        fitted = [trial for trial in trials if not trial.held_out]
        is_simulated = any(not trial.is_direct for trial in fitted)
        with Progress(total=runs, desc="calibrate", unit="runs", disable=not is_simulated) as progress:
            found = search(fitted, ranges, store.simulate, runs=runs, seed=seed, report=progress.update)
        fits, checks, best = run_best(trials, ranges, found, store)
        verdict = judge(ranges, found, fits, checks)
        possible = {trial.name: emulate(trial, ranges, found, store) for trial in make_candidates(measurements)}
        advice = advise(measurements, trials, ranges, found, possible)
        card = make_card(measurements, verdict)
        folder.write_yaml(CARD if verdict.is_calibrated else REFUSED, card.model_dump(mode="json", exclude_none=True))
        folder.write_json("calibration.json", summarize(measurements, verdict, found, ranges, advice))
        page = make_page(measurements.config.description, verdict, found, ranges, trials, best, advice)
        folder.write_text("index.html", page.html())
    print_verdict(verdict, advice)
    print(out / "index.html")
    return 0 if verdict.is_calibrated else 1


def run_best(trials: list[Trial], ranges: Ranges, found: Search, store: Runs
             ) -> tuple[list[Residual], list[Residual], dict[str, np.ndarray]]:
    """Simulate every trial with the best numbers; return residuals of those fitted and held out, and their values.
    Means over some runs: the places of particles are a part of the errors, not of the numbers. Those held out are
    predicted over the samples of the posterior, so that its covariance counts among their errors."""
    fits, checks, best = [], [], {}
    for trial in trials:
        if trial.held_out:
            best[trial.name], covariance = predict_held_out(trial, ranges, found, store)
            checks.append(residual(trial, best[trial.name], covariance))
        else:
            own = ranges.numbers(found.posterior.best)
            seeds = range(CHECK_SEED, CHECK_SEED + (1 if trial.is_direct else CHECK_RUNS))
            best[trial.name] = np.mean([store.simulate(trial, own, seed) for seed in seeds], axis=0)
            variance = np.zeros(len(trial.errors))
            if trial.name in found.emulators:
                variance = found.emulators[trial.name].predict(found.posterior.best[None])[1][0] * trial.errors**2
            fits.append(residual(trial, best[trial.name], np.diag(variance)))
    return fits, checks, best


def predict_held_out(trial: Trial, ranges: Ranges, found: Search, store: Runs) -> tuple[np.ndarray, np.ndarray]:
    """Return mean (n,) and covariance (n, n) of what a trial would read, over the samples of the posterior."""
    samples = found.posterior.samples
    if trial.is_direct:
        values = np.array([trial.simulate(ranges.numbers(point), 0) for point in samples])
        return values.mean(0), np.atleast_2d(np.cov(values.T))
    mean, covariance = emulate(trial, ranges, found, store).distribution(samples)
    return mean * trial.errors, covariance * np.outer(trial.errors, trial.errors)


def emulate(trial: Trial, ranges: Ranges, found: Search, store: Runs) -> Emulator:
    """Simulate a trial with samples of the posterior; return its emulator."""
    samples = found.posterior.samples
    chosen = samples[np.random.default_rng(CHECK_SEED).choice(len(samples), SAMPLE_RUNS)]
    outputs = [store.simulate(trial, ranges.numbers(point), CHECK_SEED + k) for k, point in enumerate(chosen)]
    return Emulator(chosen, np.array(outputs) / trial.errors)


def list_inputs(measurements: Measurements) -> list[Any]:
    """Return what all runs depend on: experiments, data, card and code."""
    config = measurements.config.model_dump(exclude={"description", "sought"})
    files = [Path(data).read_bytes().hex() for one in measurements.experiments.values()
             if (data := getattr(one, "data", None))]
    return [config, files, measurements.card.model_dump(), code_digest("robosim.studies.calibration.experiment")]


def make_card(measurements: Measurements, verdict: Verdict) -> MaterialConfig:
    """Return the card with the best numbers, each with its interval and the experiments that it comes from."""
    numbers = {one.name: one.best for one in verdict.findings}
    card = measurements.changed_card(numbers)
    known = number_names(card)
    names = ", ".join(f"{one.name} ({measurements.config.experiments[one.name]['kind']})" for one in verdict.fits)
    changed: dict[str, Any] = {"description": measurements.config.description}
    for one in verdict.findings:
        state = "calibrated" if verdict.is_calibrated else "NOT CALIBRATED, best fit" if one.is_determined else \
            "NOT CALIBRATED, the data cannot tell it"
        source = f"{', '.join([state, *verdict.cautions])}; 90 % interval {one.low:.4g} to {one.high:.4g}; from {names}"
        if one.name == WALL_FRICTION:
            changed[one.name] = {"value": one.best, "unit": "1", "source": source}
        else:
            changed[known[one.name]] = getattr(card, known[one.name]).model_copy(update={"source": source}).model_dump()
    return type(card).model_validate({**card.model_dump(), **changed})


def summarize(measurements: Measurements, verdict: Verdict, found: Search, ranges: Ranges, advice: list[Advice]
              ) -> dict[str, Any]:
    """Return all figures, for calibration.json."""
    return {"is_calibrated": verdict.is_calibrated, "reasons": verdict.reasons, "cautions": verdict.cautions,
            "is_checked": bool(verdict.checks),
            "description": measurements.config.description, "material": measurements.config.material,
            "numbers": {
                one.name: {**one._asdict(), "is_determined": one.is_determined, "interval_over_range": one.width}
                for one in verdict.findings},
            "correlation": {"names": list(ranges.names), "matrix": found.posterior.correlation().tolist()},
            "probability": verdict.probability, "fitted": [one._asdict() for one in verdict.fits],
            "held_out": [one._asdict() for one in verdict.checks],
            "advice": [one._asdict() for one in advice], "runs": len(found.points), "is_settled": found.is_settled}


def print_verdict(verdict: Verdict, advice: list[Advice]) -> None:
    """Print the numbers and what was not shown to stdout, and what speaks against them to stderr."""
    for one in verdict.findings:
        print(f"{one.name} = {one.best:.4g}, 90 % {one.low:.4g} to {one.high:.4g}")
    for caution in verdict.cautions:
        print(caution)
    for reason in verdict.reasons:
        print(f"robosim calibrate: {reason}", file=sys.stderr)
    if not verdict.is_calibrated and advice:
        print(f"robosim calibrate: of the measurements considered, this would narrow the numbers most: "
              f"{advice[0].measurement}", file=sys.stderr)
