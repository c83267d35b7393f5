"""How we write, as far as a machine can check it: docstrings of public functions, and words that do not come back."""

import ast
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("mpm", "robosim", "policies")
FILES = sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))
PAGES = [*ROOT.glob("*.md"), *(p for p in (ROOT / "docs").rglob("*.md") if "_build" not in p.parts)]
OVERRIDES = {"at", "at_back", "distance", "is_beyond", "least_thickness", "allocate", "node", "nearest_normals",
             "signature", "stress", "energy_density", "return_mapping", "return_mapping_back", "mirror", "slide",
             "slide_back"}
"""Methods of shapes, laws and walls that a protocol describes once."""
CLASSES = {node.name: node for path in FILES for node in ast.parse(path.read_text()).body
           if isinstance(node, ast.ClassDef)}
HISTORY = "CHANGELOG.md"
"""A page that names things as they were called when it was written."""


def retired_words() -> str:
    """Return one regular expression of all words that are retired."""
    lines = (ROOT / "tests" / "retired_words.txt").read_text().splitlines()
    return "|".join(f"(?:{line})" for line in lines if line and not line.startswith("#"))


def is_described(name: str, bases: list[ast.expr]) -> bool:
    """Return whether a base of a class, or one of its own bases, describes a method."""
    known = [CLASSES[base] for base in (ast.unparse(one).split(".")[-1] for one in bases) if base in CLASSES]
    return any(is_described(name, owner.bases) or any(
        isinstance(node, ast.FunctionDef) and node.name == name and ast.get_docstring(node) for node in owner.body)
        for owner in known)


def test_public_functions_have_docstrings() -> None:
    """A method that a base describes may go without."""
    for path in FILES:
        tree = ast.parse(path.read_text())
        for owner in [tree, *(node for node in tree.body if isinstance(node, ast.ClassDef))]:
            for node in owner.body:
                if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_"):
                    inherits = isinstance(owner, ast.ClassDef) and owner.bases and (
                        node.name in OVERRIDES or is_described(node.name, owner.bases))
                    if isinstance(node, ast.ClassDef) and isinstance(node.body[0], ast.Pass):
                        continue  # its base makes the docstring
                    assert ast.get_docstring(node) or inherits, f"{path.relative_to(ROOT)}: {node.name}: no docstring"


def test_retired_words_do_not_come_back() -> None:
    pattern, found = re.compile(retired_words(), re.I), []
    for path in [*FILES, *(page for page in PAGES if page.name != HISTORY)]:
        for number, line in enumerate(path.read_text().splitlines(), 1):
            if match := pattern.search(line):
                found.append(f"{path.relative_to(ROOT)}:{number}: {match[0]!r}")
    assert not found, "\n".join(found)
