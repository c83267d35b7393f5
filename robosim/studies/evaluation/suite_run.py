"""Policies on a suite, beside the recorded motion, scripts and no motion from the same starts."""

import tempfile
from collections.abc import Collection, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from robosim.base.errors import ConfigError
from robosim.base.files import write_rows
from robosim.base.output_folder import OutputFolder, aligned
from robosim.base.progress import Progress
from robosim.base.provenance import provenance
from robosim.base.resources import trained
from robosim.base.statistics import bootstrap, interquartile_mean
from robosim.dosing import CONTROLLERS
from robosim.envs import is_task_file, task_name
from robosim.envs.grain_env import GrainEnv
from robosim.episode.play import play, read_scores
from robosim.studies.evaluation.page import make_suite_page, short_name
from robosim.studies.policies import KNOWING, POLICIES
from robosim.studies.policies.make import bundled_motion, check_task, load_policy, make_policy, training_options
from robosim.studies.policies.suites import Start, begin_episode, make_environment, plan_starts
from robosim.tasks.task import TaskConfig, load_task

STILL = "zero"
COMPARED = (KNOWING, "recorded", "scripted", STILL)
"""Policies whose episodes stand beside those of the policy that is scored; in dosing tasks the controllers do."""
SCORES = ("normalised", "tcs")
"""Figures with an interquartile mean. normalised: share of the way from no motion (0) to the cap of the start (1)."""
FIGURES = (*SCORES, "return", "is_success", "delivered", "dose_error", "dose_error_percent", "seconds", "spilled")
"""Figures of an episode that a summary has, where the task has them."""
RESULTS = ("evaluation.json", "evaluation.csv", "index.html")
"""Files that a run writes."""
RUN_FILES = {"": "best_policy.npz", ", last": "last_policy.npz"}
"""What follows the name of a training run in the table -> its file."""

Row = dict[str, Any]


def evaluate_suite(task: str, names: Sequence[str], suite: str, out: Path | None, *, episodes: int | None = None,
                   material: str | None = None, changed: Collection[str] = (), alone: bool = False,
                   **options: Any) -> int:
    """Score policies on a suite; print means with intervals, and write a row an episode, a summary and a page.

    names: of policies, their files, or folders of training runs, or of runs that differ in the seed alone. changed:
    top-level keys of the task that differ on purpose from what the policies were learned on. alone: run no other
    policy. options: of the environment, such as an arm. Returns 0. Raises ConfigError, UnknownName for
    what cannot be used, before any episode runs."""
    if material is not None and suite != "nominal":
        raise ConfigError(f"--material {material} with --suite {suite}; accepted: with --suite nominal, others have "
                          f"materials of their own")
    config, files = load_task(task), dict[str, list[str]]()
    for name in names:
        files |= find_policies(name)
    starts = plan_starts(suite, config, episodes or 50, material)
    files |= {other: [other] for other in compared(config) if not alone and [other] not in files.values()
              and (other != "recorded" or trained(task_name(task)) is not None)}
    files = {label: [policy_file(policy, task) for policy in policies] for label, policies in files.items()}
    policies, rows = list(chain(*files.values())), list[Row]()
    for policy in policies:
        check_task(policy, config, changed, options.get("arm") or None)

    def make_environments(start: Start) -> dict[str, GrainEnv]:
        """Make one for each observation and action_repeat; raises ConfigError where a policy does not fit."""
        envs: dict[str, GrainEnv] = {}
        for policy in policies:
            own = training_options(policy)
            if str(own) not in envs:
                envs[str(own)] = make_environment(config, start, **options, **own)
            make_policy(policy, envs[str(own)], start.seed)
        return envs

    first = make_environments(starts[0])
    with tempfile.TemporaryDirectory() as scratch, OutputFolder(out or Path(scratch)) as folder:
        folder.clear(RESULTS)
        progress = Progress(total=sum(map(len, files.values())) * len(starts), desc=f"{task_name(task)}, {suite}",
                            unit="episodes")
        for world in dict.fromkeys(start.world for start in starts):
            members = [(k, start) for k, start in enumerate(starts) if start.world == world]
            envs = first if world == starts[0].world else make_environments(members[0][1])
            for label, run, policy in [(label, *one) for label, runs in files.items() for one in enumerate(runs)]:
                env = envs[str(training_options(policy))]
                for k, start in members:
                    drawn = begin_episode(env, start)
                    total, info = play(env, make_policy(policy, env, start.seed), observation=env.observation)
                    rows.append({"policy": label, "run": run, "episode": k, **drawn, "return": total,
                                 **read_scores(info), "cap": env.reward.extremes()[1],
                                 "diverged": info.get("diverged") or "", **info.get("arm", {})})
                    progress.update()
                    rows.sort(key=lambda row: (list(files).index(row["policy"]), row["run"], row["episode"]))
                    normalise(rows)
                    write_rows(folder.path / "evaluation.csv", rows)
            for env in envs.values():
                env.close()
            folder.write_json("evaluation.json", {
                "task": task, "policy": names[0], "suite": suite, "made_by": provenance(),
                "environment": options, "seeds": [starts[0].seed, starts[-1].seed],
                "is_complete": len(rows) == progress.total,
                "policies": summarize(rows)})
        progress.close()
        title, summary = f"{task_name(task)}, suite {suite}", summarize(rows)
        folder.write_text("index.html", make_suite_page(title, summary, rows, sort_scores(rows)).html())
    print(format_summary(summary))
    return 0


def compared(task: TaskConfig) -> tuple[str, ...]:
    """Return the policies that stand beside the one that is scored."""
    return COMPARED if task.dose is None or task.dose.controllers is None else CONTROLLERS


def find_policies(name: str) -> dict[str, list[str]]:
    """Return the files of a policy by its label in the table, those of several runs of a folder under one label.
    The best and the last policy of training runs have a label each. Raises ConfigError for a folder with neither."""
    folder = Path(name)
    if name in POLICIES or not folder.is_dir():
        return {name: [name]}
    runs = sorted(folder.glob("seed_*")) or [folder]
    for kinds in (RUN_FILES, {"": "best.npz"}):
        paths = {name + end: [str(run / file) for run in runs if (run / file).is_file()] for end, file in kinds.items()}
        if found := {label: files for label, files in paths.items() if files}:
            return found
    raise ConfigError(f"policy {name}: the folder has neither best_policy.npz nor best.npz; accepted: the folder of "
                      f"`robosim train`, or one with such folders seed_0, seed_1 and so on")


def policy_file(name: str, task: str) -> str:
    """Return a policy's name or file, that of the bundled motion for "recorded".
    Raises ConfigError for a file of another task, or where there is no bundled motion."""
    if name == "recorded":
        return str(bundled_motion(task_name(task)))
    if Path(name).is_file():
        made_for = load_policy(Path(name)).text("task", "")
        if made_for and made_for != task_name(task) and not is_task_file(task):
            raise ConfigError(f"policy {name}: for {made_for}; accepted: for {task_name(task)}")
    return name


def normalise(rows: list[Row]) -> None:
    """Add to rows the share of the way from no motion to the cap, of the same start; where no motion was scored."""
    still = {row["episode"]: row["tcs"] for row in rows if row["policy"] == STILL}
    for row in rows:
        low = still.get(row["episode"], row["cap"])
        if low < row["cap"]:
            row["normalised"] = (row["tcs"] - low) / (row["cap"] - low)


def summarize(rows: list[Row]) -> dict[str, dict[str, Any]]:
    """Return for each policy its episodes and runs, and the mean of each of FIGURES with its spread and interval.
    SCORES have their interquartile mean, `iqm`, and its interval besides."""
    summary = {}
    for policy in dict.fromkeys(row["policy"] for row in rows):
        own = [row for row in rows if row["policy"] == policy]
        runs = len({row.get("run") for row in own})
        summary[policy] = {"episodes": len(own), "runs": runs, "diverged": sum(bool(row["diverged"]) for row in own)}
        for key in [one for one in FIGURES if all(one in row for row in own)]:
            values = np.array([float(row[key]) for row in own]).reshape(runs, -1)
            summary[policy][key] = {"mean": float(values.mean()), "std": float(values.std()),
                                    "interval": bootstrap(values)}
            if key in SCORES:
                summary[policy][key] |= {"iqm": float(interquartile_mean(values.ravel())),
                                         "iqm_interval": bootstrap(values, interquartile_mean)}
        if all("cap" in row for row in own):
            summary[policy]["cap"] = [min(row["cap"] for row in own), max(row["cap"] for row in own)]
    return summary


def format_summary(summary: dict[str, dict[str, Any]]) -> str:
    """Format means and intervals for a terminal."""
    def cell(figures: dict[str, Any] | None, key: str = "mean", interval: str = "interval") -> str:
        return "" if figures is None else "{:.2f} ({:.2f} .. {:.2f})".format(figures[key], *figures[interval])

    if all("dose_error" in values for values in summary.values()):
        lines = [["policy", "success", "error [g]", "spread [g]", "seconds", "spilled [g]", "episodes"]]
        for policy, values in summary.items():
            error, spilled = values["dose_error"], values["spilled"]
            lines.append([short_name(policy), cell(values["is_success"]), f"{1e3 * error['mean']:.2f}",
                          f"{1e3 * error['std']:.2f}", f"{values['seconds']['mean']:.1f}",
                          f"{1e3 * spilled['mean']:.2f}", str(values["episodes"])])
        return aligned(lines)
    lines = [["policy", "normalised IQM", "score IQM", "cap", "success", "return", "episodes"]]
    lines += [[short_name(policy), *(cell(values.get(key), "iqm", "iqm_interval") for key in SCORES),
               " .. ".join(dict.fromkeys(f"{one:.2f}" for one in values["cap"])), cell(values["is_success"]),
               cell(values["return"]), str(values["episodes"])] for policy, values in summary.items()]
    return aligned(lines)


def sort_scores(rows: list[Row]) -> dict[str, dict[str, tuple[np.ndarray, np.ndarray]]]:
    """Return, under the name of the score, each policy's shares of episodes and the score that they do not exceed."""
    key = next(one for one in SCORES if all(one in row for row in rows))
    scores = {policy: np.sort([row[key] for row in rows if row["policy"] == policy])
              for policy in dict.fromkeys(row["policy"] for row in rows)}
    return {key: {short_name(policy): (np.arange(1, 1 + len(own)) / len(own), own) for policy, own in scores.items()}}
