"""What got better and what worse since another report."""

import json
import math
from typing import Any

from robosim.errors import ConfigError
from robosim.reports.page import Page
from robosim.verification.cases.criteria import told

NOTABLE = 1.05
"""Ratio of errors or seconds from which on a change is told."""


def compared(page: Page, old: dict[str, Any], new: dict[str, Any]) -> list[list[object]]:
    """Put the changed runs on the page, largest change of the error first; returns the rows. Raises ConfigError where
    the old file is no report."""
    try:
        before = {key(run): (run["record"], run.get("failed")) for run in old["runs"]}
        whose = f"{old['made_by']['commit']} on {old['made_by']['machine']}"
    except (KeyError, TypeError) as error:
        raise ConfigError("--compare: accepted: a report.json of `robosim report`") from error
    rows: list[list[object]] = []
    for run in new["runs"]:
        (was, reason), now = before.get(key(run), (None, None)), run["record"]
        if was is not None and now is None:
            rows.append([*named(run), f"no result: {run['failed']}", *[None] * 2, math.inf, *[None] * 3])
        elif now is not None and was is None and reason:
            rows.append([*named(run), f"a result where there was none: {reason}", *[None] * 2, 0.0, *[None] * 3])
        if was is None or now is None:
            continue
        for name in sorted(set(was["errors"]) & set(now["errors"])):
            error = ratio(now["errors"][name], was["errors"][name])
            seconds = ratio(now["seconds"], was["seconds"])
            if max(size(error), size(seconds)) > math.log(NOTABLE):
                rows.append([*named(run), name, was["errors"][name], now["errors"][name], error,
                             was["seconds"], now["seconds"], seconds])
    rows.sort(key=lambda row: -size(float(str(row[5]))))
    page.add_heading("Since the other report")
    page.add_text(f"{whose} before; runs whose error or seconds changed "
              f"by more than {NOTABLE - 1:.0%}. Below 1 is better.")
    page.add_table(["case", "choices", "error of", "before", "now", "ratio", "seconds before", "now", "ratio"], rows)
    return rows


def key(run: dict[str, Any]) -> str:
    """The same for the same case and choices."""
    return json.dumps([run["case"], run["choices"]], sort_keys=True)


def named(run: dict[str, Any]) -> list[object]:
    """A run's case and choices, in words."""
    return [run["case"], told(run["choices"])]


def size(change: float) -> float:
    """Of a ratio: as large for half as for twice."""
    return abs(math.log(change)) if change > 0.0 else math.inf


def ratio(new: float | None, old: float | None) -> float:
    """|new| / |old|, 1 where both are nothing."""
    if new is None or old is None:  # was or is no number
        return math.inf if new is None and old is not None else 1.0
    tiny = 1e-15
    return max(abs(new), tiny) / max(abs(old), tiny)
