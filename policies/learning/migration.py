"""Migration of what earlier versions wrote: presets and manifests of run folders, rows of tables."""

from typing import Any

import pydantic

from policies.learning.presets import OFF_POLICY, Preset

MANIFEST_KEYS = {"hold": "action_repeat"}
ROW_KEYS = {"hold": "action_repeat", "wanted": "max_episodes", "best": "tcs_of_best_return", "tcs": "tcs_last10"}
"""Old key -> new key."""


def migrate_preset(preset: dict[str, Any]) -> dict[str, Any]:
    """Return a stored preset with defaults for missing keys and without settings that had no effect.

    A dictionary that is no preset is returned unchanged.
    """
    has_no_effect = preset.get("residual") is not None or preset.get("learner") not in OFF_POLICY
    try:
        return Preset(**{**preset, **({"demonstrations": None} if has_no_effect else {})}).model_dump()
    except pydantic.ValidationError:
        return preset


def migrate_manifest(manifest: dict[str, Any]) -> dict[str, Any]:
    """Return the manifest of a run folder with today's keys and a migrated preset."""
    renamed = _rename_keys(manifest, MANIFEST_KEYS)
    return {**renamed, "preset": migrate_preset(renamed["preset"])} if isinstance(renamed.get("preset"), dict) \
        else renamed


def migrate_row(row: dict[str, Any]) -> dict[str, Any]:
    """Return a row of tables.json with today's keys."""
    return _rename_keys(row, ROW_KEYS)


def _rename_keys(values: dict[str, Any], names: dict[str, str]) -> dict[str, Any]:
    return {names.get(key, key): value for key, value in values.items()}
