"""The layout of the packages: which folder may import which, how deep, how large, and that tests follow it."""

import ast
import re
from functools import lru_cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
FLOORS = {"mpm": 8, "robosim": 10, "policies": 6}
"""Package -> the most folders that may stand on one another."""
MOST_FILES = 12
"""Python files in a folder, its `__init__` aside."""


@lru_cache
def modules(package: str) -> dict[str, Path]:
    """Module name -> file, of a whole package."""
    paths = (ROOT / package).rglob("*.py")
    return {".".join(p.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): p for p in paths}


def room(module: str) -> str:
    """The folder of a module, as a package name; files at the top of a package are rooms of their own."""
    path = modules(module.split(".")[0])[module]
    folder = ".".join(path.parent.relative_to(ROOT).parts)
    return module if "." not in folder else folder


def imports(module: str) -> set[str]:
    """Modules of the same package that a module imports, anywhere in it."""
    known = modules(module.split(".")[0])
    found: set[str] = set()
    for node in ast.walk(ast.parse(known[module].read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:
                full = f"{node.module}.{alias.name}"
                found.add(full if full in known else node.module)
    return (found & set(known)) - {module}


@lru_cache
def graph(package: str, by_room: bool) -> dict[str, set[str]]:
    """Room (or module) -> the others that it imports; among rooms the package's own `__init__` stands above all."""
    arrows: dict[str, set[str]] = {}
    for module in modules(package):
        place = room(module) if by_room else module
        targets = {room(other) if by_room else other for other in imports(module) if not by_room or other != package}
        arrows.setdefault(place, set()).update(targets - {place})
    return arrows


@pytest.mark.parametrize("package", FLOORS)
@pytest.mark.parametrize("by_room", [True, False], ids=["folders", "files"])
def test_nothing_imports_in_a_circle(package: str, by_room: bool) -> None:
    arrows = graph(package, by_room)
    floors: dict[str, int] = {}
    for place in TopologicalSorter(arrows).static_order():  # bottom up; raises CycleError
        floors[place] = 1 + max((floors[below] for below in arrows[place]), default=0)
    if by_room:
        folders = [place for place in arrows if (ROOT / place.replace(".", "/")).is_dir() and place != package]
        top = max(floors[place] for place in folders)
        assert top <= FLOORS[package], sorted(floors.items(), key=lambda item: -item[1])[:5]


@pytest.mark.parametrize("package", FLOORS)
def test_a_folder_imports_what_it_declares(package: str) -> None:
    """The docstring of a folder's `__init__` ends with `Imports: a, b.`: folders and files of the project."""
    for place, targets in graph(package, True).items():
        path = ROOT / place.replace(".", "/") / "__init__.py"
        if path.exists() and place != package:
            docstring = ast.get_docstring(ast.parse(path.read_text())) or ""
            declared = re.search(r"^Imports: ([^.]*)\.$", docstring, re.M)
            assert declared, f"{place}: its docstring has no line `Imports: ...`"
            allowed = {name.strip() for name in declared[1].split(",")}
            actual = {target.split(".")[1] for target in targets} - {place.split(".")[1]}
            assert actual <= allowed, f"{place} imports {sorted(actual - allowed)}, which it does not declare"


@pytest.mark.parametrize("package", FLOORS)
def test_folders_are_small(package: str) -> None:
    for folder in {path.parent for path in modules(package).values()}:
        files = [path.name for path in folder.glob("*.py") if path.name != "__init__.py"]
        assert len(files) <= MOST_FILES, f"{folder.relative_to(ROOT)} holds {len(files)} files"


def test_tests_are_laid_out_like_the_packages() -> None:
    for path in (ROOT / "tests").rglob("test_*.py"):
        folder = path.parent.relative_to(ROOT / "tests")
        assert folder == Path() or (ROOT / folder).is_dir(), f"{path.relative_to(ROOT)}: no folder {folder}"


def test_every_package_is_installed() -> None:
    """setuptools is given the list of packages by name; one that is missing would be missing in a wheel."""
    listed = set(re.findall(r'^    "([a-z_.]+)",$', (ROOT / "pyproject.toml").read_text(), re.M))
    for package in FLOORS:
        folders = {".".join(path.parent.relative_to(ROOT).parts) for path in modules(package).values()}
        assert folders <= listed, f"pyproject.toml leaves out {sorted(folders - listed)}"
