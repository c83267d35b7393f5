"""`robosim tables`: results of runs, method by method, with published numbers for comparison."""

import csv
from pathlib import Path
from typing import Any

import yaml

import mpm
from policies.learning.bundled import configs_folder
from policies.learning.files import write, write_json
from policies.results.further_tables import make_further_tables
from policies.results.page import format_scores, make_page
from policies.results.run_rows import collect_rows
from policies.results.summary import summarise_runs
from policies.results.text_table import align_columns

PUBLISHED = "arxiv_2406_09178.yaml"


def tables(sources: list[Path], out: Path) -> int:
    """Write index.html, tables.json and tables.csv of runs into a folder; return 0.

    sources: folders with runs, or tables.json files.

    Raises:
        mpm.InvalidValue: there is no finished run, or a source is wrong.
    """
    rows, unfinished = collect_rows(sources)
    if not rows:
        raise mpm.InvalidValue(f"{', '.join(map(str, sources))}: no finished run; "
                               f"{'; '.join(unfinished) or 'no runs at all'}")
    out.mkdir(parents=True, exist_ok=True)
    published = yaml.safe_load((configs_folder() / "published" / PUBLISHED).read_text())
    summaries, notes = summarise_runs(rows, published)
    numbers, further_tables = make_further_tables(summaries, rows, sources, published)
    write_json(out / "tables.json", {"tables": summaries, "runs": rows, "mixed": notes, "not_finished": unfinished,
                                     "published": published, **numbers})
    write(out / "tables.csv", lambda path: write_csv(path, rows))
    page = make_page(summaries, published, sources, further_tables,
                     {"Not finished": unfinished, "Means over different runs": notes})
    write(out / "index.html", lambda path: path.write_text(page))
    print(format_scores(summaries, published))
    for table in further_tables:
        print(f"\n{table.title}:\n{align_columns([table.head, *table.rows])}")
    for note in notes:
        print(f"mean over different runs: {note}")
    for text in unfinished:
        print(f"not finished: {text}")
    print(out / "index.html")
    return 0


def write_csv(path: Path, rows: list[dict[str, Any]]) -> None:
    """Write a line for each run."""
    with path.open("w", newline="") as file:
        table = csv.DictWriter(file, list(rows[0]))
        table.writeheader()
        table.writerows(rows)
