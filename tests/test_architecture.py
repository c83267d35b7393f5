"""Rules that a machine can keep: who imports whom, how long a file is, what a package promises."""

import ast
import importlib
import re
import subprocess
import sys
from importlib.metadata import packages_distributions, requires
from pathlib import Path

import pytest

from robosim.envs import BUNDLED

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("mpm", "robosim", "policies")
OWNERS = {"taichi": {"mpm/backend/session.py"}, "mujoco": {"robosim/"}, "pinocchio": {"robosim/"},
          "ruckig": {"robosim/"}, "torch": {"policies/"}, "stable_baselines3": {"policies/"}}
"""Third-party module -> where alone it may be imported."""
FORBIDDEN = {"mpm": {"robosim", "policies", "yaml", "pydantic"}, "robosim": {"policies"}, "policies": set()}
"""Package -> what it must not import."""
FILES = sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))


def imported(path: Path, at_once: bool = False) -> set[str]:
    """Top-level names of all modules that a file imports, or only of those that it needs to be imported itself."""
    found, tree = set(), ast.parse(path.read_text())
    for node in tree.body if at_once else ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            found.add(node.module.split(".")[0])
    return found


def test_files_keep_the_rules() -> None:
    for path in FILES:
        place, text, modules = path.relative_to(ROOT).as_posix(), path.read_text(), imported(path)
        for module, owners in OWNERS.items():
            if module in modules:
                assert any(place.startswith(owner) for owner in owners), f"{place} imports {module}"
        forbidden = modules & FORBIDDEN[place.split("/")[0]]
        assert not forbidden, f"{place} imports {forbidden}"
        assert len(text.splitlines()) <= 350, place
        assert not re.fullmatch(r"(utils?|helpers?|common|misc|manager|handler)\.py", path.name), place
        # taichi cannot read annotations that are strings
        assert "from __future__ import annotations" not in text, place


def test_nothing_in_the_simulator_knows_the_studies() -> None:
    """Studies use the simulator; only the command line, which stands above both, imports them."""
    for path in FILES:
        place = path.relative_to(ROOT).as_posix()
        if place.startswith(("mpm/", "robosim/")) and not place.startswith(("robosim/studies/", "robosim/commands/")):
            assert "robosim.studies" not in path.read_text(), place


UNBOUNDED = re.compile(r"\b(np\.load|np\.fromfile|np\.loadtxt|yaml\.\w*load|json\.load|pickle\.load|csv\.reader)\("
                       r"(?!io\.StringIO\(read_text)")
"""Readers that take what a file says; those of mpm/array_files.py and robosim/base/input_files.py have limits."""


def test_files_are_read_within_limits() -> None:
    lines = [line.strip() for path in FILES for line in path.read_text().splitlines() if UNBOUNDED.search(line)]
    assert all(re.search(r"yaml\.load\(.*, _?Loader\)$", line) for line in lines) and len(lines) == 1, lines


def test_tests_are_short_too() -> None:
    assert not [path.name for path in (ROOT / "tests").glob("*.py") if len(path.read_text().splitlines()) > 350]


@pytest.mark.parametrize("package", ["mpm", "robosim"])
def test_public_names_exist(package: str) -> None:
    module = importlib.import_module(package)
    assert module.__all__ == sorted(module.__all__, key=lambda n: n)
    assert all(hasattr(module, name) for name in module.__all__)


def run_time_modules() -> list[str]:
    """Modules that the commands import when they run, but for those that may be missing: with `except ImportError`."""
    paths = [path for package in ("robosim", "policies") for path in (ROOT / package / "commands").rglob("*.py")]
    functions = [node for path in paths for node in ast.walk(ast.parse(path.read_text()))
                 if isinstance(node, ast.FunctionDef)]
    guarded = {id(line) for function in functions for node in ast.walk(function) if isinstance(node, ast.Try)
               and "ImportError" in map(ast.unparse, filter(None, (h.type for h in node.handlers)))
               for line in ast.walk(node)}
    return sorted({line.module for function in functions for line in ast.walk(function)
                   if isinstance(line, ast.ImportFrom) and line.module is not None and id(line) not in guarded})


def test_the_command_line_needs_the_core_dependencies_alone() -> None:
    """`pip install .` brings no extras, and every command has to start with that."""
    code = (f"import sys, robosim.commands.main, {', '.join(run_time_modules())}; robosim.commands.main.parser(); "
            "print(*{m.__file__ for m in list(sys.modules.values()) if getattr(m, '__file__', None)}, sep=chr(10))")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = [path for path in FILES if str(path) in done.stdout.splitlines()]
    for place in ("policies/methods/train.py", "robosim/rehearsal/session.py", "robosim/commands/keys.py"):
        assert ROOT / place in loaded
    core = [words for words in requires("robosim") or () if "extra" not in words]
    names = {plain(re.split(r"[^A-Za-z0-9_.-]", words)[0]) for words in core}
    owners = {"pinocchio": ["pin"], **packages_distributions()}  # pin's folder is not a site's own
    for path in loaded:
        for module in imported(path, at_once=True) - sys.stdlib_module_names - set(PACKAGES):
            assert names & {plain(owner) for owner in owners.get(module, [module])}, f"{path} imports {module} at once"


def plain(name: str) -> str:
    """A distribution's name as installers compare it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def test_packages_import_their_public_names_lazily() -> None:
    code = "import sys, mpm, robosim; print(*({'taichi', 'numpy', 'mujoco', 'gymnasium', 'yaml'} & set(sys.modules)))"
    assert not subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip()


@pytest.mark.parametrize("order", ["robosim, gymnasium", "gymnasium, robosim"])
def test_import_robosim_registers_the_environments(order: str) -> None:
    """Also where Gymnasium, which `import robosim` leaves alone, is imported after it."""
    code = f"import {order}; print(*(name for name in gymnasium.registry if name.startswith('robosim/')))"
    done = subprocess.run([sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, check=True)
    assert len(done.stdout.split()) == len(BUNDLED) + 1 and "robosim/SpoonPour-v0" in done.stdout
