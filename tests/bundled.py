"""Bundled files, with settings and other values for their top keys, and the plans of bundled rehearsals."""

import atexit
from functools import cache
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


def rehearsal(name: str, *settings: str, **keys: Any) -> RehearsalConfig:
    """Return a bundled rehearsal with settings "KEY=VALUE" and other top keys."""
    return load_rehearsal(name, keys, [read_setting(text) for text in settings])


@cache
def plan_of(name: str) -> Plan:
    """Return the plan of a bundled rehearsal, which all tests of a session read."""
    return plan_motion(check_config(load_rehearsal(name)))


atexit.register(plan_of.cache_clear)  # libraries print what is left of their objects at the very end
