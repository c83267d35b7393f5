"""Tables of texts: their layout in a terminal."""

from typing import NamedTuple


class TextTable(NamedTuple):
    """A table of texts with a title."""

    title: str
    head: list[str]
    rows: list[list[str]]


def align_columns(lines: list[list[str]]) -> str:
    """Return lines of cells as text with aligned columns; all lines have the same number of cells."""
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return "\n".join("  ".join(map(str.ljust, line, widths)).rstrip() for line in lines)
