"""Code of docstrings, so that tests run what a reader copies."""

import ast
import inspect
import linecache
import textwrap
from typing import Any


def run_example(owner: Any, after: str, namespace: dict[str, Any]) -> dict[str, Any]:
    """Run the indented block of an object's docstring that follows the line ending with `after`.

    namespace: names that the block uses. Returns it with the names that the block defines."""
    docstring = inspect.getdoc(owner) or ""
    _, found, rest = docstring.partition(f"{after}\n\n")
    assert found, f"{owner.__name__}: no line of its docstring ends with {after!r}"
    lines = rest.split("\n")
    end = next((k for k, line in enumerate(lines) if line.strip() and not line.startswith("    ")), len(lines))
    source = textwrap.dedent("\n".join(lines[:end]))
    ast.parse(source)
    file = f"<example of {owner.__qualname__}>"
    linecache.cache[file] = (len(source), None, source.splitlines(True), file)  # Taichi reads the source of kernels
    namespace["__name__"] = file
    exec(compile(source, file, "exec"), namespace)
    return namespace
