"""report.png: the readings of a rehearsal over time."""

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402  (the backend must be chosen first)
import numpy as np  # noqa: E402
from matplotlib.axes import Axes  # noqa: E402

from robosim.rehearsal.metrics import compute_tracking_errors  # noqa: E402
from robosim.rehearsal.readings import ARM  # noqa: E402
from robosim.rehearsal.run import RehearsalRun  # noqa: E402

AVERAGED_STEPS = 20
"""Steps over which plotted forces are averaged; those in trajectory.csv are not."""


def plot_report(run: RehearsalRun, path: Path) -> None:
    """Draw the readings of a rehearsal over time.

    Mass in the tool and who is awake, wrist wrench, joint torques, tracking error, momentum residual and energies.
    """
    figure, axes = plt.subplots(3, 2, figsize=(14, 11), sharex=True, constrained_layout=True)
    figure.suptitle(f"{run.config.description}: {run.config.material}, {len(run.solver.positions())} grains, "
                    f"cells of {run.config.field.cell * 1e3:g} mm")
    _plot_mass(axes[0, 0], run)
    _plot_wrist(axes[0, 1], run)
    _plot_torques(axes[1, 0], run)
    time = run.readings.stack_steps("time")
    _plot_lines(axes[1, 1], time, compute_tracking_errors(run)[:, None] * 1e3, ["tool position"], "tracking error [mm]")
    _plot_momentum(axes[2, 0], run)
    _plot_energies(axes[2, 1], run)
    _mark_waypoints(axes, run)
    for axis in axes[2]:
        axis.set_xlabel("time [s]")
    figure.savefig(path, dpi=110)
    plt.close(figure)


def _plot_mass(axis: Axes, run: RehearsalRun) -> None:
    mass = run.readings.stack_grains("mass_in_tool")[:, None] * 1e3
    time = run.readings.stack_grains("time")
    _plot_lines(axis, time, mass, ["in the tool"], "mass [g]")
    if run.solver.sleep:
        share_axis = axis.twinx()
        share_axis.plot(time, run.readings.stack_grains("awake"), "--", color="0.5", lw=0.8)
        share_axis.set_ylim(0.0, 1.05)
        share_axis.set_ylabel("grains that are awake, dashed")


def _plot_wrist(axis: Axes, run: RehearsalRun) -> None:
    time, wrist = run.readings.stack_steps("time"), _average(run.readings.stack_steps("wrist"))
    _plot_lines(axis, time, wrist[:, :3], ["Fx", "Fy", "Fz"], "wrist force [N]")
    torque_axis = axis.twinx()
    torque_axis.plot(time, wrist[:, 3:], "--", lw=0.8)
    torque_axis.set_ylabel("wrist torque x, y, z [N m], dashed")


def _plot_torques(axis: Axes, run: RehearsalRun) -> None:
    share = run.readings.stack_steps("torque") / run.plan.arm.torque_limits
    _plot_lines(axis, run.readings.stack_steps("time"), share, ARM, "joint torque / limit")
    axis.set_ylim(-1.05, 1.05)


def _plot_momentum(axis: Axes, run: RehearsalRun) -> None:
    readings = run.readings
    exchanged = np.cumsum(readings.stack_steps("exchanged"), axis=0) + 1e-12
    drift = np.abs(np.cumsum(readings.stack_steps("residual"), axis=0))
    relative = np.stack([drift[:, :3].max(1) / exchanged[:, 0], drift[:, 3:].max(1) / exchanged[:, 1]], -1)
    _plot_lines(axis, readings.stack_steps("time"), relative + 1e-12, ["linear", "angular"],
                "momentum residual / exchanged")
    axis.set_yscale("log")


def _plot_energies(axis: Axes, run: RehearsalRun) -> None:
    readings, start = run.readings, run.readings.energies[0].potential
    time = np.array([e.time for e in readings.energies])
    energies = np.array([[e.kinetic, e.potential - start, e.elastic] for e in readings.energies])
    work = np.interp(time, readings.stack_steps("time"), np.cumsum(readings.stack_steps("tool_work")))
    dissipated = work - (energies.sum(1) - energies.sum(1)[0])
    _plot_lines(axis, time, np.column_stack([energies, work, dissipated]) * 1e3,
                ["kinetic", "potential", "elastic", "work of the tool", "dissipated"], "energy [mJ]")


def _mark_waypoints(axes: np.ndarray, run: RehearsalRun) -> None:
    """Vertical lines at all waypoints, with their names in the first plot."""
    for name in run.plan.path.times:
        time = run.waypoint_time(name)
        for axis in axes.flat:
            axis.axvline(time, color="0.85", lw=0.6, zorder=0)
        axes[0, 0].text(time, axes[0, 0].get_ylim()[1], f" {name}", rotation=90, fontsize=7, va="top")


def _plot_lines(axis: Axes, time: np.ndarray, values: np.ndarray, labels: list[str], ylabel: str) -> None:
    axis.plot(time, values, lw=1.0, label=labels)
    axis.set_ylabel(ylabel)
    axis.legend(fontsize=7, ncols=2)
    axis.grid(alpha=0.3)


def _average(values: np.ndarray) -> np.ndarray:
    """Moving average of values (n, k) over AVERAGED_STEPS."""
    if len(values) < AVERAGED_STEPS:
        return values
    kernel = np.ones(AVERAGED_STEPS) / AVERAGED_STEPS
    return np.stack([np.convolve(column, kernel, mode="same") for column in values.T], -1)
