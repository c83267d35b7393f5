"""Digests of values and of code: whether a stored result is of today.
The digest of code is that of its syntax tree without comments and docstrings, so that a reworded one changes no digest.
"""

import ast
import contextlib
import hashlib
import json
import os
import sys
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import platformdirs

from mpm.backend.cache_folder import writable_folder
from mpm.files import syntax_of
from robosim.base.files import write_json
from robosim.base.input_files import check_form, read_json
from robosim.base.resources import folder

ROOT = Path(__file__).resolve().parent.parent.parent
PACKAGES = ("mpm", "robosim", "policies")
LIBRARIES = ("taichi", "mujoco", "numpy", "scipy", "trimesh", "pin", "ruckig")
"""Libraries whose version a numerical result depends on."""
SHOWS_ONLY = ("commands", "results", "reports")
"""Folders of packages that read arguments or show results: no figure of a run depends on them."""
DATA = {"configs": ("*.yaml",), "models": ("*.xml", "*.stl", "*.ply", "*.yaml")}
"""Folders with data that results depend on, and the names of their files."""
LEARNING = ("training", "published")
"""Folders of configs that no simulation reads: methods of learning, and queues of training runs, whose own results hold
what they were made with."""
MEMO, MOST_REMEMBERED = "modules.json", 4000
"""File of the cache with the modules that were parsed, and how many of them it holds."""


class Module(NamedTuple):
    """The parts of a module's source that results depend on."""

    digest: str
    """Eight hexadecimal digits of its syntax tree without docstrings."""
    imports: list[str]
    """Names that it imports from our packages, anywhere in it."""


def digest(value: Any) -> str:
    """Return twelve hexadecimal digits of the SHA-256 of a value's JSON."""
    return hashlib.sha256(json.dumps(value, sort_keys=True, default=str).encode()).hexdigest()[:12]


def cache_folder(name: str) -> Path:
    """Return a folder below ROBOSIM_CACHE or the user's cache folder, or a temporary one where that is read-only."""
    chosen = os.environ.get("ROBOSIM_CACHE")
    return Path(chosen) / name if chosen else writable_folder(Path(platformdirs.user_cache_dir("robosim")) / name, name)


@cache
def code_digest(*modules: str, with_data: bool = True) -> str:
    """Return twelve hexadecimal digits of the code that the results of modules depend on.
    They change with the syntax of the modules and of all of ours that these import, directly or not, and with the
    versions of the libraries that compute. with_data: and with bundled configurations and models."""
    total = hashlib.sha256(" ".join(version(name) for name in LIBRARIES).encode())
    total.update(data_digest() if with_data else b"")
    for path in source_files(*modules):
        total.update(f"{path.stem} {read_module(path).digest} ".encode())
    _store_memo()
    return total.hexdigest()[:12]


@cache
def data_digest() -> bytes:
    """Return a digest of all bundled configurations and models but those of LEARNING."""
    total = hashlib.sha256()
    for path in sorted(path for name, kinds in DATA.items() for kind in kinds for path in folder(name).rglob(kind)):
        if path.parent.name not in LEARNING:
            total.update(path.read_bytes())
    return total.digest()


def exercised_code() -> dict[str, str]:
    """Return the modules of this project that the process has loaded, and a digest of each."""
    names = sorted(name for name in sys.modules if name.split(".")[0] in PACKAGES
                   and (name.split(".") + [""])[1] not in SHOWS_ONLY)
    found = {name: read_module(path).digest for name in names if (path := module_file(name)) is not None}
    _store_memo()
    return found


def changed_modules(stored: dict[str, str]) -> list[str]:
    """Return the modules whose digests differ from stored ones, or that are gone."""
    return [name for name, known in stored.items()
            if (path := module_file(name)) is None or read_module(path).digest != known]


def source_files(*modules: str) -> list[Path]:
    """Return the files of modules and of all of our modules that they import, directly or not."""
    waiting = [path for path in map(module_file, modules) if path is not None]
    files: set[Path] = set()
    while waiting:
        path = waiting.pop()
        if path not in files:
            files.add(path)
            waiting += [found for found in map(module_file, read_module(path).imports) if found is not None]
    return sorted(files)


@cache
def module_file(module: str) -> Path | None:
    """Return a module's file; None for a name that is no module."""
    path = ROOT.joinpath(*module.split("."))
    return next((p for p in (path.with_suffix(".py"), path / "__init__.py") if p.is_file()), None)


@cache
def read_module(path: Path) -> Module:
    """Return digest and imports of a file, from the memo where it has a file of the same bytes."""
    data, (memo, _) = path.read_bytes(), _memo()
    key = f"{sys.version_info[0]}.{sys.version_info[1]} {hashlib.sha256(data).hexdigest()[:32]}"  # trees differ
    if key not in memo:
        memo[key] = parse_module(data.decode())._asdict()
    return Module(**memo[key])


def parse_module(source: str) -> Module:
    """Return digest and imports of a source."""
    names: set[str] = set()
    tree = syntax_of(source)
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return Module(hashlib.sha256(ast.dump(tree).encode()).hexdigest()[:8],
                  sorted(name for name in names if name.split(".")[0] in PACKAGES))


@cache
def _memo() -> tuple[dict[str, dict[str, Any]], set[str]]:
    """Return what was parsed, by version of Python and digest of a file's bytes, and which of it its file has."""
    try:
        memo = read_json(cache_folder("code") / MEMO)
        check_form(memo, {str: {"digest": str, "imports": [str]}})
    except (OSError, ValueError):
        memo = {}
    return memo, set(memo)


def _store_memo() -> None:
    """Write the memo where it has grown; without it, the next process parses again."""
    memo, stored = _memo()
    if len(memo) > len(stored):
        stored |= memo.keys()
        with contextlib.suppress(OSError):
            path = cache_folder("code") / MEMO
            path.parent.mkdir(parents=True, exist_ok=True)
            write_json(path, dict(list(memo.items())[-MOST_REMEMBERED:]))
