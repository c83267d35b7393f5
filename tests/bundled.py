"""Bundled files, with settings and other values for their top keys, and the plans of bundled rehearsals."""

import atexit
from functools import cache
from pathlib import Path
from typing import Any

import yaml

from robosim.base.resources import config_path
from robosim.config.rehearsal import RehearsalConfig, load_rehearsal
from robosim.config.settings import read_setting
from robosim.planning.plan import Plan, plan_motion
from robosim.rehearsal.session import check_config


def read_bundled(folder: str, name: str) -> dict[str, Any]:
    """Return the content of a bundled file."""
    return yaml.safe_load(config_path(folder, name, folder).read_text())


def write_short(path: Path) -> Path:
    """Write a rehearsal of three waypoints with cells of 10 mm, which exercises all parts in little time."""
    data = read_bundled("rehearsals", "spoon")
    by_name = {w["name"]: w for w in data["waypoints"]}
    for name in ("start", "home"):
        by_name[name]["position"][2] = 0.12
    dip = by_name["above"] | {"name": "dip", "position": [-0.03, 0, 0.06], "speed": 0.3, "stop": True, "dwell": 0.2}
    data["waypoints"] = [by_name["start"], dip, by_name["home"]]
    data.update(weigh_at="dip", tool_wall=0.005, grasp_time=0.2)
    data["field"] |= {"cell": 0.01, "grains_per_cell": 4}
    path.write_text(yaml.safe_dump(data))
    return path


def rehearsal(name: str, *settings: str, **keys: Any) -> RehearsalConfig:
    """Return a bundled rehearsal with settings "KEY=VALUE" and other top keys."""
    return load_rehearsal(name, keys, [read_setting(text) for text in settings])


@cache
def plan_of(name: str) -> Plan:
    """Return the plan of a bundled rehearsal, which all tests of a session read."""
    return plan_motion(check_config(load_rehearsal(name)))


atexit.register(plan_of.cache_clear)  # libraries print what is left of their objects at the very end
