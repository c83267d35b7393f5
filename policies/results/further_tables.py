"""Tables besides those of scores: gain of down-sampling, turn of the tools."""

from collections import defaultdict
from statistics import fmean
from typing import Any

from policies.results.page import TextTable
from policies.results.summary import Summaries

TIMED_SETTINGS = ("material", "starts", "action_repeat", "max_episodes")
"""Columns that two runs must share for their seconds to be compared."""


def make_further_tables(summaries: Summaries, rows: list[dict[str, Any]],
                        published: dict) -> tuple[dict, list[TextTable]]:
    """Return the tables that there are runs for, as numbers and as texts."""
    gain, tables = downsampling_gain(rows), list[TextTable]()
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
    return {"gain_of_down_sampling": gain, "turns": turns}, tables


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
