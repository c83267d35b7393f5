"""Atomic writing: under its name a file is always whole, whatever ends the process, and a failure keeps the old one.
And texts: of values in messages, and of code without its comments and docstrings."""

import ast
import os
import reprlib
import secrets
from collections.abc import Callable
from pathlib import Path


def temporary_path(path: Path) -> Path:
    """Return a hidden name in the same folder, with the same suffix, which no other process uses."""
    return path.with_name(f".{path.stem}.{secrets.token_hex(4)}.part{path.suffix}")


def write(path: Path, writer: Callable[[Path], object]) -> None:
    """Call `writer` with a temporary path in the same folder, flush that file to the disk and rename it to `path`.
    Whatever `writer` raises, or the disk (OSError), `path` stays as it was and no temporary file is left."""
    temporary = temporary_path(path)
    try:
        writer(temporary)
        rename(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def rename(temporary: Path, path: Path) -> None:
    """Flush a whole file to the disk and rename it to `path`."""
    with temporary.open("rb+") as file:
        os.fsync(file.fileno())  # or a power failure might leave the name without the content
    os.replace(temporary, path)


def syntax_of(source: str) -> ast.Module:
    """Return the syntax tree of a source without docstrings, those that follow constants and attributes among them."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            node.body = [one for one in body if not (  # pyright: ignore[reportAttributeAccessIssue]
                isinstance(one, ast.Expr) and isinstance(one.value, ast.Constant) and isinstance(one.value.value, str))]
    return tree


def show(name: object) -> str:
    """Return a name as messages show it: quoted where it would break their line, and shortened."""
    text = str(name)
    return text[:200] if text.isprintable() else quote(text)


def quote(value: object) -> str:
    """Return a value as messages show it: shortened, and without a failure for integers of thousands of digits."""
    short = reprlib.Repr()
    short.maxstring = short.maxother = 200
    short.maxlist = short.maxtuple = short.maxdict = 12
    try:
        return short.repr(value.item() if getattr(value, "shape", None) == () else value)
    except ValueError:  # Python refuses to write integers of more than 4300 digits
        return f"a value of type {type(value).__name__} that is too long to show"
