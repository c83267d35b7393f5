"""Comparison of a report with an earlier one."""

import json
import math
from typing import Any

from robosim.errors import ConfigError
from robosim.reports.page import Page
from robosim.verification.cases.claims import describe

NOTABLE = 1.05
"""Ratio of errors or seconds from which a change is listed."""


def add_comparison(page: Page, old: dict[str, Any], new: dict[str, Any]) -> list[list[object]]:
    """Add the changed runs to a page, largest change of the error first; return the table's rows.

    old, new: contents of report.json. Raises ConfigError where the old one is no report.
    """
    try:
        before = {run_key(run): (run["record"], run.get("failed")) for run in old["runs"]}
        origin = f"{old['made_by']['commit']} on {old['made_by']['machine']}"
    except (KeyError, TypeError) as error:
        raise ConfigError("--compare: not a report; accepted: a report.json of `robosim report`") from error
    rows: list[list[object]] = []
    for run in new["runs"]:
        (earlier, reason), now = before.get(run_key(run), (None, None)), run["record"]
        name = [run["case"], describe(run["choices"])]
        if earlier is not None and now is None:
            rows.append([*name, f"no result: {run['failed']}", *[None] * 2, math.inf, *[None] * 3])
        elif now is not None and earlier is None and reason:
            rows.append([*name, f"a result where there was none: {reason}", *[None] * 2, 0.0, *[None] * 3])
        if earlier is None or now is None:
            continue
        for key in sorted(set(earlier["errors"]) & set(now["errors"])):
            error = error_ratio(now["errors"][key], earlier["errors"][key])
            seconds = error_ratio(now["seconds"], earlier["seconds"])
            if max(magnitude(error), magnitude(seconds)) > math.log(NOTABLE):
                rows.append([*name, key, earlier["errors"][key], now["errors"][key], error,
                             earlier["seconds"], now["seconds"], seconds])
    rows.sort(key=lambda row: -magnitude(float(str(row[5]))))
    page.add_heading("Comparison with an earlier report")
    page.add_text(f"Before: {origin}. The table lists runs whose error or seconds changed by more than "
                  f"{NOTABLE - 1:.0%}; a ratio below 1 is an improvement.")
    page.add_table(["case", "choices", "error", "before", "now", "ratio", "seconds before", "seconds now",
                    "ratio of seconds"], rows)
    return rows


def run_key(run: dict[str, Any]) -> str:
    """Return a key that is the same for the same case and choices."""
    return json.dumps([run["case"], run["choices"]], sort_keys=True)


def magnitude(ratio: float) -> float:
    """Return |log ratio|, which is the same for half and for twice."""
    return abs(math.log(ratio)) if ratio > 0.0 else math.inf


def error_ratio(new: float | None, old: float | None) -> float:
    """Return |new| / |old|; 1 where both are zero, infinity where only the new one is not a number."""
    if new is None or old is None:
        return math.inf if new is None and old is not None else 1.0
    tiny = 1e-15
    return max(abs(new), tiny) / max(abs(old), tiny)
