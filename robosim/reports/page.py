"""Self-contained HTML pages: plots as inline SVG, tables that sort by the column whose head is clicked."""

from collections.abc import Iterable, Sequence
from html import escape

from robosim.reports.provenance import provenance

STYLE = """
body{font:15px/1.45 system-ui,sans-serif;margin:2em auto;max-width:72em;padding:0 1em;color:#222}
table{border-collapse:collapse;margin:.8em 0}td,th{border:1px solid #ccc;padding:.25em .6em;text-align:left}
th{cursor:pointer;background:#f3f3f3}td.number{text-align:right;font-variant-numeric:tabular-nums}
.pass,.stable{background:#dff3df}.fail,.unstable{background:#f9d2d2}.refused{background:#fbeecb}
.not-run{color:#888}code{background:#f3f3f3;padding:.1em .3em}figure{margin:1em 0}
table.heat td{min-width:5em;text-align:center;padding:.6em .4em}
header{border-bottom:1px solid #ccc;margin-bottom:1em}small{color:#666}
"""
SCRIPT = """
for (const head of document.querySelectorAll("th")) head.onclick = () => {
  const table = head.closest("table"), k = [...head.parentNode.children].indexOf(head);
  const up = head.dataset.up = head.dataset.up === "1" ? "0" : "1";
  const key = row => row.children[k].dataset.value ?? row.children[k].textContent;
  const rows = [...table.tBodies[0].rows].sort((a, b) => {
    const x = key(a), y = key(b), n = Number(x) - Number(y);
    return (Number.isNaN(n) ? x.localeCompare(y) : n) * (up === "1" ? 1 : -1);
  });
  table.tBodies[0].append(...rows);
};
"""


STATUSES = ("pass", "fail", "not run", "stable", "refused", "unstable")
"""Words that a table shows in a colour of their own."""
HeatCell = tuple[str, str, str]
"""Text of a cell, its status, and its tooltip."""


class Page:
    """A page, built from top to bottom, with the command, commit and machine in its header."""

    def __init__(self, title: str) -> None:
        self.title, self._parts = title, []
        made_by = provenance()
        rows = "".join(f"<br><small>{escape(key)}: {escape(value)}</small>" for key, value in made_by.items()
                       if key != "command")
        self._parts.append(f"<header><h1>{escape(title)}</h1><code>{escape(made_by['command'])}</code>{rows}</header>")

    def add_heading(self, text: str) -> None:
        """Add a heading."""
        self._parts.append(f"<h2>{escape(text)}</h2>")

    def add_text(self, text: str) -> None:
        """Add a paragraph."""
        self._parts.append(f"<p>{escape(text)}</p>")

    def add_plot(self, svg: str, caption: str = "") -> None:
        """Add a plot with a caption."""
        self._parts.append(f"<figure>{svg}<figcaption><small>{escape(caption)}</small></figcaption></figure>")

    def add_table(self, head: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
        """Add a table; numbers have four digits and sort by value, statuses are coloured."""
        body = "".join(f"<tr>{''.join(_table_cell(value) for value in row)}</tr>" for row in rows)
        self._parts.append(f"<table><thead><tr>{''.join(f'<th>{escape(h)}</th>' for h in head)}</tr></thead>"
                           f"<tbody>{body}</tbody></table>")

    def add_heat_map(self, rows: dict[str, list[HeatCell]]) -> None:
        """Add rows of cells, coloured by status, with tooltips."""
        width = max(map(len, rows.values()), default=0)
        body = "".join(
            f"<tr><th>{escape(name)}</th>" + "".join(
                f'<td class="{escape(status)}" title="{escape(tooltip)}">{escape(text)}</td>'
                for text, status, tooltip in cells)
            + "<td></td>" * (width - len(cells)) + "</tr>" for name, cells in rows.items())
        self._parts.append(f"<table class=heat><tbody>{body}</tbody></table>")

    def html(self) -> str:
        """Return the page as HTML."""
        return (f"<!doctype html><html lang=en><meta charset=utf-8><title>{escape(self.title)}</title>"
                f"<style>{STYLE}</style>{''.join(self._parts)}<script>{SCRIPT}</script></html>")


def _table_cell(value: object) -> str:
    """Return a value as a cell of a table."""
    if value is None:
        return "<td></td>"
    if isinstance(value, float | int) and not isinstance(value, bool):
        return f'<td class=number data-value="{value!r}">{value:.4g}</td>'
    text = str(value)
    css_class = text.replace(" ", "-") if text in STATUSES else ""
    return f'<td class="{css_class}">{escape(text)}</td>'
