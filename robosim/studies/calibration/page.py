"""The page of a calibration: verdict, numbers, fits, correlation, and which measurement would narrow them most."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from plotly.graph_objects import Scatter

from robosim.reports.page import Page
from robosim.reports.plot import COLOURS, Plot
from robosim.studies.calibration.experiment import Trial
from robosim.studies.calibration.search import Ranges, Search
from robosim.studies.calibration.verdict import Advice, Verdict


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
