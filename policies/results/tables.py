"""`robosim tables`: the figures of finished runs, from run folders and earlier tables, beside published numbers."""

from pathlib import Path
from typing import Any

import mpm
from policies.results.beside import MISSING, TextTable, list_tasks, paper_tables, score_table
from policies.results.curves import draw_curves, group_curves, read_curve
from policies.results.rows import ROW, find_stale, make_row, pack_rows, unpack_rows
from policies.results.summary import FIGURES, Summaries, summarise_runs
from robosim.base.digests import digest
from robosim.base.files import write_rows
from robosim.base.input_files import check_form, read_json
from robosim.base.output_folder import OutputFolder
from robosim.base.resources import CHECKOUT, folder
from robosim.config.table import read
from robosim.reports.page import Page


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


PUBLISHED = "arxiv_2406_09178.yaml"
STORED = CHECKOUT / "policies" / "trained" / "tables.json"
"""Rows of configs/published/tables.yaml."""


def collect_rows(sources: list[Path]) -> tuple[list[dict[str, Any]], list[str]]:
    """Return the rows of all finished runs, each once, and a text on each run that is not finished.
    sources: folders, searched for run folders, and tables.json files. Raises mpm.InvalidValue for a folder that does
    not exist, or a file that is no tables.json."""
    rows, unfinished = [], []
    for source in sources:
        if source.is_file():
            rows += read_table(source)
            continue
        if not source.is_dir():
            raise mpm.InvalidValue(f"{source}: no such folder; accepted: folders with runs of `robosim train`, or a "
                                   f"tables.json")
        for path in sorted(source.rglob("manifest.json")):
            try:
                manifest = read_json(path)
                status = read_json(path.with_name("status.json"))
                if status["state"] != "finished":
                    unfinished.append(f"{path.parent}: {status['state']} {status.get('reason', '')}".strip())
                    continue
                row = make_row(manifest, status, read_curve(path.with_name("episodes.csv")))
                check_form(row, ROW, "row")
                rows.append(row)
            except (OSError, ValueError, KeyError, TypeError, AttributeError, ArithmeticError) as error:
                unfinished.append(f"{path.parent}: cannot be read: {type(error).__name__}: {error}")
    return [row for k, row in enumerate(rows) if row not in rows[:k]], unfinished


def read_table(path: Path) -> list[dict[str, Any]]:
    """Return the rows of a tables.json, raises mpm.InvalidValue for another file."""
    try:
        rows = unpack_rows(read_json(path))
        missing = sorted({key for row in rows for key in ROW if key not in row})
        if missing:
            raise mpm.InvalidValue(f"its runs lack {', '.join(missing)}")
        check_form(rows, [ROW], "runs")
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise mpm.InvalidValue(f"{path}: not a tables.json of `robosim tables`: {error}") from error
    return [{key: row[key] for key in ROW} for row in rows]


def check(sources: list[Path]) -> int:
    """Print the rows of runs, or of tables.json files, that are older than the code; return 1 if there are any.
    Raises mpm.InvalidValue as `require_rows`."""
    rows, _ = require_rows(sources)
    stale = find_stale(rows)
    for reason, group in stale.items():
        print(f"{len(group)} of {len(rows)} rows: {reason}:")
        for row in group:
            print(f"  {row['method']} {row['task']} seed {row['seed']}, commit {row['commit']}")
    if not stale:
        print(f"{len(rows)} rows, all made by the code of today")
    return 1 if stale else 0


def require_rows(sources: list[Path]) -> tuple[list[dict[str, Any]], list[str]]:
    """Return what `collect_rows` does; raises mpm.InvalidValue where there is no finished run, too."""
    rows, unfinished = collect_rows(sources)
    if not rows:
        raise mpm.InvalidValue(f"{', '.join(map(str, sources))}: no finished run; "
                               f"{'; '.join(unfinished) or 'no runs at all'}")
    return rows, unfinished


def print_paper(sources: list[Path]) -> int:
    """Print the tables of the paper with our figures in them, and what they lack; return 0, or 1 for empty cells.
    Raises mpm.InvalidValue as `require_rows`."""
    rows, _ = require_rows(sources)
    published = read(folder("configs") / "published" / PUBLISHED)
    missing = set[str]()
    for table in paper_tables(rows, published):
        print(table.text, end="\n\n")
        missing |= {f"{row[0]} {task}" for row in table.rows for task, cell in zip(table.head[1:], row[1:])
                    if cell == MISSING}
    print("n: runs; *: made by code that has changed since (--check says what)")
    print(f"no run of {', '.join(sorted(missing))}; python docs/measure.py tables makes them" if missing
          else "every cell has its runs")
    return int(bool(missing))


def tables(sources: list[Path], out: Path, is_mixed: bool = False) -> int:
    """Write tables.json, tables.csv and curves.png of runs, and a page as index.html, into a folder; return 0.
    sources: folders with runs, or tables.json files. is_mixed: whether means over runs that differ are shown, with a
    note, and not refused. Raises mpm.InvalidValue as `require_rows`, and for a mean over runs that differ; ConfigError
    for an `out` that cannot be used."""
    rows, unfinished = require_rows(sources)
    published = read(folder("configs") / "published" / PUBLISHED)
    summaries, notes = summarise_runs(rows, published)
    if notes and not is_mixed:
        raise mpm.InvalidValue(f"means over runs that differ: {'; '.join(notes)}; accepted: runs of one kind in a "
                               f"line: leave some out, give them another --label in training, or add --mixed")
    stale = [f"{len(group)} of {len(rows)} runs: {reason}" for reason, group in find_stale(rows).items()]
    with OutputFolder(out) as results:
        results.write_json("tables.json", {"tables": summaries, **pack_rows(rows), "mixed": notes,
                                          "not_finished": unfinished, "published": published})
        write_rows(out / "tables.csv", [{**row, "code": digest(row["code"]) if row["code"] else ""} for row in rows])
        curves = group_curves(rows)
        page = Page("Results of runs")
        fill_page(page, summaries, published, sources,
                  {"Not finished": unfinished, "Means over different runs": notes, "Older than the code": stale})
        if curves:
            page.add_heading("Learning curves")
            picture = results.write("curves.png", lambda path: draw_curves(path, curves)).read_bytes()
            page.add_picture(picture, "Score over episodes: median of each method's runs, "
                             "and the band from their worst to their best.")
        results.write_text("index.html", page.html())
    print(score_table(summaries, published).text)
    for title, texts in (("mean over different runs", notes), ("not finished", unfinished),
                         ("older than the code", stale)):
        for text in texts:
            print(f"{title}: {text}")
    print(out / "index.html")
    return 0
