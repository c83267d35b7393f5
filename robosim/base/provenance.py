"""Provenance of a report: command, commit and machine, and digests of the code that a result depends on."""

import ast
import hashlib
import os
import platform
import subprocess
import sys
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path

from robosim.base.resources import folder

ROOT = Path(__file__).resolve().parent.parent.parent
PACKAGES = ("mpm", "robosim")
LIBRARIES = ("taichi", "mujoco", "numpy", "scipy", "trimesh", "pin", "ruckig")
"""Libraries whose version a numerical result depends on."""


def commit() -> str:
    """Return the commit of this code, with "-dirty" after local changes; outside a checkout the version."""
    if (ROOT / ".git").exists():
        git = subprocess.run(["git", "describe", "--always", "--dirty", "--exclude=*"], cwd=ROOT, capture_output=True,
                             text=True, check=False)
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
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    return next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), platform.machine())


def imported_modules(path: Path) -> set[str]:
    """Return the modules of our packages that a file imports, anywhere in it."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return {name for name in names if name.split(".")[0] in PACKAGES}


def module_file(module: str) -> Path | None:
    """Return a module's file; None for a name that is no module."""
    path = ROOT.joinpath(*module.split("."))
    return next((p for p in (path.with_suffix(".py"), path / "__init__.py") if p.is_file()), None)


def source_files(module: str) -> list[Path]:
    """Return a module's file and those of all of our modules that it imports, directly or not."""
    waiting, files = [module], set()
    while waiting:
        path = module_file(waiting.pop())
        if path is not None and path not in files:
            files.add(path)
            waiting += sorted(imported_modules(path))
    return sorted(files)


@lru_cache
def code_digest(module: str) -> str:
    """Return twelve hexadecimal digits of all that a module's results depend on.

    They change with its code and that of our modules it imports, with configurations and models, and with the versions
    of the libraries that compute.
    """
    digest = hashlib.sha256(" ".join(version(name) for name in LIBRARIES).encode())
    models = [path for kind in ("xml", "stl") for path in folder("models").rglob(f"*.{kind}")]
    for path in sorted([*folder("configs").rglob("*.yaml"), *models]):
        digest.update(path.read_bytes())
    for path in source_files(module):
        digest.update(path.relative_to(ROOT).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()[:12]
