"""Scores of the learning methods, from the committed runs in policies/trained."""

import io
import json
from pathlib import Path
from statistics import median

import matplotlib as mpl
import yaml

from generators.markdown import table
from generators.results.measured import ROOT
from policies.results.beside import paper_tables, score_table
from policies.results.curves import draw_curves, group_curves
from policies.results.rows import find_stale
from policies.results.summary import summarise_runs
from policies.results.tables import collect_rows
from policies.runs.sweep_file import SweepFile, load_sweep, plan_runs
from robosim.studies.policies import NETWORKS as FOLDERS

TRAINED = ROOT / "policies" / "trained"
NETWORKS = ROOT / "docs" / "results" / "data" / "networks"
"""What `robosim evaluate` wrote on each network; the rows of the episodes are beside, as .csv."""
KINDS = {"dagger": FOLDERS["network"], "student": FOLDERS["student"]}
"""Line of the sweep that makes the bundled policies -> folder of policies/trained."""
COMPARED = ("knowing", "recorded", "scripted")
CHANGED = "dg_sac_literal"
"""The paper's own method, which entries of the queue change."""
CHANGED_ON = ["SpoonTranslate", "SpoonPour", "ShovelMove"]


def read_runs() -> list[dict]:
    """The rows of the queue's finished runs."""
    return collect_rows([TRAINED / "tables.json"])[0]


def published_results() -> dict:
    """The results of arXiv 2406.09178."""
    return yaml.safe_load((ROOT / "configs" / "published" / "arxiv_2406_09178.yaml").read_text())


def age(rows: list[dict]) -> str:
    """A sentence for each part of the rows that today's code did not make."""
    return " ".join(f"**Older than the code:** {len(group)} of {len(rows)} runs; {reason}."
                    for reason, group in find_stale(rows).items())


def scores_page() -> str:
    """Scores of today's runs, each figure of ours in a column, and published scores."""
    rows = [row for row in read_runs() if row["method"] not in change_names()]
    scores = score_table(summarise_runs(rows, published_results())[0], published_results())
    commits = ", ".join(f"`{commit}`" for commit in sorted({row["commit"] for row in rows}))
    return f"""{len(rows)} training runs at {commits}. {age(rows)}

{table(scores.head, [[row[0], f"`{row[1]}`", *row[2:]] for row in scores.rows])}"""


def paper_page() -> str:
    """The tables of the paper, ours above theirs."""
    parts = [f"{one.title[0].upper()}{one.title[1:]}.\n\n"
             f"{table(one.head, [[f'`{row[0]}`', *row[1:]] for row in one.rows])}"
             for one in paper_tables(read_runs(), published_results())]
    return "\n\n".join([f"In brackets the number of our runs; `*`: {age_of_rows()}", *parts])


def age_of_rows() -> str:
    """How many of the stored rows are old."""
    rows = read_runs()
    return f"made by code that has changed since ({sum(map(len, find_stale(rows).values()))} of {len(rows)} runs)."


def queue() -> SweepFile:
    """The queue that makes the rows."""
    return load_sweep(ROOT / "configs" / "published" / "tables.yaml")


def change_names() -> list[str]:
    """Entries of the queue that change the paper's own method on some of the sub-tasks, and what they change."""
    return [entry.name for entry in queue().methods if entry.method == CHANGED and (
        entry.tasks == CHANGED_ON or entry.name in (CHANGED, "grains_as_one"))]


def changes_page() -> str:
    """Scores of the paper's own method with one change at a time: median, worst and best seed."""
    methods, tasks = change_names(), CHANGED_ON
    rows = [row for row in read_runs() if row["method"] in methods and row["task"] in tasks]
    whole = len(plan_runs(queue().model_copy(update={"tasks": tasks, "methods": [
        entry for entry in queue().methods if entry.name in methods]})))

    def cell(method: str, task: str, key: str) -> str:
        values = sorted(row[key] for row in rows if (row["method"], row["task"]) == (method, task))
        return (f"{median(values):.1f} ({values[0]:.1f} to {values[-1]:.1f})" if len(values) > 1 else
                f"{values[0]:.1f}" if values else "")

    head = ["change", *(f"{task}, {name}" for task in tasks for name in ("evaluated", "last ten"))]
    lines = [[f"`{method}`", *(cell(method, task, key) for task in tasks
                               for key in ("tcs_evaluated", "tcs_last10"))] for method in methods]
    return f"{len(rows)} runs, of which the queue has {whole}. {age(rows)}\n\n{table(head, lines)}"


def changes_figure() -> str:
    """Their learning curves."""
    text = io.StringIO()
    with mpl.rc_context({"svg.hashsalt": "robosim", "font.size": 9}):
        draw_curves(text, group_curves([row for row in read_runs() if row["method"] in change_names()
                                        and row["task"] in CHANGED_ON]), "svg")
    return text.getvalue()


def networks_page() -> str:
    """Normalised scores of the bundled policies on each suite, beside those of the others from the same starts."""
    rows, _ = collect_rows([TRAINED / "networks.json"])
    evaluations = [json.loads(path.read_text()) for path in sorted(NETWORKS.glob("*.json"))]
    parts = []
    for suite, robot in dict.fromkeys((one["suite"], one["environment"]["robot"]) for one in evaluations):
        own = [one for one in evaluations if (one["suite"], one["environment"]["robot"]) == (suite, robot)]
        lines, compared = [], COMPARED if robot is None else ()
        for one in own:
            named = {part: figures for name, figures in one["policies"].items() for part in Path(name).parts[-2:]}
            lines.append([one["task"], *(cell for name in (*FOLDERS.values(), *compared)
                                         for cell in score_and_success(named.get(name)))])
        commits = ", ".join(sorted({f"`{one['made_by']['commit']}`" for one in own}))
        episodes = {figures["episodes"] for one in own for figures in one["policies"].values()}
        head = ["task", *(f"{name}, {figure}" for name in (*FOLDERS, *compared)
                          for figure in ("score", "success"))]
        carried = "" if robot is None else f", the tool in the hand of {robot}"
        counts = " to ".join(map(str, sorted(episodes)))
        parts.append(f"Suite `{suite}`{carried}, {counts} episodes each, at {commits}.\n\n{table(head, lines)}")
    return "\n\n".join([age(rows), *parts])


def score_and_success(figures: dict | None) -> tuple[str, str]:
    """A policy's interquartile mean of normalised scores with its interval, and how many of its episodes succeeded."""
    if figures is None or "normalised" not in figures:
        return "", ""
    low, high = figures["normalised"]["iqm_interval"]
    return f"{figures['normalised']['iqm']:.2f} ({low:.2f} to {high:.2f})", f"{figures['is_success']['mean']:.0%}"


def materials_page() -> str:
    """Score and trajectory deviation of the bundled motions in thirteen materials."""
    data = json.loads((TRAINED / "materials.json").read_text())
    tasks = list(dict.fromkeys(row["task"] for row in data["rows"]))
    names = list(dict.fromkeys(row["material"] for row in data["rows"]))
    by = {(row["material"], row["task"]): row for row in data["rows"]}

    def cell(row: dict | None) -> str:
        return "" if row is None or row["score"] is None else f"{row['score']:.1f} ({row['td_mm']:.1f})"

    return table(["score (deviation [mm])", *tasks],
                 [[name, *(cell(by.get((name, task))) for task in tasks)] for name in names])
