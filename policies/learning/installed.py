"""Check of the packages that learning needs."""

from importlib.util import find_spec

import mpm

NEEDED = ("torch", "stable_baselines3", "sb3_contrib", "tensorboard", "cma")
"""Modules of the extra `learn`."""


def check_installed() -> None:
    """Raise mpm.InvalidValue where a module is missing."""
    missing = [name for name in NEEDED if find_spec(name) is None]
    if missing:
        raise mpm.InvalidValue(f"learning needs {', '.join(missing)}: pip install '.[learn]' in the checkout")
