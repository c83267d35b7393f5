"""The page of a rehearsal: verdict, film, recording, curves, figures, configuration."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy.ndimage import uniform_filter1d

from robosim.episode.sheet import choose_moment
from robosim.recordings.reader import FILE, Recording
from robosim.rehearsal.comparison import replay_charts
from robosim.rehearsal.dosing_driver import DoseSample, DosingDriver
from robosim.rehearsal.metrics import Bound, compute_tracking_errors, get_bounds
from robosim.rehearsal.run import RehearsalRun
from robosim.rendering.video import read_comment, read_frame
from robosim.reports.curves import Chart, Curve
from robosim.reports.page import Page
from robosim.reports.plot import draw_charts

AVERAGED_STEPS = 20
"""Steps over which plotted forces are averaged; those in trajectory.csv are not."""
UNITS = {"m": "m", "kg": "kg", "s": "s", "deg": "deg", "N": "N", "Nm": "N m"}
"""Last word of a figure's name -> its unit."""


def make_page(run: RehearsalRun, figures: dict[str, Any], missed: list[str], charts: list[Chart],
              folder: Path) -> Page:
    """Make the page of a run, with its charts, whose other results are in a folder."""
    config = run.config
    page = Page(f"{config.description}: {config.material}")
    bounds = get_bounds(config)
    page.set_verdict(describe_run(figures, missed, bounds), holds=not missed)
    if run.cell.grasp.is_by_friction:
        page.add_text(f"In the hand the {config.tool_name} moved by at most {1e3 * figures['grasp_slip_m']:.2f} mm at "
                      f"its grip and tip, and turned by {figures['grasp_slip_deg']:.2f} deg.")
    film = folder / "rehearsal.mp4"
    with Recording(folder / FILE) as recording:
        from robosim.viewer.server import embed_html

        if film.is_file():
            still = read_frame(film, choose_moment(recording))
            by = f" by {drawn}" if (drawn := read_comment(film)) else ""
            page.add_film(film.read_bytes(), f"{run.time:.1f} s simulated; drawn{by} from the simulated states", still)
        page.add_heading("In 3-D")
        page.add_scene(embed_html(recording), f"Turn with the mouse, scrub below. With colours, forces, regions and "
                       f"curves: robosim view {folder}")
    page.add_heading("Curves")
    page.add_plot(draw_charts(charts, {name: time for time, name in run.passages()}),
                  "Drag to zoom, double-click to come back; a click in the legend hides a curve.")
    page.add_heading("Bounds")
    page.add_table(["figure", "value", "unit", "accepted from", "to", "verdict", "margin"],
                   [bound_row(name, figures[name], bound) for name, bound in bounds.items()])
    page.add_heading("All figures")
    page.add_table(["figure", "value", "unit"],
                   [[split_unit(name)[0], value, split_unit(name)[1]] for name, value in figures.items()
                    if not isinstance(value, list | dict)])
    page.add_details("Configuration", yaml.safe_dump(config.model_dump(mode="json"), sort_keys=False))
    page.add_details("Material", yaml.safe_dump(run.material.model_dump(mode="json"), sort_keys=False))
    return page


def describe_run(figures: dict[str, Any], missed: list[str], bounds: dict[str, Bound]) -> str:
    """Return one sentence: which bounds were missed, where the material went, and which bound was closest."""
    total, delivered, spilled = (figures[name] for name in ("scooped_mass_kg", "delivered_fraction",
                                                                 "spilled_fraction"))
    facts = f"{round_quantity('kg', total)} of {figures['material']}" + " scooped" * bool(figures["wrist_payload_kg"])
    if "dose_kg" in figures:
        facts = f"{round_quantity('kg', figures['dose_kg'])} of {figures['material']} dosed for " \
                f"{round_quantity('kg', figures['dose_target_kg'])}"
    elif delivered is not None:
        facts += f", {100.0 * delivered:.3g} % delivered"
    if spilled is not None:
        facts += f", {round_quantity('kg', spilled * total)} spilled"
    if missed:
        return f"{len(missed)} of {len(bounds)} bounds missed: {'; '.join(missed)}. {facts}."
    used = {name: abs(figures[name]) / bound.high if np.isfinite(bound.high) else bound.low / figures[name]
            for name, bound in bounds.items() if figures[name] is not None and bound.low < bound.high}
    name = max(used, key=lambda key: used[key])
    (words, unit), ends = split_unit(name), [end for end in bounds[name][:2] if np.isfinite(end)]
    return f"{facts}; every bound held; the closest: {words}, {round_quantity(unit, figures[name])} of " \
           f"{round_quantity(unit, ends[-1])}"


def round_quantity(unit: str, value: float) -> str:
    """Return a value of an SI unit with three digits; masses in g, lengths in mm."""
    smaller = {"kg": "g", "m": "mm"}.get(unit)
    return f"{1e3 * value:.3g} {smaller}" if smaller else f"{value:.3g} {unit}".removesuffix(" 1")


def split_unit(name: str) -> tuple[str, str]:
    """Return a figure's name as words, and its unit."""
    words = name.split("_")
    unit = UNITS.get(words[-1], "1" if re.search("fraction|ratio|share|residual|error$", name) else "")
    return " ".join(words[:-1] if words[-1] in UNITS else words), unit


def bound_row(name: str, value: object, bound: Bound) -> list[object]:
    """Return a line of the table of bounds; margin: to the nearer end, negative outside."""
    words, unit = split_unit(name)
    low, high = (None if np.isinf(end) else end for end in bound[:2])
    if not isinstance(value, int | float):
        return [words, None, unit, low, high, "not run", None]
    margin = min(value - bound.low, bound.high - value)
    return [words, value, unit, low, high, "held" if margin >= 0 else "missed", None if np.isinf(margin) else margin]


def make_charts(run: RehearsalRun, folder: Path) -> list[Chart]:
    """Return the charts of a run, from the readings of all its steps and from its recording in a folder."""
    readings, bounds = run.readings, get_bounds(run.config)
    time, grain_time = readings.stack_steps("time"), readings.stack_grains("time")
    with Recording(folder / FILE) as recording:
        frame_times, values = recording.values()
        names = [curve.name for curve in recording.header.curves]
    masses = [Curve(name, frame_times, values[:, names.index(name)])
              for name in ("in the tool", "outside of tool and places")]
    wrist = [Curve(name, frame_times, values[:, names.index(f"wrist {name}")]) for name in ("Fx", "Fy", "Fz")]
    force = uniform_filter1d(readings.stack_steps("tool_force"), AVERAGED_STEPS, axis=0)
    torques = readings.stack_steps("torque") / run.plan.arm.torque_limits
    drift, exchanged = (np.cumsum(np.abs(readings.stack_steps(name)), axis=0) for name in ("residual", "exchanged"))
    charts = [
        Chart("mass [g]; none while the tool digs", masses),
        Chart("force of the grains on the tool [N]", [Curve(f"F{a}", time, force[:, k]) for k, a in enumerate("xyz")]),
        Chart("wrist force without the weight of hand and tool [N]", wrist),
        Chart("joint torque, share of its limit [1]",
              [Curve(name, time, torques[:, k]) for k, name in enumerate(run.readings.joints)],
              most=1.0, least=-1.0),
        Chart("distance of the tool from its command [mm]", [Curve("tool", time, 1e3 * compute_tracking_errors(run))]),
        Chart("momentum that no impulse accounts for, of all that was exchanged [1]",
              [Curve("linear", time, drift[:, :3].max(1) / (exchanged[:, 0] + 1e-12) + 1e-12),
               Curve("angular", time, drift[:, 3:].max(1) / (exchanged[:, 1] + 1e-12) + 1e-12)],
              most=bounds["momentum_residual"].high, is_logarithmic=True),
        Chart("energy of the grains since the start [mJ]", energy_curves(run)),
    ]
    if run.dosing is not None:
        charts[:0] = dose_charts(run.dosing)
    if run.replay is not None:
        charts[1:1] = replay_charts(run.replay, run.compare_wrench(), run.readings.joints, run.config.grasp_time)
    if run.solver.sleep:
        charts.append(Chart("grains that are computed [%]",
                            [Curve("awake", grain_time, 100.0 * readings.stack_grains("awake"))]))
    return charts


def dose_charts(dosing: DosingDriver) -> list[Chart]:
    """Return the charts of a dose: masses and target, the balance's error, and what the controller commands."""
    time, shown, mass, tilt, amplitude = (dosing.stack(name) for name in DoseSample._fields)
    return [Chart("dose [g]", [Curve("in the cup", time, 1e3 * mass), Curve("the balance shows", time, 1e3 * shown),
                               Curve("target", time, np.full_like(time, 1e3 * dosing.target), dashed=True)]),
            Chart("what the balance shows less what is in the cup [g]", [Curve("shown", time, 1e3 * (shown - mass))]),
            Chart("tilt of the tool while it doses [deg]", [Curve("tilt", time, np.degrees(tilt))]),
            Chart("commanded amplitude of the vibration [mm]", [Curve("amplitude", time, 1e3 * amplitude)])]


def energy_curves(run: RehearsalRun) -> list[Curve]:
    """Return energies, the tool's work and what was dissipated [mJ]."""
    readings, start = run.readings, run.readings.energies[0].potential
    time = np.array([e.time for e in readings.energies])
    energies = np.array([[e.kinetic, e.potential - start, e.elastic] for e in readings.energies])
    work = np.interp(time, readings.stack_steps("time"), np.cumsum(readings.stack_steps("tool_work")))
    rows = {"kinetic": energies[:, 0], "potential": energies[:, 1], "elastic": energies[:, 2], "work of the tool": work,
            "dissipated": work - (energies.sum(1) - energies.sum(1)[0])}
    return [Curve(name, time, 1e3 * row, dashed=name == "dissipated") for name, row in rows.items()]
