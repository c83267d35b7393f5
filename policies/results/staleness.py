"""Whether stored rows are older than the code that they exercise: by the digests of code and settings in them."""

from collections import defaultdict
from typing import Any

from policies.learning.presets import load_preset
from policies.results.rows import preset_digest
from robosim.base.digests import changed_modules
from robosim.base.resources import config_names

SHOWN = 5
"""Modules of a row that are named."""


def find_stale(rows: list[dict[str, Any]]) -> dict[str, list[dict[str, Any]]]:
    """Return the rows that today's code did not make, by the difference to it."""
    stale: dict[str, list[dict[str, Any]]] = defaultdict(list)
    presets = {name: preset_digest(load_preset(name).model_dump()) for name in config_names("training")}
    for row in rows:
        reason = describe_age(row, presets)
        if reason:
            stale[reason].append(row)
    return stale


def describe_age(row: dict[str, Any], presets: dict[str, str]) -> str:
    """Return what has changed since a row was made; empty where nothing has. presets: digests of the methods today."""
    if not row["code"]:
        return "made by a version that did not store the digests of its code"
    if row["commit"].endswith("-dirty"):
        return "made from files that no commit has"
    if row["method"] in presets and presets[row["method"]] != row["preset"]:
        return f"the settings of {row['method']} have changed"
    changed = changed_modules(row["code"])
    more = f" and {len(changed) - SHOWN} more" if len(changed) > SHOWN else ""
    return f"{', '.join(changed[:SHOWN])}{more} have changed" if changed else ""
