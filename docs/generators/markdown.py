"""Tables and values in Markdown."""

from collections.abc import Iterable, Sequence
from typing import Any


def cell(value: Any) -> str:
    """A value for a table: numbers to three figures, no characters that end a cell or open markup."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        value = f"{float(f'{value:.3g}'):.0f}" if 1e3 <= abs(value) < 1e6 else f"{value:.3g}"
    return str(value).replace("|", r"\|").replace("\n", " ").replace("<", r"\<").replace("*", r"\*")


def table(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """A pipe table."""
    lines = [f"| {' | '.join(head)} |", f"|{'---|' * len(head)}"]
    lines += [f"| {' | '.join(cell(value) for value in row)} |" for row in rows]
    return "\n".join(lines) + "\n"


def code(text: str) -> str:
    """Text between backticks, or nothing."""
    return f"`{text}`" if text else ""
