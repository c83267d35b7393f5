"""Tables of our figures beside published ones, for a terminal and for pages."""

from collections import defaultdict
from typing import Any, NamedTuple

from policies.results.rows import find_stale
from policies.results.summary import Summaries, published_value, summarise
from robosim.base.output_folder import aligned

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
        return "-" if cell is None else _with_deviation(cell["mean"], cell["std"] if cell["n"] > 1 else None)

    rows = []
    for task in list_tasks(summaries, published):
        for line in sorted(line for line in summaries if task in summaries[line]):
            cells = summaries[line][task]
            theirs = cells.get("tcs_last10", {}).get("published")
            rows.append([task, line, str(max(cell["n"] for cell in cells.values())),
                         *(form(cells.get(figure)) for figure in SCORES),
                         "-" if theirs is None else _with_deviation(*theirs)])
    return TextTable(f"scores: the best policy without exploration, the last ten episodes, the motion with the highest "
                     f"return; last column {published['source']}, last ten episodes",
                     ["task", "method", "runs", *SCORES.values(), "published"], rows)


MISSING, UNPUBLISHED = "no run", "."
GROUPS = {"baselines": ["ppo", "sac", "td3", "ddpg", "bc", "gail", "gnn_cmaes", "demo", "dg_sac_literal", "dg_sac"],
          "ablations": ["positions", "velocities", "none", "all", "dgn_sac"]}
"""Tables of the paper, and their lines; dg_sac_literal has the paper's very parameters, and like dg_sac its figures."""
PAPER_FIGURES = {"tcs_last10": "task completion score", "return": "training reward"}
"""Both of the last ten episodes of training."""


def paper_tables(rows: list[dict[str, Any]], published: dict) -> list[TextTable]:
    """Return the tables of the paper: two lines a method, ours above the published one."""
    groups: dict[tuple[str, str], list[dict[str, Any]]] = defaultdict(list)
    for row in rows:
        groups[row["method"], row["task"]].append(row)
    old = {id(row) for stale in find_stale(rows).values() for row in stale}

    def ours(method: str, task: str, figure: str) -> str:
        if published_value(published, "return", method, task) is None:
            return UNPUBLISHED
        runs = groups[method, task]
        values = [row[figure] for row in runs if row[figure] is not None]
        if not values:
            return MISSING
        one = summarise(values)
        return _with_deviation(one["mean"], one["std"] if len(values) > 1 else None) + f" (n {len(values)})" + \
            "*" * any(id(row) in old for row in runs)

    def theirs(method: str, task: str, figure: str) -> str:
        value = published_value(published, figure, method, task)
        return UNPUBLISHED if value is None else _with_deviation(*value)

    return [TextTable(f"{name}, {title}: mean of the last ten episodes, ours above {published['source']}",
                      ["method", *published["tasks"]],
                      [[label, *(cell(method, task, figure) for task in published["tasks"])] for method in methods
                       for label, cell in ((method, ours), (f"{method}, published", theirs))])
            for name, methods in GROUPS.items() for figure, title in PAPER_FIGURES.items()]


def _with_deviation(mean: float, deviation: float | None) -> str:
    return f"{mean:.1f}" + ("" if deviation is None else f" ± {deviation:.1f}")
