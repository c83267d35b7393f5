"""A policy on a suite, beside the recorded motion, the script and no motion from the same starts."""

import tempfile
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from robosim.base.errors import ConfigError
from robosim.base.files import write_rows
from robosim.base.output_folder import OutputFolder, aligned
from robosim.base.progress import Progress
from robosim.base.provenance import provenance
from robosim.base.resources import trained
from robosim.dosing import CONTROLLERS
from robosim.envs import is_task_file, task_name
from robosim.episode.play import play, read_scores
from robosim.studies.evaluation import POLICIES
from robosim.studies.evaluation.page import make_suite_page
from robosim.studies.evaluation.policies import bundled_motion, check_task, load_policy, make_policy, training_options
from robosim.studies.evaluation.suites import begin_episode, make_environment, plan_starts
from robosim.tasks.task import TaskConfig, load_task

COMPARED = ("learned", "scripted", "zero")
"""Policies whose episodes stand beside those of the policy that is scored; in dosing tasks the controllers do."""
FIGURES = ("tcs", "return", "is_success", "delivered", "dose_error", "dose_error_percent", "seconds", "spilled")
"""Figures of an episode that a summary has, where the task has them."""
RESULTS = ("evaluation.json", "evaluation.csv", "evaluation.png", "index.html")
"""Files that a run writes."""
RESAMPLES, COVERED = 2000, 0.95
"""Resamples of a bootstrap interval of a mean, and the share of them that it covers."""
FOUND = ("best_policy.npz", "best.npz")
"""Files of a training run that are scored, the first of them that is there."""

Row = dict[str, Any]


def evaluate_suite(task: str, name: str, suite: str, out: Path | None, *, episodes: int | None = None,
                   material: str | None = None, changed: Collection[str] = (), alone: bool = False) -> int:
    """Score a policy on a suite; print means with intervals, and write a row an episode, a summary and a picture.

    name: of the policy, its file, or the folder of a training run. changed: top-level keys of the task that differ on
    purpose from what the policy was learned on. alone: run no other policy. Returns 0.
    Raises ConfigError, UnknownName for what cannot be used, before any episode runs."""
    if material is not None and suite != "nominal":
        raise ConfigError(f"--material {material} with --suite {suite}; accepted: with --suite nominal, others have "
                          f"materials of their own")
    config, found = load_task(task), find_policy(name)
    check_task(found, config, changed)
    starts = plan_starts(suite, config, episodes or 50, material)
    others = {other: other for other in compared(config) if other != found and not alone
              and (other != "learned" or trained(task_name(task)) is not None)}
    files = {label: policy_file(policy, task) for label, policy in {name: found, **others}.items()}
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as scratch, OutputFolder(out or Path(scratch)) as folder:
        folder.clear(RESULTS)
        progress = Progress(total=len(files) * len(starts), desc=f"{task_name(task)}, {suite}", unit="episodes")
        for world in dict.fromkeys(start.world for start in starts):
            members = [(k, start) for k, start in enumerate(starts) if start.world == world]
            for label, policy in files.items():
                env = make_environment(config, members[0][1], **training_options(policy))
                for k, start in members:
                    drawn = begin_episode(env, start)
                    total, info = play(env, make_policy(policy, env, start.seed), observation=env.observation)
                    rows.append({"policy": label, "episode": k, **drawn, "return": total, **read_scores(info),
                                 "diverged": info.get("diverged") or ""})
                    progress.update()
                    rows.sort(key=lambda row: (list(files).index(row["policy"]), row["episode"]))
                    write_rows(folder.path / "evaluation.csv", rows)
                env.close()
                folder.write_json("evaluation.json", {
                    "task": task, "policy": name, "suite": suite, "made_by": provenance(),
                    "is_complete": len(rows) == progress.total, "policies": summarize(rows)})
        progress.close()
        title, summary = f"{task_name(task)}, suite {suite}", summarize(rows)
        picture = folder.write("evaluation.png", lambda path: draw(path, rows, title)).read_bytes()
        folder.write_text("index.html", make_suite_page(title, summary, rows, picture).html())
    print(format_summary(summary))
    return 0


def compared(task: TaskConfig) -> tuple[str, ...]:
    """Return the policies that stand beside the one that is scored."""
    return COMPARED if task.dose is None or task.dose.controllers is None else CONTROLLERS


def find_policy(name: str) -> str:
    """Return the file of a training run's policy for its folder; raises ConfigError where it has none."""
    folder = Path(name)
    if name in POLICIES or not folder.is_dir():
        return name
    if found := [folder / file for file in FOUND if (folder / file).is_file()]:
        return str(found[0])
    raise ConfigError(f"policy {name}: the folder has neither {' nor '.join(FOUND)}; accepted: the folder of "
                      f"`robosim train`")


def policy_file(name: str, task: str) -> str:
    """Return a policy's name or file, that of the bundled motion for "learned".
    Raises ConfigError for a file of another task, or where there is no bundled motion."""
    if name == "learned":
        return str(bundled_motion(task_name(task)))
    if Path(name).is_file():
        made_for = load_policy(Path(name)).text("task", "")
        if made_for and made_for != task_name(task) and not is_task_file(task):
            raise ConfigError(f"policy {name}: for {made_for}; accepted: for {task_name(task)}")
    return name


def bootstrap(values: Sequence[float]) -> tuple[float, float]:
    """Return the ends of the bootstrap interval of the mean, from percentiles of resampled means."""
    array = np.asarray(values, float)
    picks = np.random.default_rng(0).integers(len(array), size=(RESAMPLES, len(array)))
    low, high = np.quantile(array[picks].mean(1), [0.5 - COVERED / 2, 0.5 + COVERED / 2])
    return float(low), float(high)


def summarize(rows: list[Row]) -> dict[str, dict[str, Any]]:
    """Return for each policy the number of episodes, and the mean of each of FIGURES with its spread and interval."""
    summary = {}
    for policy in dict.fromkeys(row["policy"] for row in rows):
        own = [row for row in rows if row["policy"] == policy]
        summary[policy] = {"episodes": len(own), "diverged": sum(bool(row["diverged"]) for row in own)}
        for key in [one for one in FIGURES if one in own[0]]:
            values = [float(row[key]) for row in own]
            summary[policy][key] = {"mean": float(np.mean(values)), "std": float(np.std(values)),
                                    "interval": bootstrap(values)}
    return summary


def format_summary(summary: dict[str, dict[str, Any]]) -> str:
    """Format means and intervals for a terminal."""
    def cell(figures: dict[str, Any]) -> str:
        low, high = figures["interval"]
        return f"{figures['mean']:.2f} ({low:.2f} .. {high:.2f})"

    if all("dose_error" in values for values in summary.values()):
        lines = [["policy", "success", "error [g]", "spread [g]", "seconds", "spilled [g]", "episodes"]]
        for policy, values in summary.items():
            error, spilled = values["dose_error"], values["spilled"]
            lines.append([Path(policy).name, cell(values["is_success"]), f"{1e3 * error['mean']:.2f}",
                          f"{1e3 * error['std']:.2f}", f"{values['seconds']['mean']:.1f}",
                          f"{1e3 * spilled['mean']:.2f}", str(values["episodes"])])
        return aligned(lines)
    lines = [["policy", "score", "return", "success", "episodes"]]
    lines += [[Path(policy).name, cell(values["tcs"]), cell(values["return"]), cell(values["is_success"]),
               str(values["episodes"])] for policy, values in summary.items()]
    return aligned(lines)


def draw(path: Path, rows: list[Row], title: str) -> None:
    """Draw the scores of every policy's episodes, with means and their intervals."""
    figure = Figure(figsize=(7.5, 4.0), layout="constrained")
    axes, summary = figure.subplots(), summarize(rows)
    for place, (policy, values) in enumerate(summary.items()):
        scores = [row["tcs"] for row in rows if row["policy"] == policy]
        spread = np.linspace(-0.25, 0.25, len(scores)) if len(scores) > 1 else np.zeros(1)
        axes.plot(place + spread, scores, ".", ms=4, alpha=0.6)
        mean, (low, high) = values["tcs"]["mean"], values["tcs"]["interval"]
        axes.errorbar(place + 0.35, mean, [[mean - low], [high - mean]], fmt="ko", capsize=4, ms=4)
    axes.set_xticks(range(len(summary)), [Path(policy).name for policy in summary])
    axes.set(title=title, ylabel="task completion score")
    axes.grid(axis="y", alpha=0.3)
    figure.savefig(path, dpi=110)
