"""Summaries over runs: which runs are pooled, and the statistics of their figures."""

import json
from collections import Counter, defaultdict
from typing import Any

import numpy as np

from robosim.base.statistics import bootstrap, interquartile_mean

FIGURES = {"tcs_evaluated": "score of the best policy, without exploration",
           "tcs_last10": "score, mean of the last ten episodes",
           "tcs_of_best_return": "score of the motion with the highest return, replayed",
           "return": "return, mean of the last ten episodes",
           "delivered": "delivered by the motion with the highest return",
           "spilled": "spilled by the motion with the highest return",
           "collisions": "collisions of the motion with the highest return",
           "turn_error_deg": "turn error of the motion with the highest return [deg]", "seconds": "seconds an episode"}
"""Columns that are summarised, and their titles."""
SETTINGS = {"material": "{}", "starts": "{} starts", "action_repeat": "action repeat {}",
            "n_envs": "{} environments at once", "obs": "observes {}", "max_episodes": "at most {} episodes"}
"""Columns of settings in which the runs of a method may differ, and their texts in a table."""

Summaries = dict[str, dict[str, dict[str, dict[str, Any]]]]
"""line -> task -> figure -> statistics"""


def summarise_runs(rows: list[dict[str, Any]], published: dict) -> tuple[Summaries, list[str]]:
    """Return the summaries of all runs with published values, and a note on each mean over runs that differ."""
    summaries, notes = defaultdict(dict), list[str]()
    groups: dict[tuple[str, str], list[dict]] = defaultdict(list)
    for line, row in zip(name_lines(rows), rows):
        groups[line, row["task"]].append(row)
    for (line, task), members in groups.items():
        notes += describe_mixture(line, task, members)
        summaries[line][task] = {
            key: {**summarise(values), "published": published_value(published, key, members[0]["method"], task)}
            for key in FIGURES if (values := [row[key] for row in members if row[key] is not None])}
    return summaries, notes


def name_lines(rows: list[dict[str, Any]]) -> list[str]:
    """Return the line of the tables that each run belongs to.
    It is the run's method and its own value of each setting in which the method's runs differ: runs of different
    settings are not pooled."""
    values: dict[tuple[str, str], set] = defaultdict(set)
    for row in rows:
        for key in SETTINGS:
            values[row["method"], key].add(row[key])
    return [", ".join([row["method"], *(text.format(row[key]) for key, text in SETTINGS.items()
                                        if len(values[row["method"], key]) > 1)]) for row in rows]


def describe_mixture(line: str, task: str, members: list[dict[str, Any]]) -> list[str]:
    """Return notes on pooled runs that share a seed, or differ in what made them; what one lacks differs, too."""
    seeds = [str(seed) for seed, count in Counter(row["seed"] for row in members).items() if count > 1]
    notes = [f"{line}, {task}: seed {', '.join(seeds)} more than once"] if seeds else []
    for key, name in (("preset", "settings of the method"), ("demonstrations", "demonstrations"),
                      ("task_digest", "tasks"), ("field", "fields"), ("code", "versions of the code")):
        count = len({json.dumps(row[key], sort_keys=True) for row in members})
        notes += [f"{line}, {task}: {count} different {name}"] if count > 1 else []
    return notes


def summarise(values: list[float]) -> dict[str, float]:
    """Return number, mean, standard deviation, interquartile mean and its 95 % bootstrap interval.
    The deviation is that of a sample, 0 for one value."""
    data = np.array(values)
    low, high = bootstrap(data, interquartile_mean)
    return {"n": len(data), "mean": float(data.mean()), "std": float(data.std(ddof=min(1, len(data) - 1))),
            "iqm": float(interquartile_mean(data)), "low": low, "high": high}


def published_value(published: dict, key: str, method: str, task: str) -> list[float] | None:
    """Return the published mean and deviation of a figure, None where there is none; it is of the last ten episodes."""
    name = {"tcs_last10": "tcs", "return": "return"}.get(key)
    method = "dg_sac" if method == "dg_sac_literal" else method  # as the paper calls it
    values = published[name].get(method) if name is not None else None
    return values[published["tasks"].index(task)] if values and task in published["tasks"] else None
