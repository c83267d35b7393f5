"""Rows of tables: a run each, with all that it takes to make the run again, and whether today's code made it."""

from collections import defaultdict
from typing import Any

from policies.learning.presets import Preset, load_preset
from robosim.base.digests import changed_modules, digest
from robosim.base.resources import config_names

TEXT, NUMBER = (str, None), (float, None)
ROW: dict[str, Any] = {
    "task": str, "method": str, "material": TEXT, "seed": int, "starts": str, "action_repeat": int, "n_envs": int,
    "obs": str, "max_episodes": int, "commit": str, "episodes": int,
    **dict.fromkeys(("tcs_of_best_return", "tcs_last10", "tcs_evaluated"), NUMBER), "return": float, "seconds": float,
    **dict.fromkeys(("delivered", "spilled", "collisions", "turn_error_deg"), NUMBER),
    **dict.fromkeys(("preset", "demonstrations", "task_digest", "field"), TEXT), "code": ({str: str}, None),
    "command": TEXT, "curve": ([float], None)}
"""Form of a row. tcs_of_best_return: score of the motion with the highest return, replayed, as are delivered to
turn_error_deg; tcs_last10, return: means of the last ten episodes; tcs_evaluated: score of the best policy without
exploration; seconds: of an episode; preset, demonstrations, task_digest, field: digests, that of the preset over all
its keys but obs and episodes; code: modules that the run exercised, with a digest each; curve: score, means of ten
episodes."""


def preset_digest(preset: dict[str, Any]) -> str:
    """Return a digest of a preset's settings, without its description and what are columns of their own.
    Settings that have their default do not count, so that a setting that is added changes no stored digest."""
    return digest(Preset(**preset).model_dump(exclude={"description", "obs", "episodes"}, exclude_defaults=True))


def make_row(manifest: dict[str, Any], status: dict[str, Any], curve: list[float] | None = None) -> dict[str, Any]:
    """Return the row of a run from its manifest, its status and its learning curve."""
    replayed, last, preset = status["replayed"], status["last"], manifest["preset"]
    method = manifest.get("label") or manifest["method"]
    if method == "dg_sac_literal" and preset["obs"] != "flat":
        method = preset["obs"]  # the paper names its ablations after the observation
    row = {
        **{key: manifest[key] for key in ("task", "material", "seed", "starts", "action_repeat", "n_envs", "commit")},
        "method": method, "obs": preset["obs"], "max_episodes": preset["episodes"], "episodes": status["episodes"],
        "tcs_of_best_return": replayed.get("tcs"), "tcs_last10": last.get("tcs"),
        "tcs_evaluated": ((status.get("evaluated") or {}).get("best") or {}).get("tcs"),
        "return": last["return"], "seconds": status["seconds"] / status["episodes"],
        **{key: replayed.get(key) for key in ("delivered", "spilled", "collisions", "turn_error_deg")},
        "preset": preset_digest(preset), "demonstrations": digest(manifest.get("demonstrations", {})),
        **{key: manifest.get(key) for key in ("task_digest", "field", "code")},
        "command": manifest.get("command") and " ".join(["robosim", *manifest["command"].split(" ")[1:]]),
        "curve": curve}
    return {key: row[key] for key in ROW}


def unpack_rows(table: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the rows of a tables.json with their code in place of its digest."""
    versions = table.get("code") or {}
    return [{**row, "code": versions[row["code"]]} if isinstance(row.get("code"), str) else row
            for row in table["runs"]]


def pack_rows(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return rows as a tables.json has them: what many runs share, their code, is there once."""
    versions = {digest(row["code"]): row["code"] for row in rows if row["code"]}
    return {"runs": [{**row, "code": digest(row["code"]) if row["code"] else None} for row in rows], "code": versions}


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
