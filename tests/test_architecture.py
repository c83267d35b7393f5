"""Rules that a machine can keep: who imports whom, how long a file is, what a package promises."""

import ast
import importlib
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("mpm", "robosim", "policies")
OWNERS = {"taichi": {"mpm/backend.py"}, "mujoco": {"robosim/"}, "pinocchio": {"robosim/"}, "ruckig": {"robosim/"},
          "torch": {"policies/"}, "stable_baselines3": {"policies/"}}
"""Third-party module -> where alone it may be imported."""
FORBIDDEN = {"mpm": {"robosim", "policies", "yaml", "pydantic"}, "robosim": {"policies"}, "policies": {"robosim"}}
"""Package -> what it must not import."""
FILES = sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))


def imported(path: Path) -> set[str]:
    """Top-level names of all modules that a file imports."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            found.add(node.module.split(".")[0])
    return found


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(ROOT)))
def test_file_keeps_the_rules(path: Path) -> None:
    place = path.relative_to(ROOT).as_posix()
    modules = imported(path)
    for module, owners in OWNERS.items():
        if module in modules:
            assert any(place.startswith(owner) for owner in owners), f"{place} imports {module}"
    assert not modules & FORBIDDEN[place.split("/")[0]], f"{place} imports {modules & FORBIDDEN[place.split('/')[0]]}"
    assert len(path.read_text().splitlines()) <= 350
    assert not re.fullmatch(r"(utils?|helpers?|common|misc|manager|handler)\.py", path.name)
    # taichi cannot read annotations that are strings
    assert "from __future__ import annotations" not in path.read_text()


@pytest.mark.parametrize("package", ["mpm", "robosim"])
def test_public_names_exist(package: str) -> None:
    module = importlib.import_module(package)
    assert module.__all__ == sorted(module.__all__, key=lambda n: n)
    assert all(hasattr(module, name) for name in module.__all__)


def test_the_command_line_needs_no_learning_libraries() -> None:
    """`pip install .` brings none of them, and every command loads all commands."""
    heavy = ("torch", "stable_baselines3", "sb3_contrib", "cma", "tensorboard")
    code = f"import sys, robosim.cli; robosim.cli.parser(); print([name for name in {heavy} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
