"""Which code made a report, and what a case exercises of it."""

import ast
import hashlib
import os
import platform
import subprocess
import sys
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path

from robosim.config.resources import folder

ROOT = Path(__file__).resolve().parent.parent.parent
PACKAGES = ("mpm", "robosim")
LIBRARIES = ("taichi", "mujoco", "numpy", "scipy", "trimesh", "pin", "ruckig")
"""Those that compute."""


def commit() -> str:
    """The commit of this code, "-dirty" where it is not what was committed; its version outside a checkout."""
    if (ROOT / ".git").exists():
        told = subprocess.run(["git", "describe", "--always", "--dirty", "--exclude=*"], cwd=ROOT, capture_output=True,
                              text=True, check=False)
        if told.returncode == 0:
            return told.stdout.strip()
    return version("robosim")


def provenance() -> dict[str, str]:
    """Command, commit and machine, for the top of a page."""
    return {"command": " ".join(["robosim", *sys.argv[1:]]), "commit": commit(), "python": platform.python_version(),
            "taichi": version("taichi"), "mujoco": version("mujoco"),
            "machine": f"{processor()}, {os.cpu_count()} cores"}


def processor() -> str:
    """What the machine calls its processor."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    return next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), platform.machine())


def imported(path: Path) -> set[str]:
    """Modules of our packages that a file imports, anywhere in it."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            found |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return {name for name in found if name.split(".")[0] in PACKAGES}


def file_of(module: str) -> Path | None:
    """A module's file, None for a name that is none."""
    path = ROOT.joinpath(*module.split("."))
    return next((p for p in (path.with_suffix(".py"), path / "__init__.py") if p.is_file()), None)


def files_of(module: str) -> list[Path]:
    """A module's file, and those of all that it imports of ours, at any remove."""
    todo, seen = [module], set()
    while todo:
        path = file_of(todo.pop())
        if path is not None and path not in seen:
            seen.add(path)
            todo += sorted(imported(path))
    return sorted(seen)


@lru_cache
def version_of(module: str) -> str:
    """Twelve letters that change with a module's code or that of anything it imports of ours, with configurations and
    models, and with the libraries that compute."""
    told = hashlib.sha256(" ".join(version(name) for name in LIBRARIES).encode())
    models = [path for kind in ("xml", "stl") for path in folder("models").rglob(f"*.{kind}")]
    for path in sorted([*folder("configs").rglob("*.yaml"), *models]):
        told.update(path.read_bytes())
    for path in files_of(module):
        told.update(path.relative_to(ROOT).as_posix().encode() + path.read_bytes())
    return told.hexdigest()[:12]
