"""Arms of other people's packages, of foreign_arms.yaml: where they are, and the tables that a rehearsal takes."""

import os
import sys
from pathlib import Path
from typing import Any

import yaml

ARMS: dict[str, dict[str, Any]] = yaml.safe_load(Path(__file__).with_suffix(".yaml").read_text())


def find_arm(name: str) -> dict[str, Any] | None:
    """Return `robot` of a rehearsal, from the folder ROBOSIM_ARMS or an installed package; None without the package."""
    arm = ARMS[name]
    for folder in (os.environ.get("ROBOSIM_ARMS"), *sys.path):
        if folder and (file := Path(folder, arm["model"]).resolve()).is_file():
            return {key: value for key, value in arm.items() if key in ("flange", "limits", "base")} | {
                "model": str(file)}
    return None
