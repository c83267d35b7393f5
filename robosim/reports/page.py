"""A page that needs nothing but itself: pictures as SVG inside it, tables that sort where their head is clicked."""

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


class Page:
    """Parts of a page, top to bottom."""

    def __init__(self, title: str) -> None:
        self.title, self._parts = title, []
        told = provenance()
        rows = "".join(f"<br><small>{escape(key)}: {escape(value)}</small>" for key, value in told.items()
                       if key != "command")
        self._parts.append(f"<header><h1>{escape(title)}</h1><code>{escape(told['command'])}</code>{rows}</header>")

    def heading(self, text: str) -> None:
        """A heading."""
        self._parts.append(f"<h2>{escape(text)}</h2>")

    def text(self, text: str) -> None:
        """A paragraph."""
        self._parts.append(f"<p>{escape(text)}</p>")

    def picture(self, svg: str, under: str = "") -> None:
        """A plot."""
        self._parts.append(f"<figure>{svg}<figcaption><small>{escape(under)}</small></figcaption></figure>")

    def table(self, head: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
        """A table; numbers are shown with four digits and sorted by their value, verdicts are coloured."""
        body = "".join(f"<tr>{''.join(cell(value) for value in row)}</tr>" for row in rows)
        self._parts.append(f"<table><thead><tr>{''.join(f'<th>{escape(h)}</th>' for h in head)}</tr></thead>"
                           f"<tbody>{body}</tbody></table>")

    def heat(self, rows: dict[str, list[tuple[str, str, str]]]) -> None:
        """Rows of coloured cells: (words in it, verdict, words when the pointer rests on it)."""
        width = max(map(len, rows.values()), default=0)
        body = "".join(
            f"<tr><th>{escape(name)}</th>" + "".join(
                f'<td class="{escape(kind)}" title="{escape(more)}">{escape(text)}</td>' for text, kind, more in cells)
            + "<td></td>" * (width - len(cells)) + "</tr>" for name, cells in rows.items())
        self._parts.append(f"<table class=heat><tbody>{body}</tbody></table>")

    def html(self) -> str:
        """The whole."""
        return (f"<!doctype html><html lang=en><meta charset=utf-8><title>{escape(self.title)}</title>"
                f"<style>{STYLE}</style>{''.join(self._parts)}<script>{SCRIPT}</script></html>")


def cell(value: object) -> str:
    """A cell of a table."""
    if value is None:
        return "<td></td>"
    if isinstance(value, float | int) and not isinstance(value, bool):
        return f'<td class=number data-value="{value!r}">{value:.4g}</td>'
    words = str(value)
    kind = words.replace(" ", "-") if words in ("pass", "fail", "not run", "stable", "refused", "unstable") else ""
    return f'<td class="{kind}">{escape(words)}</td>'
