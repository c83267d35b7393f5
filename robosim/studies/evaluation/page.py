"""Pages of evaluations: verdict, film, recording in 3-D, curves and episodes."""

from pathlib import Path
from typing import Any

import numpy as np

from robosim.recordings.reader import FILE, Recording
from robosim.reports.page import Page


def make_page(values: dict[str, Any], folder: Path) -> Page:
    """Make the page of an evaluation; values: of `summarize`. folder: with film and recording of the first episode."""
    episodes = values["episodes"]
    page = Page(f"{values['task']}, policy {values['policy']}")
    succeeded = sum(bool(row["is_success"]) for row in episodes)
    page.set_verdict(f"{succeeded} of {len(episodes)} episodes succeeded, mean score {values['tcs']:.2f}, mean return "
                     f"{values['return']:.2f}", holds=succeeded == len(episodes))
    film = folder / "episode.mp4"
    if film.is_file():
        page.add_film(film.read_bytes(), "The first episode.")
    add_recording(page, folder)
    page.add_heading("Episodes")
    readings, arm = list(episodes[0]["readings"]), list(episodes[0].get("arm", ()))
    page.add_table(["seed", "score", "success", "return", *readings, *arm, "diverged"],
                   [[row["seed"], row["tcs"], "pass" if row["is_success"] else "fail", row["return"],
                     *(row["readings"][key] for key in readings), *(row["arm"][key] for key in arm),
                     row["diverged"] or ""] for row in episodes])
    terms = {key: sum(row["tcs_terms"][key] for row in episodes) / len(episodes) for key in episodes[0]["tcs_terms"]}
    page.add_heading("Terms of the score, mean")
    page.add_table(["term", "mean"], list(terms.items()))
    return page


def make_suite_page(title: str, summary: dict[str, dict[str, Any]], rows: list[dict[str, Any]],
                    scores: dict[str, dict[str, Any]]) -> Page:
    """Make the page of a suite: means with intervals by policy, the sorted scores, and every episode."""
    page, (own, figures) = Page(title), next(iter(summary.items()))
    success = figures["is_success"]["mean"]
    page.set_verdict(f"{short_name(own)}: {success:.0%} of {figures['episodes']} episodes succeeded, mean score "
                     f"{figures['tcs']['mean']:.2f}", holds=success == 1.0)
    page.add_curves(scores, "share of the episodes", "Scores of a policy's episodes, from the lowest to the highest.")
    page.add_text("iqm: mean of the middle half, of all episodes and runs. Intervals: bootstrap over the runs of a "
                  "policy that has several, else over its episodes. normalised: 0 is no motion from the same start, 1 "
                  "its cap. Best and last are the policies of a run; it chooses its best on other starts than these.")
    page.add_heading("Means and 95 % intervals")
    keys = [key for key, value in figures.items() if isinstance(value, dict)]
    pairs = [(key, kind, name) for key in keys for kind, name in (("mean", "interval"), ("iqm", "iqm_interval"))
             if kind in figures[key]]
    head = [f"{key}{'' if kind == 'mean' else ' iqm'}{end}" for key, kind, _ in pairs for end in ("", ", from", ", to")]
    page.add_table(["policy", "runs", "episodes", "diverged", *head],
                   [[short_name(policy), one["runs"], one["episodes"], one["diverged"],
                     *(number for key, kind, name in pairs for number in (one[key][kind], *one[key][name]))]
                    for policy, one in summary.items()])
    page.add_heading("Episodes")
    names = list(dict.fromkeys(name for row in rows for name in row))
    page.add_table(names, [[row.get(name) for name in names] for row in rows])
    return page


def short_name(policy: str) -> str:
    """Return what a table calls a policy: its name, or the end of its path, as files of one name lie side by side."""
    return "/".join(Path(policy).parts[-2:])


def make_materials_page(policy: str, rows: list[dict[str, Any]], lines: list[list[str]]) -> Page:
    """Make the page of one motion in many materials: `lines` by material, and a row a task and material."""
    page = Page(f"One motion in many materials, policy {short_name(policy)}")
    diverged = sum(bool(row["diverged"]) for row in rows)
    delivered = [row["delivered"] for row in rows]
    page.set_verdict(f"delivered from {min(delivered):.0%} to {max(delivered):.0%} over {len(rows)} tasks and materials"
                     + (f"; {diverged} diverged" if diverged else ""), holds=not diverged)
    page.add_table(lines[0], lines[1:])
    page.add_text("The motion was made for each task's own material. TD, td_mm: mean distance [mm] between the centre "
                  "of the observed grains in a material and in the task's own.")
    names = list(rows[0])
    page.add_table(names, [[row[name] if name != "diverged" else row[name] or "" for name in names] for row in rows])
    return page


def add_recording(page: Page, folder: Path) -> None:
    """Add the recording of a folder in 3-D and its curves, where it has one."""
    path = folder / FILE
    if not path.is_file():
        return
    from robosim.viewer.server import embed_html

    with Recording(path) as recording:
        page.add_heading("In 3-D")
        page.add_scene(embed_html(recording), f"Turn with the mouse, scrub below. With colours, regions and curves: "
                       f"robosim view {folder}")
        times, rows = recording.values()
        charts: dict[str, dict[str, Any]] = {}
        for k, curve in enumerate(recording.header.curves):
            if np.isfinite(rows[:, k]).any():
                title = f"{curve.chart} [{curve.unit}]" if curve.unit else curve.chart
                charts.setdefault(title, {})[curve.name] = times, rows[:, k]
    if charts:
        page.add_heading("Curves")
        page.add_curves(charts, "time [s]")
