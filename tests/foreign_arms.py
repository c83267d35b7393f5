"""Arms of other people's packages, of foreign_arms.yaml: where they are, and the tables that a rehearsal takes."""

import os
import sys
from pathlib import Path
from typing import Any

import yaml

ARMS: dict[str, dict[str, Any]] = yaml.safe_load(Path(__file__).with_suffix(".yaml").read_text())


def find_model(model: str) -> str | None:
    """Return a model's path in the folder ROBOSIM_ARMS or an installed package; None without the package."""
    files = (Path(folder, model).resolve() for folder in (os.environ.get("ROBOSIM_ARMS"), *sys.path) if folder)
    return next((str(file) for file in files if file.is_file()), None)


def find_arm(name: str) -> dict[str, Any] | None:
    """Return `robot` of a rehearsal; None without its package."""
    arm, file = ARMS[name], find_model(ARMS[name]["model"])
    return None if file is None else {key: arm[key] for key in arm if key in ("flange", "limits", "base")} | {
        "model": file}
