"""`robosim tables`: the figures of finished runs, from run folders and earlier tables, beside published numbers."""

import csv
from pathlib import Path
from typing import Any

import mpm
from mpm.files import write, write_json, write_text
from mpm.input_files import check_form, read_json
from policies.learning.bundled import configs_folder
from policies.learning.files import digest
from policies.learning.preset_files import migrate_manifest, migrate_row, read_yaml
from policies.results.further_tables import make_further_tables
from policies.results.page import align_columns, format_scores, make_page
from policies.results.summary import summarise_runs

COLUMNS = ("task", "method", "material", "seed", "starts", "action_repeat", "obs", "max_episodes", "commit", "episodes",
           "tcs_of_best_return", "tcs_last10", "return", "seconds", "delivered", "spilled", "collisions",
           "turn_error_deg", "preset", "demonstrations")
"""Of a row. tcs_of_best_return: score of the motion with the highest return, replayed, as are delivered to
turn_error_deg; tcs_last10, return: means of the last ten episodes; seconds: of an episode; preset, demonstrations:
digests, that of the preset over all its keys but obs and episodes."""
ADDED = {"grains_as_one": False}
"""Keys of presets that earlier versions lacked -> values with which a preset has the digest that it had then."""
OPTIONAL = ("turn_error_deg", "preset", "demonstrations")
"""Columns that the files of earlier versions lack."""
ROW: dict[str, Any] = {
    **dict.fromkeys(("task", "method", "starts", "obs", "commit"), str),
    **dict.fromkeys(("seed", "action_repeat", "max_episodes", "episodes"), int), "return": float, "seconds": float,
    **dict.fromkeys(("preset", "demonstrations"), (str, None, ...)), "material": (str, None),
    **dict.fromkeys(("tcs_of_best_return", "tcs_last10", "delivered", "spilled", "collisions"), (float, None)),
    "turn_error_deg": (float, None, ...)}
"""Form of a row."""
PUBLISHED = "arxiv_2406_09178.yaml"


def collect_rows(sources: list[Path]) -> tuple[list[dict[str, Any]], list[str]]:
    """Return the rows of all finished runs, each once, and a text on each run that is not finished.

    sources: folders, searched for run folders, and tables.json files.

    Raises:
        mpm.InvalidValue: a folder does not exist, or a file is no tables.json.
    """
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
                manifest = migrate_manifest(read_json(path))
                status = read_json(path.with_name("status.json"))
                if status["state"] != "finished":
                    unfinished.append(f"{path.parent}: {status['state']} {status.get('reason', '')}".strip())
                    continue
                row = make_row(manifest, status)
                check_form(row, ROW, "row")
                rows.append(row)
            except (OSError, ValueError, KeyError, TypeError, AttributeError, ArithmeticError) as error:
                unfinished.append(f"{path.parent}: cannot be read: {type(error).__name__}: {error}")
    return [row for k, row in enumerate(rows) if not any(is_same_run(row, other) for other in rows[:k])], unfinished


def is_same_run(row: dict[str, Any], other: dict[str, Any]) -> bool:
    """Return whether two rows are of one run; an optional column that one of them lacks is not compared."""
    return all(row[key] == other[key] or (key in OPTIONAL and None in (row[key], other[key])) for key in COLUMNS)


def read_table(path: Path) -> list[dict[str, Any]]:
    """Return the rows of a tables.json, with today's column names; raises mpm.InvalidValue for another file."""
    try:
        rows = [migrate_row(row) for row in read_json(path)["runs"]]
        missing = sorted({key for row in rows for key in COLUMNS if key not in row and key not in OPTIONAL})
        if missing:
            raise mpm.InvalidValue(f"its runs lack {', '.join(missing)}")
        check_form(rows, [ROW], "runs")
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise mpm.InvalidValue(f"{path}: not a tables.json of `robosim tables`: {error}") from error
    return [{key: row.get(key) for key in COLUMNS} for row in rows]


def preset_digest(preset: dict[str, Any]) -> str:
    """Return a digest of a preset's settings, without its description and what are columns of their own."""
    return digest({name: value for name, value in preset.items()
                   if name != "description" and (name not in ADDED or value != ADDED[name])}
                  | {"obs": None, "episodes": None})


def make_row(manifest: dict[str, Any], status: dict[str, Any]) -> dict[str, Any]:
    """Return the row of a run from its manifest and status."""
    replayed, last, preset = status["replayed"], status["last"], manifest["preset"]
    method = manifest.get("label") or manifest["method"]
    if method == "dg_sac" and preset["obs"] != "flat":
        method = preset["obs"]  # the paper names its ablations after the observation
    return {"task": manifest["task"], "method": method, "material": manifest["material"], "seed": manifest["seed"],
            "starts": manifest["starts"], "action_repeat": manifest["action_repeat"], "obs": preset["obs"],
            "max_episodes": preset["episodes"], "commit": manifest["commit"], "episodes": status["episodes"],
            "tcs_of_best_return": replayed.get("tcs"), "tcs_last10": last.get("tcs"), "return": last["return"],
            "seconds": status["seconds"] / status["episodes"],
            **{key: replayed.get(key) for key in ("delivered", "spilled", "collisions", "turn_error_deg")},
            "preset": preset_digest(preset),
            "demonstrations": digest(manifest.get("demonstrations", {}))}


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
    published = read_yaml(configs_folder() / "published" / PUBLISHED)
    summaries, notes = summarise_runs(rows, published)
    numbers, further_tables = make_further_tables(summaries, rows, sources, published)
    write_json(out / "tables.json", {"tables": summaries, "runs": rows, "mixed": notes, "not_finished": unfinished,
                                     "published": published, **numbers})
    write(out / "tables.csv", lambda path: write_csv(path, rows))
    page = make_page(summaries, published, sources, further_tables,
                     {"Not finished": unfinished, "Means over different runs": notes})
    write_text(out / "index.html", page)
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
