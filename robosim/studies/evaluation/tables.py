"""Tables of one motion among many materials."""

from typing import Any

import numpy as np

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


def pivot(tasks: list[str], rows_by_task: dict[str, Rows]) -> list[list[str]]:
    """Return a line for each material under a head: scores of the tasks, with deviations in brackets."""
    def cell(values: dict[str, Any]) -> str:
        deviation = "-" if values["td_mm"] is None else f"{values['td_mm']:.1f}"
        return f"{values['score']:.1f} ({deviation})"

    lines = [["score (TD [mm])", *tasks]]
    return lines + [[material, *(cell(rows_by_task[task][material]) for task in tasks)] for material in MATERIALS]
