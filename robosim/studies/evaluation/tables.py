"""Tables of episodes; table and picture of one motion among many materials."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from robosim.base.output_folder import aligned
from robosim.randomization.materials import MATERIALS
from robosim.studies.evaluation.material_episode import OWN, READINGS

Rows = dict[str, dict[str, Any]]
"""Label of a material -> score, deviation and readings in it."""


def make_rows(episodes: Rows) -> Rows:
    """Return scores, deviations and readings by material, from episodes by material.
    td_mm: trajectory deviation, the mean distance over the episode [mm] between the centre of the observed grains in
    a material and in the task's own; None where the episode diverged at once."""
    own, rows = np.array(episodes[OWN]["trajectory"]), {}
    for label in MATERIALS:
        trajectory = np.array(episodes[label]["trajectory"])
        common = min(len(own), len(trajectory))  # an episode that diverged is shorter
        deviation = np.linalg.norm(trajectory[:common] - own[:common], axis=1).mean() if common else None
        rows[label] = {"score": episodes[label]["score"], "td_mm": None if deviation is None else 1e3 * deviation,
                       **{key: episodes[label][key] for key in READINGS}, "diverged": episodes[label]["diverged"]}
    return rows


def format_table(tasks: list[str], rows_by_task: dict[str, Rows]) -> str:
    """Format scores, with deviations in brackets, for a terminal."""
    def cell(values: dict[str, Any]) -> str:
        deviation = "-" if values["td_mm"] is None else f"{values['td_mm']:.1f}"
        return f"{values['score']:.1f} ({deviation})"

    lines = [["score (TD [mm])", *tasks]]
    lines += [[material, *(cell(rows_by_task[task][material]) for task in tasks)] for material in MATERIALS]
    return aligned(lines)


def draw_map(path: Path, tasks: list[str], rows_by_task: dict[str, Rows]) -> None:
    """Draw the delivered share as a map of materials by tasks, with the scores in its cells."""
    shares = np.array([[rows_by_task[task][label]["delivered"] for task in tasks] for label in MATERIALS], float)
    figure = Figure(figsize=(4.4 + 1.1 * len(tasks), 1.2 + 0.42 * len(MATERIALS)), layout="constrained")
    axes = figure.subplots()
    image = axes.imshow(shares, vmin=0.0, vmax=1.0, cmap="viridis", aspect="auto")
    for i, label in enumerate(MATERIALS):
        for j, task in enumerate(tasks):
            axes.text(j, i, f"{rows_by_task[task][label]['score']:.1f}", ha="center", va="center", fontsize=8,
                      color="black" if shares[i, j] > 0.6 else "white")
    axes.set_xticks(range(len(tasks)), tasks, rotation=30, ha="right")
    axes.set_yticks(range(len(MATERIALS)), list(MATERIALS))
    axes.set_title("score of one motion")
    figure.colorbar(image, label="delivered fraction")
    figure.savefig(path, dpi=120)
