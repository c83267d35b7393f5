"""Docstrings are plain text with code between single backticks; this turns them into valid reStructuredText."""

import re
from typing import Any

from sphinx.application import Sphinx

CODE = re.compile(r"(`+[^`]+`+)")
SPAN = re.compile(r"(`+)(?!`)(?:(?!\n\s*\n).)+?(?<!`)\1(?!`)", re.S)
"""Code between backticks within a paragraph; it may go on in the next line."""
SPECIAL = re.compile(r"([*|\\])|(?<=\w)(_)(?!\w)")
ARRAY_LIKE = re.compile(r"~?[\w.]*_Buffer \| .*?_NestedSequence\[complex \| bytes \| str\]")
TEMPLATE = re.compile(r": <taichi\.[\w.]+ object at 0x[0-9a-f]+>")
TUPLE_FIELD = re.compile(r"Alias for field number \d+")
"""What Python says of a named tuple's field without a docstring."""
ITEM = re.compile(r"^(\s*)(\* |- |\d+\. )")


def escape(line: str) -> str:
    """A line of a docstring with its code as literals and other markup characters escaped."""
    lead = ITEM.match(line)
    head, rest = (lead[0], line[lead.end() :]) if lead else ("", line)
    parts = CODE.split(rest)
    return head + "".join(f"``{part.strip('`')}``" if k % 2 else SPECIAL.sub(r"\\\g<0>", part)
                          for k, part in enumerate(parts))


def starts_code(result: list[str], indent: int, line: str) -> bool:
    """Whether a line is the first of a code block: indented further, after a line that ends with a colon."""
    if len(result) < 2 or not line.strip() or result[-1].strip() or not result[-2].endswith(":"):
        return False
    return indent >= 4 + len(result[-2]) - len(result[-2].lstrip()) and ITEM.match(line) is None


def rewrite(app: Sphinx, what: str, name: str, owner: Any, options: Any, lines: list[str]) -> None:
    """Escape a docstring; a list starts a paragraph of its own, and code after a colon stays as it is."""
    lines[:] = [line for line in lines if not TUPLE_FIELD.fullmatch(line)]
    joined = SPAN.sub(lambda span: re.sub(r"\n\s*", " ", span[0]), "\n".join(lines)).split("\n")
    result: list[str] = []
    code_indent = 0
    for line in joined:
        indent = len(line) - len(line.lstrip())
        if code_indent and (indent >= code_indent or not line.strip()):
            result.append(line)
            continue
        code_indent = 0
        if starts_code(result, indent, line):
            result[-2], code_indent = result[-2] + ":", indent
            result.append(line)
            continue
        is_item = ITEM.match(line) is not None
        last = result[-1] if result else ""
        if is_item and last.strip() and not (ITEM.match(last) or last.startswith(" ")):
            result.append("")
        result.append(escape(line))
    lines[:] = result


def shorten(app: Sphinx, what: str, name: str, owner: Any, options: Any, signature: str | None,
            returned: str | None) -> tuple[str | None, str | None]:
    """Write numpy's ArrayLike by its name, and leave out that an argument is a Taichi template."""
    signature = signature and TEMPLATE.sub("", ARRAY_LIKE.sub("ArrayLike", signature))
    return signature, returned and ARRAY_LIKE.sub("ArrayLike", returned)


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect to autodoc."""
    app.connect("autodoc-process-docstring", rewrite)
    app.connect("autodoc-process-signature", shorten)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
