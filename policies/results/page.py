"""Tables of runs as text, and as blocks of a page."""

from pathlib import Path
from typing import Any, NamedTuple

from policies.results.summary import FIGURES, Summaries
from robosim.base.output_folder import aligned
from robosim.reports.page import Page

SCORES = {"tcs_evaluated": "evaluated", "tcs_last10": "last ten", "tcs_of_best_return": "best motion"}
"""Figures of the table of scores, and their columns."""


class TextTable(NamedTuple):
    """A table of texts with a title."""

    title: str
    head: list[str]
    rows: list[list[str]]

    @property
    def text(self) -> str:
        """The table for a terminal."""
        return f"{self.title}:\n{aligned([self.head, *self.rows])}"


def list_tasks(summaries: Summaries, published: dict) -> list[str]:
    """Return the tasks that there are runs of: published ones in their order, then the others."""
    found = {task for row in summaries.values() for task in row}
    return [*(task for task in published["tasks"] if task in found), *sorted(found - set(published["tasks"]))]


def score_table(summaries: Summaries, published: dict) -> TextTable:
    """Return the scores of every task and method, ours in a column each, beside the published one."""
    def form(cell: dict | None) -> str:
        if cell is None:
            return "-"
        return f"{cell['mean']:.1f}" + (f" ± {cell['std']:.1f}" if cell["n"] > 1 else "")

    rows = []
    for task in list_tasks(summaries, published):
        for line in sorted(line for line in summaries if task in summaries[line]):
            cells = summaries[line][task]
            theirs = cells.get("tcs_last10", {}).get("published")
            rows.append([task, line, str(max(cell["n"] for cell in cells.values())),
                         *(form(cells.get(figure)) for figure in SCORES),
                         "-" if theirs is None else f"{theirs[0]:.1f} ± {theirs[1]:.1f}"])
    return TextTable(f"scores: the best policy without exploration, the last ten episodes, the motion with the highest "
                     f"return; last column {published['source']}, last ten episodes",
                     ["task", "method", "runs", *SCORES.values(), "published"], rows)


def fill_page(page: Page, summaries: Summaries, published: dict, sources: list[Path],
              notes: dict[str, list[str]]) -> None:
    """Put all tables, and lists of notes by title, into a page."""
    problems = sum(map(len, notes.values()))
    runs = sum(max(cell["n"] for cell in cells.values()) for row in summaries.values() for cells in row.values())
    page.set_verdict(f"{runs} finished runs" + (f"; {problems} notes below" if problems else ""), holds=not problems)
    page.add_text(f"Runs in {', '.join(map(str, sources))}. Mean ± standard deviation; IQM: interquartile mean with "
                  f"its 95 % interval. Published: {published['source']}, on a different geometry.")
    tasks = list_tasks(summaries, published)
    figures = [TextTable(title, ["method", *tasks], [
        [line, *(_format_cell(row.get(task, {}).get(figure)) for task in tasks)]
        for line, row in sorted(summaries.items())]) for figure, title in FIGURES.items()]
    tables = [score_table(summaries, published), *figures]
    shown = [table for table in tables if any(any(row[1:]) for row in table.rows)]
    shown += [TextTable(title, ["note"], [[text] for text in texts]) for title, texts in notes.items() if texts]
    for title, head, rows in shown:
        page.add_heading(title)
        page.add_table(head, rows)


def _format_cell(cell: dict[str, Any] | None) -> str:
    if cell is None:
        return ""
    text = f"{cell['mean']:.2f}, 1 run" if cell["n"] == 1 else \
        f"{cell['mean']:.2f} ± {cell['std']:.2f}, {cell['n']} runs, IQM {cell['iqm']:.2f} " \
        f"[{cell['low']:.2f}, {cell['high']:.2f}]"
    return text + ("; published {:.2f} ± {:.2f}".format(*cell["published"]) if cell["published"] else "")
