"""report.png: the rehearsal's figures over time."""

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402  (the backend must be chosen first)
import numpy as np  # noqa: E402

from robosim.rehearsal.metrics import tracking_error  # noqa: E402
from robosim.rehearsal.rehearsal import Rehearsal  # noqa: E402

SMOOTH = 20
"""Steps over which plotted forces are averaged; the file trajectory.csv is not."""


def plot_report(run: Rehearsal, path: Path) -> None:
    """Draw mass in the tool, wrist wrench, joint torques, tracking error, momentum residual and energies."""
    rec = run.recording
    t, ts = rec.array("time"), rec.sampled("time")
    figure, axes = plt.subplots(3, 2, figsize=(14, 11), sharex=True, constrained_layout=True)
    figure.suptitle(f"{run.config.description}: {run.config.material}, {len(run.solver.positions())} grains, "
                    f"cells of {run.config.field.cell * 1e3:g} mm")
    _lines(axes[0, 0], ts, rec.sampled("in_tool")[:, None] * 1e3, ["in the tool"], "mass [g]")
    wrist = _smooth(rec.array("wrist"))
    _lines(axes[0, 1], t, wrist[:, :3], ["Fx", "Fy", "Fz"], "wrist force [N]")
    torque_axis = axes[0, 1].twinx()
    torque_axis.plot(t, wrist[:, 3:], "--", lw=0.8)
    torque_axis.set_ylabel("wrist torque x, y, z [N m], dashed")
    share = rec.array("torque") / run.plan.arm.torque_limits
    _lines(axes[1, 0], t, share, [f"A{i}" for i in range(1, 8)], "joint torque / limit")
    axes[1, 0].set_ylim(-1.05, 1.05)
    _lines(axes[1, 1], t, tracking_error(run)[:, None] * 1e3, ["tool position"], "tracking error [mm]")
    scale = np.cumsum(rec.array("exchanged"), axis=0) + 1e-12
    drift = np.abs(np.cumsum(rec.array("residual"), axis=0))
    relative = np.stack([drift[:, :3].max(1) / scale[:, 0], drift[:, 3:].max(1) / scale[:, 1]], -1)
    _lines(axes[2, 0], t, relative + 1e-12, ["linear", "angular"], "momentum residual / exchanged")
    axes[2, 0].set_yscale("log")
    te = np.array([e.time for e in rec.energies])
    energies = np.array([[e.kinetic, e.potential - rec.energies[0].potential, e.elastic] for e in rec.energies])
    work = np.interp(te, t, np.cumsum(rec.array("tool_work")))
    dissipated = work - (energies.sum(1) - energies.sum(1)[0])
    _lines(axes[2, 1], te, np.column_stack([energies, work, dissipated]) * 1e3,
           ["kinetic", "potential", "elastic", "work of the tool", "dissipated"], "energy [mJ]")
    for axis in axes.flat:
        for name, time in run.plan.path.times.items():
            axis.axvline(time + run.config.grasp_time, color="0.85", lw=0.6, zorder=0)
            if axis is axes[0, 0]:
                place = (time + run.config.grasp_time, axis.get_ylim()[1])
                axis.text(*place, f" {name}", rotation=90, fontsize=7, va="top")
    for axis in axes[2]:
        axis.set_xlabel("time [s]")
    figure.savefig(path, dpi=110)
    plt.close(figure)


def _lines(axis, t: np.ndarray, values: np.ndarray, labels: list[str], ylabel: str) -> None:  # noqa: ANN001
    axis.plot(t, values, lw=1.0, label=labels)
    axis.set_ylabel(ylabel)
    axis.legend(fontsize=7, ncols=2)
    axis.grid(alpha=0.3)


def _smooth(values: np.ndarray) -> np.ndarray:
    """Moving average over SMOOTH steps (n, k)."""
    if len(values) < SMOOTH:
        return values
    kernel = np.ones(SMOOTH) / SMOOTH
    return np.stack([np.convolve(column, kernel, mode="same") for column in values.T], -1)
