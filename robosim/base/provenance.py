"""Provenance of a report: command, commit and machine."""

import contextlib
import os
import platform
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

from robosim.base.resources import CHECKOUT


def commit() -> str:
    """Return the commit of this code, with "-dirty" after local changes; outside a checkout the version."""
    if (CHECKOUT / ".git").exists():
        with contextlib.suppress(OSError):  # git is not installed
            # of whichever owner: in a container the user is often another
            git = subprocess.run(["git", "-c", "safe.directory=*", "describe", "--always", "--dirty", "--exclude=*"],
                                 cwd=CHECKOUT, capture_output=True, text=True, check=False)
            if git.returncode == 0:
                return git.stdout.strip()
    return f"none, version {version('robosim')}"


def provenance() -> dict[str, str]:
    """Return command, commit, versions and machine, for the header of a page."""
    return {"command": " ".join(["robosim", *sys.argv[1:]]), "commit": commit(), "python": platform.python_version(),
            "taichi": version("taichi"), "mujoco": version("mujoco"),
            "machine": f"{processor()}, {os.cpu_count()} cores"}


def processor() -> str:
    """Return the machine's name for its processor."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    return next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), platform.machine())
