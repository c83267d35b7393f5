"""Tables of runs as text, and as blocks of a page."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from policies.results.summary import FIGURES, Summaries


class TextTable(NamedTuple):
    """A table of texts with a title."""

    title: str
    head: list[str]
    rows: list[list[str]]


def align_columns(lines: list[list[str]]) -> str:
    """Return lines of cells as text with aligned columns; all lines have the same number of cells."""
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return "\n".join("  ".join(map(str.ljust, line, widths)).rstrip() for line in lines)


def format_table(summaries: Summaries, published: dict, figure: str,
                 form: Callable[[dict[str, Any]], str]) -> list[list[str]]:
    """Return a figure's table as lines of cells, methods by tasks; form: text of one cell's statistics."""
    tasks = [task for task in published["tasks"] if any(task in row for row in summaries.values())]
    tasks += sorted({task for row in summaries.values() for task in row} - set(tasks))
    lines = [["method", *tasks]]
    for line in sorted(summaries):
        cells = (summaries[line].get(task, {}).get(figure) for task in tasks)
        lines.append([line, *("" if cell is None else form(cell) for cell in cells)])
    return lines


SCORES = {"tcs_evaluated": "evaluated", "tcs_last10": "last ten", "tcs_of_best_return": "best motion"}
"""Figures of the table of scores, and their columns."""


def score_table(summaries: Summaries, published: dict) -> TextTable:
    """Return the scores of every task and method, ours in a column each, beside the published one."""
    def form(cell: dict | None) -> str:
        if cell is None:
            return "-"
        return f"{cell['mean']:.1f}" + (f" ± {cell['std']:.1f}" if cell["n"] > 1 else "")

    tasks = [*published["tasks"], *sorted({task for row in summaries.values() for task in row}
                                          - set(published["tasks"]))]
    rows = []
    for task in tasks:
        for line in sorted(line for line in summaries if task in summaries[line]):
            cells = summaries[line][task]
            theirs = cells.get("tcs_last10", {}).get("published")
            rows.append([task, line, str(max(cell["n"] for cell in cells.values())),
                         *(form(cells.get(figure)) for figure in SCORES),
                         "-" if theirs is None else f"{theirs[0]:.1f} ± {theirs[1]:.1f}"])
    return TextTable(f"scores: the best policy without exploration, the last ten episodes, the motion with the highest "
                     f"return; last column {published['source']}, last ten episodes",
                     ["task", "method", "runs", *SCORES.values(), "published"], rows)


def format_scores(summaries: Summaries, published: dict) -> str:
    """Return the table of scores as text."""
    table = score_table(summaries, published)
    return f"{table.title}:\n{align_columns([table.head, *table.rows])}"


def fill_page(page: Any, summaries: Summaries, published: dict, sources: list[Path], further_tables: list[TextTable],
              notes: dict[str, list[str]]) -> None:
    """Put all tables, and lists of notes by title, into a page, such as `robosim.reports.page.Page`."""
    problems = sum(map(len, notes.values()))
    runs = sum(max(cell["n"] for cell in cells.values()) for row in summaries.values() for cells in row.values())
    page.set_verdict(f"{runs} finished runs" + (f"; {problems} notes below" if problems else ""), holds=not problems)
    page.add_text(f"Runs in {', '.join(map(str, sources))}. Mean ± standard deviation; IQM: interquartile mean with "
                  f"its 95 % interval. Published: {published['source']}, on a different geometry.")
    tables = [score_table(summaries, published)]
    tables += [TextTable(title, *_split(format_table(summaries, published, figure, _format_cell)))
               for figure, title in FIGURES.items()]
    for table in [*tables, *further_tables]:
        if not any(any(row[1:]) for row in table.rows):
            continue
        page.add_heading(table.title)
        page.add_table(table.head, table.rows)
    for title, texts in notes.items():
        if texts:
            page.add_heading(title)
            page.add_table(["note"], [[text] for text in texts])


def _split(lines: list[list[str]]) -> tuple[list[str], list[list[str]]]:
    return lines[0], lines[1:]


def _format_cell(cell: dict[str, Any]) -> str:
    """Return the text of one cell's statistics."""
    text = f"{cell['mean']:.2f}, 1 run" if cell["n"] == 1 else \
        f"{cell['mean']:.2f} ± {cell['std']:.2f}, {cell['n']} runs, IQM {cell['iqm']:.2f} " \
        f"[{cell['low']:.2f}, {cell['high']:.2f}]"
    return text + ("; published {:.2f} ± {:.2f}".format(*cell["published"]) if cell["published"] else "")
