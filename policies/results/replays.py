"""Rows whose runs today's code repeats: the first episodes of a run of each kind, run again.

A row is a result of the code that made it. Most changes of that code move or add something and leave every figure as it
was. Where a run of the row's kind, begun again, has the scores of its first episodes, the row counts as one of today.

Networks are trained with products whose rounding depends on the processor, and on the library. So where a score
differs, the code of the row's own commit runs those episodes, too: what it scores on the same machine tells a change of
the code from another machine.
"""

import os
import shlex
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import mpm
from policies.learning.files import read_last_line
from policies.results.curves import POINT, read_curve
from policies.results.past_code import past_code
from policies.results.rows import preset_digest
from robosim.base.digests import changed_modules, digest
from robosim.base.files import write_json
from robosim.base.input_files import check_form, read_json
from robosim.base.progress import Progress

FILE = "replays.json"
"""Beside the tables.json whose rows it is about."""
REPLAY: dict[str, Any] = {"kind": str, "task": str, "method": str, "seed": int, "commit": str, "preset": str,
                          "stored": float, "of": str, "here": (float, None), "found": float, "code": str}
"""Form of a replay. kind: of its run; commit: where it was run again; stored, found: mean score of the first episodes
in the row, and when they were run again; of: the row's commit; here: what that scores on the machine of the replay, run
where the two differ, or None where it was not; code: key of the file's table `code`."""
POLL = 0.2
"""Time [s] between two looks at a run."""
OWN = ("--seed", "--out")
"""Options of a run's command in which the runs of one kind differ."""


def kind(row: dict[str, Any]) -> str:
    """Return a row's command without its seed and folder, which runs that differ in these alone share."""
    words = shlex.split(row["command"] or "")
    return shlex.join(word for k, word in enumerate(words) if word not in OWN and (k == 0 or words[k - 1] not in OWN))


def read_replays(sources: list[Path]) -> list[dict[str, Any]]:
    """Return the replays that lie beside tables.json files, with their code in place of its key.

    Raises:
        mpm.InvalidValue: a file is not one of `robosim tables --replay`.
    """
    replays = []
    for path in sorted({source.with_name(FILE) for source in sources if source.is_file()}):
        if path.is_file():
            try:
                table = read_json(path)
                check_form(table, {"made_by": str, "replays": [REPLAY], "code": {str: {str: str}}}, path.name)
                replays += [{**one, "code": table["code"][one["code"]]} for one in table["replays"]]
            except (OSError, ValueError, KeyError, TypeError) as error:
                raise mpm.InvalidValue(f"{path}: not a {FILE} of `robosim tables --replay`: {error}") from error
    return replays


def is_repeated(row: dict[str, Any], replays: list[dict[str, Any]]) -> bool:
    """Return whether today's code has repeated a run of the row's kind, with the row's preset and its scores."""
    return any(one["kind"] == kind(row) and one["preset"] == row["preset"] and is_of(one, row)
               and one["found"] in (one["stored"], one["here"]) and not changed_modules(one["code"])
               for one in replays)


def is_of(one: dict[str, Any], row: dict[str, Any]) -> bool:
    """Return whether a replay's stored score is that of a row, or may be: of another seed."""
    return one["seed"] != row["seed"] or (row["curve"] is not None and one["stored"] == row["curve"][0])


def replay(rows: list[dict[str, Any]], path: Path) -> int:
    """Run the first episodes of one run of each kind again; add them to a replays.json, after each of them.

    Kinds that the file has, repeated by the code of today, are not run once more; its replays of changed code are
    dropped. Returns 1 where a score differs or a run cannot be repeated, which is printed; 0 otherwise. Takes about 20
    s a kind, and twice that where a score differs.
    """
    replays = [one for one in read_replays([path]) if not changed_modules(one["code"])]
    first: dict[str, dict[str, Any]] = {}
    for row in sorted(rows, key=lambda row: row["seed"]):
        if not is_repeated(row, replays):
            first.setdefault(kind(row), row)
    replays, failed = [one for one in replays if one["kind"] not in first], 0
    for name, row in Progress(list(first.items()), desc="replays", unit="runs"):
        title = f"{row['method']} {row['task']} seed {row['seed']}"
        if not (row["command"] and row["curve"]):
            failed, text = 1, "its row has no command or no scores"
        else:
            again, text = run_first_episodes(row)
            if again is None:
                failed = 1
            else:
                found, stored = again["curve"][0], row["curve"][0]
                here, text = (None, "") if found == stored else score_here(row)
                replays.append({"kind": name, "task": row["task"], "method": row["method"], "seed": row["seed"],
                                "commit": again["commit"], "preset": again["preset"], "stored": stored,
                                "of": row["commit"], "here": here, "found": found, "code": again["code"]})
                write_replays(path.with_name(FILE), replays)
                is_same = found in (stored, here) and row["preset"] == again["preset"]
                failed |= not is_same
                text = f"mean score of the first episodes {found:g}, stored {stored:g}{text}" \
                       f"{'' if is_same else ': DIFFERS'}"
        print(f"{title}: {text}")
    return int(failed)


def write_replays(path: Path, replays: list[dict[str, Any]]) -> None:
    """Write replays to a file; their code, which many share, is there once."""
    versions = {digest(one["code"]): one["code"] for one in replays}
    write_json(path, {"made_by": "robosim tables --replay", "code": versions,
                      "replays": [{**one, "code": digest(one["code"])} for one in replays]})


def score_here(row: dict[str, Any]) -> tuple[float | None, str]:
    """Return what the code of a row's commit scores in its first episodes on this machine, and a text on it.

    None where it cannot be run; the text says why.
    """
    try:
        with past_code(row["commit"]) as folder:
            then, text = run_first_episodes(row, folder)
    except mpm.InvalidValue as error:
        then, text = None, str(error)
    if then is None:
        return None, f" (its commit {row['commit']} was not run: {text})"
    return then["curve"][0], f", {then['curve'][0]:g} by its commit {row['commit']} on this machine"


def run_first_episodes(row: dict[str, Any], root: Path | None = None) -> tuple[dict[str, Any] | None, str]:
    """Begin a run again in a process of its own, and stop it after its first episodes.

    Not with fewer episodes: rates may decay over all of them. root: folder with other code than today's, which makes
    starts of its own; files that the command names are those of today. Returns commit, preset's digest, code and curve;
    or None, and why not.
    """
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    with tempfile.TemporaryDirectory(prefix="replay_") as folder:
        out, log = Path(folder) / "run", Path(folder) / "log.txt"
        words = shlex.split(row["command"])[1:]
        words[words.index("--out") + 1] = str(out)
        if root is not None:
            words = [str(Path(word).resolve()) if "/" in word and Path(word).exists() else word for word in words]
            paths = [str(root), *filter(None, [environment.get("PYTHONPATH")])]
            environment |= {"PYTHONPATH": os.pathsep.join(paths), "ROBOSIM_CACHE": str(Path(folder) / "cache")}
        with log.open("w") as file:
            process = subprocess.Popen([sys.executable, "-m", "robosim", *words], stdout=file, stderr=file,
                                       env=environment, cwd=root, start_new_session=True)
            try:
                while process.poll() is None and count_episodes(out) < POINT:
                    time.sleep(POLL)
            finally:
                is_ended = process.poll() is not None
                process.terminate()
                process.wait()
        if is_ended and process.returncode != 0:
            return None, f"cannot be run again: {read_last_line(log) or f'exit status {process.returncode}'}"
        manifest, curve = read_json(out / "manifest.json"), read_curve(out / "episodes.csv")
        return {"commit": manifest["commit"], "preset": preset_digest(manifest["preset"]), "code": manifest["code"],
                "curve": curve}, ""


def count_episodes(out: Path) -> int:
    """Return how many episodes a run has written."""
    path = out / "episodes.csv"
    return max(len(path.read_text().splitlines()) - 1, 0) if path.is_file() else 0
