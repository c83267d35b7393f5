"""Tables besides those of scores: gain of down-sampling, turn of the tools, other materials."""

from collections import defaultdict
from pathlib import Path
from statistics import fmean
from typing import Any

from policies.results.page import TextTable
from policies.results.summary import Summaries
from robosim.base.input_files import check_form, read_json

MATERIAL_COLUMNS = ("task", "material", "score", "td_mm", "delivered")
"""Columns that are taken from materials.json."""
MATERIALS = {"policy": str, "rows": [{"task": str, "material": str, "score": float, "td_mm": (float, None)}]}
"""Form of materials.json."""
TIMED_SETTINGS = ("material", "starts", "action_repeat", "max_episodes")
"""Columns that two runs must share for their seconds to be compared."""


def make_further_tables(summaries: Summaries, rows: list[dict[str, Any]], sources: list[Path],
                        published: dict) -> tuple[dict, list[TextTable]]:
    """Return the tables that there are runs for, as numbers and as texts."""
    gain, materials, tables = downsampling_gain(rows), read_materials(sources), []
    required, theirs = published["turn"]["asked_deg"], published["turn"]["dg_sac_deg"]
    turns = [{"method": method, "task": task, "off_deg": figures["turn_error_deg"]["mean"], "asked_deg": required}
             for method, tasks in summaries.items() for task, figures in tasks.items() if "turn_error_deg" in figures]
    if gain:
        published_gain = published["gain_of_down_sampling"]
        tables.append(TextTable("seconds of an episode that observes every grain / one that observes some",
                                ["task", "gain", published["source"]],
                                [[task, f"{value:.2f}",
                                  f"{published_gain[task]:.2f}" if task in published_gain else ""]
                                 for task, value in gain.items()]))
    if turns:
        def error(degrees: float) -> list[str]:
            return [f"{degrees:.1f}", f"{degrees / abs(required):.1%}"]

        tables.append(TextTable("error of the tool's turn in the motion with the highest return",
                                ["method", "task", "error [deg]", "relative", "required [deg]",
                                 published["source"] + ", dg_sac"],
                                [[turn["method"], turn["task"], *error(turn["off_deg"]), f"{required:g}",
                                  "{} ({})".format(*error(abs(theirs[turn["task"]][0] - required)))
                                  if turn["task"] in theirs else ""] for turn in turns]))
    if materials:
        tables.append(_tabulate_materials(materials))
    return {"gain_of_down_sampling": gain, "materials": materials, "turns": turns}, tables


def downsampling_gain(rows: list[dict[str, Any]]) -> dict[str, float]:
    """Return seconds of an episode of dg_sac_literal that observes all grains / one that observes some, by task.
    Mean over the settings that both were run with."""
    seconds, ratios = defaultdict(list), defaultdict(list)
    for row in rows:
        seconds[row["method"], row["task"], tuple(row[key] for key in TIMED_SETTINGS)].append(row["seconds"])
    for (method, task, settings), values in seconds.items():
        of_some = seconds.get(("dg_sac_literal", task, settings))
        if method == "all" and of_some and fmean(of_some) > 0.0:
            ratios[task].append(fmean(values) / fmean(of_some))
    return {task: fmean(values) for task, values in ratios.items()}


def read_materials(sources: list[Path]) -> list[dict[str, Any]]:
    """Return the rows of every materials.json of `robosim materials` in folders; unreadable files are left out."""
    rows = []
    for path in sorted(path for source in sources if source.is_dir() for path in source.rglob("materials.json")):
        try:
            stored = read_json(path)
            check_form(stored, MATERIALS)
            rows += [{"policy": stored["policy"], **{key: row[key] for key in MATERIAL_COLUMNS}}
                     for row in stored["rows"]]
        except (OSError, ValueError, KeyError, TypeError):
            continue
    return rows


def _tabulate_materials(rows: list[dict[str, Any]]) -> TextTable:
    motions = sorted({(row["task"], row["policy"]) for row in rows})
    names = list(dict.fromkeys(row["material"] for row in rows))
    cells = {(row["task"], row["policy"], row["material"]):
             f"{row['score']:.1f} ({'-' if row['td_mm'] is None else format(row['td_mm'], '.1f')})" for row in rows}
    return TextTable("score of one motion in other materials, in brackets trajectory deviation (TD) [mm]",
                     ["material", *(f"{task}, {policy}" for task, policy in motions)],
                     [[name, *(cells.get((*motion, name), "") for motion in motions)] for name in names])
