"""`robosim tables`: what runs came to, method by method, beside published numbers."""

import csv
import html
import json
from collections import Counter, defaultdict
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import yaml

import mpm
from policies.learning.bundled import configs_folder
from policies.learning.files import digest, write, write_json
from policies.learning.presets import known
from policies.results.further_tables import Table, further

READINGS = {"best": "score of the best motion, replayed", "tcs": "score, mean of the last ten episodes",
            "return": "return, mean of the last ten episodes", "delivered": "delivered by the best motion",
            "spilled": "spilled by the best motion", "collisions": "collisions of the best motion",
            "turn_error_deg": "error of the best motion's turn [deg]",
            "seconds": "seconds an episode"}
SETTINGS = {"material": "{}", "starts": "{} starts", "hold": "actions held for {} steps", "obs": "observes {}",
            "wanted": "{} episodes wanted"}
"""What runs of a method may differ by besides their seed, and how a table says it."""
RESAMPLED = 2000


def runs_below(folders: list[Path]) -> tuple[list[dict[str, Any]], list[str]]:
    """Finished runs, one dictionary each, and words on those that are not; the same run twice is one."""
    rows, others = [], []
    for top in folders:
        if top.is_file():
            rows += earlier(top)
            continue
        if not top.is_dir():
            raise mpm.InvalidValue(f"{top}: no such folder; accepted: folders with runs of `robosim train`, or a "
                                   f"tables.json")
        for path in sorted(top.rglob("manifest.json")):
            try:
                manifest = json.loads(path.read_text())
                status = json.loads(path.with_name("status.json").read_text())
                if status["state"] != "finished":
                    others.append(f"{path.parent}: {status['state']} {status.get('reason', '')}".strip())
                    continue
                rows.append(row(manifest, status))
            except (OSError, ValueError, KeyError) as error:
                others.append(f"{path.parent}: cannot be read: {type(error).__name__}: {error}")
    return [one for k, one in enumerate(rows) if not any(same(one, other) for other in rows[:k])], others


def same(one: dict[str, Any], other: dict[str, Any]) -> bool:
    """Whether two rows are of one run; what an earlier file does not tell says nothing against it."""
    return all(one[key] == other[key] or (key in NEWER and None in (one[key], other[key])) for key in COLUMNS)


COLUMNS = ("task", "method", "material", "seed", "starts", "hold", "obs", "wanted", "commit", "episodes", "best", "tcs",
           "return", "seconds", "delivered", "spilled", "collisions", "turn_error_deg", "preset", "demonstrations")
"""Of a run in tables.json."""
NEWER = ("turn_error_deg", "preset", "demonstrations")
"""Of these, what earlier files do not have."""


def earlier(path: Path) -> list[dict[str, Any]]:
    """Runs of a tables.json that `robosim tables` has written."""
    try:
        rows = list(json.loads(path.read_text())["runs"])
        missing = sorted({key for one in rows for key in COLUMNS if key not in one and key not in NEWER})
    except (ValueError, KeyError, TypeError) as error:
        raise mpm.InvalidValue(f"{path}: not a tables.json of `robosim tables`: {error}") from error
    if missing:
        raise mpm.InvalidValue(f"{path}: not a tables.json of `robosim tables`: its runs lack {', '.join(missing)}")
    return [{key: one.get(key) for key in COLUMNS} for one in rows]


def row(manifest: dict[str, Any], status: dict[str, Any]) -> dict[str, Any]:
    """A run's numbers."""
    replayed, last = status["replayed"], status["last"]
    preset = {**known(manifest["preset"]), "obs": None, "episodes": None}  # which the row tells by themselves
    label = manifest["method"]
    if label == "dg_sac" and manifest["preset"]["obs"] != "flat":
        label = manifest["preset"]["obs"]  # the ablations are named after what is seen
    return {"task": manifest["task"], "method": label, "material": manifest["material"], "seed": manifest["seed"],
            "starts": manifest["starts"], "hold": manifest["hold"], "obs": manifest["preset"]["obs"],
            "wanted": manifest["preset"]["episodes"], "commit": manifest["commit"], "episodes": status["episodes"],
            "best": replayed.get("tcs"), "tcs": last.get("tcs"), "return": last["return"],
            "seconds": status["seconds"] / status["episodes"],
            **{key: replayed.get(key) for key in ("delivered", "spilled", "collisions", "turn_error_deg")},
            "preset": digest(preset), "demonstrations": digest(manifest.get("demonstrations", {}))}


def told_apart(rows: list[dict[str, Any]]) -> list[str]:
    """The line of the tables that each run belongs to: its method, and its own value of whatever the method's runs
    differ by, since a mean over runs of different settings is the mean of nothing."""
    seen: dict[tuple[str, str], set] = defaultdict(set)
    for one in rows:
        for key in SETTINGS:
            seen[one["method"], key].add(one[key])
    return [", ".join([one["method"], *(words.format(one[key]) for key, words in SETTINGS.items()
                                        if len(seen[one["method"], key]) > 1)]) for one in rows]


def mixed(label: str, task: str, members: list[dict[str, Any]]) -> list[str]:
    """Words on what a mean hides: runs of one line that share a seed, or differ by what no line tells."""
    seeds = [str(seed) for seed, count in Counter(one["seed"] for one in members).items() if count > 1]
    words = [f"{label}, {task}: seed {', '.join(seeds)} more than once"] if seeds else []
    for key, what in (("preset", "settings of the method"), ("demonstrations", "demonstrations")):
        kinds = len({one[key] for one in members} - {None})
        words += [f"{label}, {task}: {kinds} different {what}"] if kinds > 1 else []
    return words


def summary(values: list[float], rng: np.random.Generator) -> dict[str, float]:
    """Mean, standard deviation (of the sample; 0 of one), and the interquartile mean with the 95 % interval of its
    resamples (Agarwal et al. 2021), which with two or three values is but the smallest and the largest."""
    data = np.array(values)
    again = [middle(rng.choice(data, len(data))) for _ in range(RESAMPLED)] if len(data) > 1 else [middle(data)]
    low, high = np.percentile(again, (2.5, 97.5))
    return {"n": len(data), "mean": float(data.mean()), "std": float(data.std(ddof=min(1, len(data) - 1))),
            "iqm": middle(data), "low": float(low), "high": float(high)}


def middle(data: np.ndarray) -> float:
    """Mean of the half in the middle."""
    ordered = np.sort(data)
    cut = len(ordered) // 4
    return float(ordered[cut : len(ordered) - cut].mean())


def tables(runs: list[Path], out: Path) -> int:
    """Write the tables of runs into a folder; returns 0."""
    rows, others = runs_below(runs)
    if not rows:
        raise mpm.InvalidValue(f"{', '.join(map(str, runs))}: no finished run below; "
                               f"{'; '.join(others) or 'none at all'}")
    out.mkdir(parents=True, exist_ok=True)
    published = yaml.safe_load((configs_folder() / "published" / "arxiv_2406_09178.yaml").read_text())
    rng, found, notes = np.random.default_rng(0), defaultdict(dict), []
    groups: dict[tuple[str, str], list[dict]] = defaultdict(list)
    for label, one in zip(told_apart(rows), rows):
        groups[label, one["task"]].append(one)
    for (label, task), members in groups.items():
        notes += mixed(label, task, members)
        found[label][task] = {
            key: {**summary(values, rng), "published": theirs(published, key, members[0]["method"], task)}
            for key in READINGS if (values := [m[key] for m in members if m[key] is not None])}
    numbers, beside = further(found, rows, runs, published)
    told = {"Not finished": others, "Means over what differs": notes}
    write_json(out / "tables.json", {"tables": found, "runs": rows, "mixed": notes, "not_finished": others,
                                     "published": published, **numbers})
    write(out / "tables.csv", lambda path: as_csv(path, rows))
    write(out / "index.html", lambda path: path.write_text(page(found, published, told, runs, beside)))
    print(as_text(found, published))
    for table in beside:
        print(f"\n{table.title}:\n{aligned([table.head, *table.rows])}")
    for words in notes:
        print(f"mean over what differs: {words}")
    for words in others:
        print(f"not finished: {words}")
    print(f"{out / 'index.html'}")
    return 0


def as_csv(path: Path, rows: list[dict[str, Any]]) -> None:
    """A line a run."""
    with path.open("w", newline="") as file:
        table = csv.DictWriter(file, list(rows[0]))
        table.writeheader()
        table.writerows(rows)


def theirs(published: dict, key: str, method: str, task: str) -> list[float] | None:
    """Published mean and deviation; the best motion's score stands beside the published score."""
    values = published[{"best": "tcs"}.get(key, key)].get(method) if key in ("best", "tcs", "return") else None
    return values[published["tasks"].index(task)] if values and task in published["tasks"] else None


def cells(found: dict, published: dict, key: str, form: Callable[[dict], str]) -> list[list[str]]:
    """A table as words: methods by tasks."""
    known = [task for task in published["tasks"] if any(task in one for one in found.values())]
    names = known + sorted({task for one in found.values() for task in one} - set(known))
    table = [["method", *names]]
    for method in sorted(found):
        table.append([method, *(form(found[method][task][key]) if key in found[method].get(task, {}) else ""
                                for task in names)])
    return table


def as_text(found: dict, published: dict) -> str:
    """The scores, for a terminal."""
    def form(own: dict) -> str:
        spread = f"±{own['std']:.1f}" if own["n"] > 1 else ""
        return f"{own['mean']:.1f}{spread} n={own['n']}" + (f" ({own['published'][0]:.1f})" if own["published"] else "")

    return f"{READINGS['best']}, in brackets {published['source']}:\n" + aligned(cells(found, published, "best", form))


def aligned(table: list[list[str]]) -> str:
    """Lines of words in columns."""
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    return "\n".join("  ".join(map(str.ljust, line, widths)).rstrip() for line in table)


def page(found: dict, published: dict, notes: dict[str, list[str]], runs: list[Path], beside: list[Table]) -> str:
    """All tables as one page that needs nothing else."""
    def form(own: dict) -> str:
        words = f"{own['mean']:.2f}<br><small>1 run</small>" if own["n"] == 1 else \
            f"{own['mean']:.2f} ± {own['std']:.2f}<br><small>{own['n']} runs, IQM {own['iqm']:.2f} " \
            f"[{own['low']:.2f}, {own['high']:.2f}]</small>"
        return words + ("<br><i>{:.2f} ± {:.2f}</i>".format(*own["published"]) if own["published"] else "")

    parts = [f"<h1>What runs came to</h1><p>robosim {html.escape(version('robosim'))}; runs below "
             f"{html.escape(', '.join(map(str, runs)))}. Mean ± standard deviation; interquartile mean with its 95 % "
             f"interval; in italics {html.escape(published['source'])}, on a geometry of its own.</p>"]
    scores = [(title, cells(found, published, key, form)) for key, title in READINGS.items()]
    more = [(table.title, [table.head, *([row[0], *map(html.escape, row[1:])] for row in table.rows)])
            for table in beside]
    for title, (head, *body) in scores + more:
        parts.append(f"<h2>{title}</h2><table><tr>{''.join(f'<th>{html.escape(w)}</th>' for w in head)}</tr>")
        parts += [f"<tr><th>{html.escape(line[0])}</th>{''.join(f'<td>{w}</td>' for w in line[1:])}</tr>"
                  for line in body]
        parts.append("</table>")
    for title, lines in notes.items():
        if lines:
            parts.append(f"<h2>{title}</h2><ul>" + "".join(f"<li>{html.escape(w)}</li>" for w in lines) + "</ul>")
    style = "body{font:15px sans-serif;margin:2em}table{border-collapse:collapse}td,th{border:1px solid #bbb;" \
            "padding:.3em .6em;text-align:right}small{color:#666}"
    return f"<!doctype html><meta charset=utf-8><title>runs</title><style>{style}</style>{''.join(parts)}"
