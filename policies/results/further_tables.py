"""Tables besides those of scores: gain of down-sampling, turn of the tools, other materials."""

from collections import defaultdict
from pathlib import Path
from statistics import fmean
from typing import Any, NamedTuple

from policies.results.page import TextTable
from policies.results.summary import Summaries
from robosim.base.input_files import check_form, read_json

MATERIAL_COLUMNS = ("task", "material", "score", "td_mm", "delivered")
"""Columns that are taken from materials.json."""
MATERIALS = {"policy": str, "rows": [{"task": str, "material": str, "score": float, "td_mm": (float, None)}]}
"""Form of materials.json."""
TIMED_SETTINGS = ("material", "starts", "action_repeat", "max_episodes")
"""Columns that two runs must share for their seconds to be compared."""


class Turn(NamedTuple):
    """The turn of a method's tools, mean over its best motions."""

    method: str
    task: str
    off_deg: float
    """Mean error of the turn [deg]."""
    asked_deg: float
    """Required turn [deg]."""
    published: str
    """Published error, empty where there is none."""


def make_further_tables(summaries: Summaries, rows: list[dict[str, Any]], sources: list[Path],
                        published: dict) -> tuple[dict, list[TextTable]]:
    """Return the tables that there are runs for, as numbers and as texts."""
    gain, turns, materials = downsampling_gain(rows), tool_turns(summaries, published), read_materials(sources)
    tables = []
    if gain:
        published_gain = published["gain_of_down_sampling"]
        tables.append(TextTable("seconds of an episode that observes every grain / one that observes some",
                                ["task", "gain", published["source"]],
                                [[task, f"{value:.2f}",
                                  f"{published_gain[task]:.2f}" if task in published_gain else ""]
                                 for task, value in gain.items()]))
    if turns:
        tables.append(TextTable("error of the tool's turn in the motion with the highest return",
                                ["method", "task", "error [deg]", "relative", "required [deg]",
                                 published["source"] + ", dg_sac"],
                                [[turn.method, turn.task, f"{turn.off_deg:.1f}",
                                  f"{turn.off_deg / abs(turn.asked_deg):.1%}", f"{turn.asked_deg:g}", turn.published]
                                 for turn in turns]))
    if materials:
        tables.append(_tabulate_materials(materials))
    return {"gain_of_down_sampling": gain, "materials": materials,
            "turns": [{key: getattr(turn, key) for key in ("method", "task", "off_deg", "asked_deg")}
                      for turn in turns]}, tables


def downsampling_gain(rows: list[dict[str, Any]]) -> dict[str, float]:
    """Return seconds of an episode of dg_sac_literal that observes all grains / one that observes some, by task.

    Mean over the settings that both were run with.
    """
    seconds, ratios = defaultdict(list), defaultdict(list)
    for row in rows:
        seconds[row["method"], row["task"], tuple(row[key] for key in TIMED_SETTINGS)].append(row["seconds"])
    for (method, task, settings), values in seconds.items():
        of_some = seconds.get(("dg_sac_literal", task, settings))
        if method == "all" and of_some and fmean(of_some) > 0.0:
            ratios[task].append(fmean(values) / fmean(of_some))
    return {task: fmean(values) for task, values in ratios.items()}


def tool_turns(summaries: Summaries, published: dict) -> list[Turn]:
    """Return the turns of all methods and tasks whose tools have to turn."""
    required, published_turns = published["turn"]["asked_deg"], published["turn"]["dg_sac_deg"]
    turns = []
    for method, tasks in summaries.items():
        for task, figures in tasks.items():
            if "turn_error_deg" in figures:
                text = ""
                if task in published_turns:
                    turn = published_turns[task][0]
                    text = f"{abs(turn - required):.1f} ({abs(turn / required - 1.0):.1%})"
                turns.append(Turn(method, task, figures["turn_error_deg"]["mean"], required, text))
    return turns


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
    by_key = {(row["task"], row["policy"], row["material"]): row for row in rows}
    return TextTable("score of one motion in other materials, in brackets trajectory deviation (TD) [mm]",
                     ["material", *(f"{task}, {policy}" for task, policy in motions)],
                     [[name, *(_format_material(by_key.get((*motion, name))) for motion in motions)]
                      for name in names])


def _format_material(row: dict[str, Any] | None) -> str:
    """Return score and trajectory deviation."""
    if row is None:
        return ""
    return f"{row['score']:.1f} ({'-' if row['td_mm'] is None else format(row['td_mm'], '.1f')})"
