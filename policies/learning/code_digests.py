"""Digests of the code that a run exercises: whether a stored result is older than it."""

import ast
import hashlib
import sys
from functools import cache
from importlib.util import find_spec
from pathlib import Path

PACKAGES = ("mpm", "robosim", "policies")
SHOWS_ONLY = ("commands", "results")
"""Folders of packages that read arguments or show results: no figure of a run depends on them."""


def exercised_code() -> dict[str, str]:
    """Return the modules of this project that the process has loaded, and a digest of each."""
    names = sorted(name for name in sys.modules if name.split(".")[0] in PACKAGES
                   and (name.split(".") + [""])[1] not in SHOWS_ONLY)
    return {name: digest for name in names if (digest := module_digest(name)) is not None}


@cache
def module_digest(name: str) -> str | None:
    """Return a digest of a module's statements, without comments and docstrings; None where there is none."""
    try:
        spec = find_spec(name)
    except ModuleNotFoundError:  # its package is gone
        return None
    if spec is None or spec.origin is None or not spec.origin.endswith(".py"):
        return None
    return source_digest(Path(spec.origin).read_text(encoding="utf-8"))


def source_digest(source: str) -> str:
    """Return eight hexadecimal digits of the SHA-256 of a source's syntax tree without docstrings."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):  # docstrings, and the texts that follow constants and attributes
            node.body = [one for one in body if not is_text(one)]  # pyright: ignore[reportAttributeAccessIssue]
    return hashlib.sha256(ast.dump(tree).encode()).hexdigest()[:8]


def is_text(node: ast.AST) -> bool:
    """Return whether a statement is a text alone."""
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


def changed_modules(stored: dict[str, str]) -> list[str]:
    """Return the modules whose statements differ from those of stored digests, or that are gone."""
    return [name for name, digest in stored.items() if module_digest(name) != digest]
