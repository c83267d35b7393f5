"""Public names of a package that are imported where they are first used (PEP 562)."""

import ast
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any


def lazy_names(package: str, file: str) -> tuple[Callable[[str], Any], Callable[[], Any], list[str]]:
    """Return `__getattr__`, `__dir__` and `__all__` of a package.
    The names are those that the package's `__init__`, `file`, imports under `if TYPE_CHECKING:`, so that each stands in
    one place, which type checkers read too. A name is imported at its first use and remembered."""
    tree = ast.parse(Path(file).read_text(encoding="utf-8"))
    guarded = [node for node in tree.body if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"]
    module_of = {alias.name: line.module for node in guarded for line in node.body
                 if isinstance(line, ast.ImportFrom) and line.module for alias in line.names}

    def get_attribute(name: str) -> Any:
        if name not in module_of:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value = getattr(import_module(module_of[name]), name)
        setattr(sys.modules[package], name, value)
        return value

    def list_names() -> list[str]:
        return sorted({*vars(sys.modules[package]), *module_of})

    return get_attribute, list_names, sorted(module_of)
