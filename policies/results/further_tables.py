"""Tables beside those of scores: what down-sampling saves, how far tools have turned, other materials."""

import json
from collections import defaultdict
from pathlib import Path
from statistics import fmean
from typing import Any, NamedTuple

MOTION = ("task", "material", "score", "td_mm", "delivered")
"""What is told of a motion in a material."""
SETTING = ("material", "starts", "hold", "wanted")
"""What two runs must share for their seconds to be compared."""


class Table(NamedTuple):
    """A table of words."""

    title: str
    head: list[str]
    rows: list[list[str]]


def further(found: dict[str, dict[str, dict]], runs: list[dict[str, Any]], folders: list[Path],
            published: dict) -> tuple[dict, list[Table]]:
    """What there is of them, as numbers and as words. found: summaries by method, task and reading; runs: the rows
    that they are made of."""
    saved, turned, among = gain(runs), turns(found, published), materials(folders)
    tables = []
    if saved:
        theirs = published["gain_of_down_sampling"]
        tables.append(Table("seconds of an episode that sees every grain, over one that sees some",
                            ["task", "gain", published["source"]],
                            [[task, f"{value:.2f}", f"{theirs[task]:.2f}" if task in theirs else ""]
                             for task, value in saved.items()]))
    if turned:
        tables.append(Table("how far the best motion has turned its tool off what was asked",
                            ["method", "task", "off [deg]", "off by", "asked [deg]", published["source"] + ", dg_sac"],
                            [[method, task, f"{off:.1f}", f"{off / abs(asked):.1%}", f"{asked:g}", theirs]
                             for method, task, off, asked, theirs in turned]))
    if among:
        motions = sorted({(row["task"], row["policy"]) for row in among})
        names = list(dict.fromkeys(row["material"] for row in among))
        by = {(row["task"], row["policy"], row["material"]): row for row in among}
        tables.append(Table("score of one motion among other materials, in brackets TD [mm]",
                            ["material", *(f"{task}, {policy}" for task, policy in motions)],
                            [[name, *(cell(by.get((*motion, name))) for motion in motions)] for name in names]))
    return {"gain_of_down_sampling": saved, "materials": among,
            "turns": [dict(zip(("method", "task", "off_deg", "asked_deg"), row)) for row in turned]}, tables


def gain(runs: list[dict[str, Any]]) -> dict[str, float]:
    """Seconds of an episode of `dg_sac` with all grains seen over those with some, by task: mean over the settings that
    both were run with."""
    seconds, ratios = defaultdict(list), defaultdict(list)
    for one in runs:
        seconds[one["method"], one["task"], tuple(one[key] for key in SETTING)].append(one["seconds"])
    for (method, task, setting), values in seconds.items():
        some = seconds.get(("dg_sac", task, setting))
        if method == "all" and some:
            ratios[task].append(fmean(values) / fmean(some))
    return {task: fmean(values) for task, values in ratios.items()}


def turns(found: dict[str, dict[str, dict]], published: dict) -> list[tuple[str, str, float, float, str]]:
    """Method, task, mean error [deg] of the best motions, what was asked [deg], what the paper's own came to."""
    asked, theirs = published["turn"]["asked_deg"], published["turn"]["dg_sac_deg"]
    rows = []
    for method, tasks in found.items():
        for task, values in tasks.items():
            if "turn_error_deg" in values:
                told = f"{abs(theirs[task][0] - asked):.1f} ({abs(theirs[task][0] / asked - 1.0):.1%})" \
                    if task in theirs else ""
                rows.append((method, task, values["turn_error_deg"]["mean"], asked, told))
    return rows


def materials(folders: list[Path]) -> list[dict[str, Any]]:
    """Rows of every materials.json of `robosim materials` below folders; those that cannot be read are left out."""
    rows = []
    for path in sorted(path for top in folders if top.is_dir() for path in top.rglob("materials.json")):
        try:
            told = json.loads(path.read_text())
            rows += [{"policy": told["policy"], **{key: row[key] for key in MOTION}} for row in told["rows"]]
        except (OSError, ValueError, KeyError, TypeError):
            continue
    return rows


def cell(row: dict[str, Any] | None) -> str:
    """A score, and the trajectory's deviation."""
    if row is None:
        return ""
    return f"{row['score']:.1f} ({'-' if row['td_mm'] is None else format(row['td_mm'], '.1f')})"
