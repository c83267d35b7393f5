"""What got better and what worse since another report."""

import json
from typing import Any

from robosim.cases.checks import told
from robosim.errors import ConfigError
from robosim.reports.page import Page

NOTABLE = 1.05
"""Ratio of errors or seconds from which on a change is told."""


def compared(page: Page, old: dict[str, Any], new: dict[str, Any]) -> list[list[object]]:
    """Put the changed runs on the page, largest change of the error first; returns the rows. Raises ConfigError where
    the old file is no report."""
    try:
        before = {key(run): run["record"] for run in old["runs"] if run["record"]}
    except (KeyError, TypeError) as error:
        raise ConfigError("--compare: accepted: a report.json of `robosim report`") from error
    rows: list[list[object]] = []
    for run in new["runs"]:
        was, now = before.get(key(run)), run["record"]
        if was is None or now is None:
            continue
        for name in sorted(set(was["errors"]) & set(now["errors"])):
            error = ratio(now["errors"][name], was["errors"][name])
            seconds = ratio(now["seconds"], was["seconds"])
            if max(error, 1 / error, seconds, 1 / seconds) > NOTABLE:
                rows.append([run["case"], told(run["choices"]), name, was["errors"][name], now["errors"][name], error,
                             was["seconds"], now["seconds"], seconds])
    rows.sort(key=lambda row: -abs(float(str(row[5])) - 1.0))
    page.heading("Since the other report")
    page.text(f"{old['made_by']['commit']} on {old['made_by']['machine']} before; runs whose error or seconds changed "
              f"by more than {NOTABLE - 1:.0%}. Below 1 is better.")
    page.table(["case", "choices", "error of", "before", "now", "ratio", "seconds before", "now", "ratio"], rows)
    return rows


def key(run: dict[str, Any]) -> str:
    """The same for the same case and choices."""
    return json.dumps([run["case"], run["choices"]], sort_keys=True)


def ratio(new: float, old: float) -> float:
    """|new| / |old|, 1 where both are nothing."""
    tiny = 1e-15
    return max(abs(new), tiny) / max(abs(old), tiny)
