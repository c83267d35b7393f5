"""Interrupts commands at random moments, and checks what they leave and how they continue.

`python interrupt_trials.py --trials 200 --out FOLDER` prints a line for each trial and stores it in
FOLDER/trials.jsonl, from which the same command continues. A trial is a command with an end: SIGKILL, SIGTERM, SIGINT
(Ctrl-C) or a full disk. The disk is a tmpfs of a random size where this process may mount one; otherwise a limit on
the size of a file (RLIMIT_FSIZE) of the command's process. Afterwards the same command runs to its end.
"""

import argparse
import json
import os
import pickle
import resource
import shutil
import signal
import subprocess
import sys
import time
import zipfile
from collections import Counter
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
from stand_in_rehearsal import STEPS  # noqa: E402
from stand_ins import install, run_forked  # noqa: E402
from trial_checks import Broken, check_files, find_unfinished, read_events, read_rows, read_status  # noqa: E402

ENDS = ("kill", "term", "int", "full")
SIGNALS = {"kill": signal.SIGKILL, "term": signal.SIGTERM, "int": signal.SIGINT}
HANG = 300.0
"""Time [s] after which a command is taken to hang."""
EVERY, EPISODES = 4, 10
TRAIN = ["--episodes", str(EPISODES), "--checkpoint-every", str(EVERY)]
METHODS = {"sac": (["--set", "options.batch_size=16", "--set", "options.policy_kwargs.net_arch=[8,8]"], 1),
           "ppo": (["--set", "options.n_steps=40", "--set", "options.batch_size=20"], 2),
           "cmaes": (["--set", "options.population=2", "--set", "options.knots=3"], 2),
           "bc": (["--set", "options.updates=50", "--demos", "{demos}"], 1)}
"""Method -> further arguments, and the episodes that an interrupt may lose."""
REHEARSAL = ("index.html", "rehearsal.mp4", "frames.png", "trajectory.csv", "joint_trajectory.yaml", "config.yaml",
             "material.yaml")
"""Files of a rehearsal besides report.json, which is the last."""
WEIGHTS = {"train sac": 5, "train ppo": 3, "train cmaes": 3, "train bc": 2, "demo descent": 4, "demo cmaes": 3,
           "evaluate": 5, "report": 3, "sweep": 2, "pipeline": 2, "rehearse": 4}
"""Kind of trial -> how often it is drawn."""


def make_arguments(kind: str, out: Path, base: Path) -> list[str]:
    """Return the arguments of `robosim`."""
    command, _, method = kind.partition(" ")
    if command == "train":
        more = [word.format(demos=base / "demos") for word in METHODS[method][0]]
        return ["train", method, "Point-v0", *TRAIN, *more, "--out", str(out)]
    if command == "demo":
        return ["demo", "SpoonTranslate", "--n", "2", "--iterations", "8", "--method", method, "--no-video",
                "--action-repeat", "50", "--nominal", "--out", str(out)]
    if command == "evaluate":
        return ["evaluate", "SpoonTranslate", "--policy", "random", "--episodes", "4", "--out", str(out)]
    if command == "report":
        return ["report", "free_fall", "--quick", "--out", str(out)]
    if command == "rehearse":
        return ["rehearse", "spoon", "--out", str(out)]
    if command == "sweep":
        file = base / f"{out.parent.name}.yaml"
        file.write_text(f"tasks: [Point-v0]\nmethods: [sac]\nseeds: [0, 1]\nepisodes: 4\n"
                        f"options: [--set, 'options.policy_kwargs.net_arch=[8]']\nout: {out}\n")
        return ["sweep", str(file)]
    return ["pipeline", "shovel", "--iterations", "3", "--episodes", "3", "--no-video", "--out", str(out)]


class Trials:
    """Trials in a folder."""

    def __init__(self, base: Path) -> None:
        self.base, self.references = base, {}
        base.mkdir(parents=True, exist_ok=True)
        os.environ["EVALUATIONS"], os.environ["ROBOSIM_CACHE"] = str(base / "evaluations"), str(base / "cache")
        self.can_mount = self._try_mount()

    def _try_mount(self) -> bool:
        place = self.base / "mount"
        place.mkdir(exist_ok=True)
        is_mounted = self._mount(place, 64)
        if is_mounted:
            subprocess.run(["umount", str(place)], check=True)
        return is_mounted

    def _mount(self, place: Path, kib: int, *options: str) -> bool:
        words = ["mount", "-t", "tmpfs", "-o", ",".join([*options, f"size={kib}k"]), "tmpfs", str(place)]
        try:
            return subprocess.run(words, capture_output=True, check=False).returncode == 0
        except OSError:
            return False

    def run(self, arguments: list[str], log: Path, moment: float | None = None, number: int = 0,
            limit: int | None = None) -> tuple[int, float]:
        """Run a command, and send it a signal at a moment [s]; return its exit status and its time [s]."""
        begin = time.monotonic()
        with log.open("a") as file:
            pid = os.fork()
            if pid == 0:
                if limit is not None:
                    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
                run_forked(arguments, file)
        while time.monotonic() - begin < HANG:
            ended, status = os.waitpid(pid, os.WNOHANG)
            if ended:
                return os.waitstatus_to_exitcode(status), time.monotonic() - begin
            if moment is not None and time.monotonic() - begin >= moment:
                os.kill(pid, number)
                moment = None
            time.sleep(0.005)
        os.kill(pid, signal.SIGKILL)
        os.waitpid(pid, 0)
        raise Broken(f"hangs; {log.read_text()[-300:]}")

    def reference(self, kind: str) -> dict:
        """Return results, time [s] and size [KiB] of a command that is not interrupted."""
        if kind not in self.references:
            folder = self.base / "reference" / kind.replace(" ", "_")
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir(parents=True)
            code, seconds = self.run(make_arguments(kind, folder / "out", self.base), folder / "log")
            if code != 0:
                raise SystemExit(f"{kind}: exit status {code}: {(folder / 'log').read_text()[-2000:]}")
            size = sum(-(-path.stat().st_size // 4096) * 4 for path in (folder / "out").rglob("*"))
            self.references[kind] = {"results": read_results(kind, folder / "out"), "seconds": seconds, "kib": size}
        return self.references[kind]

    def trial(self, index: int, kind: str, end: str, share: float) -> str:
        """Run one trial; return how the command ended. Raises Broken for what must not be."""
        reference, folder = self.reference(kind), self.base / f"trial_{index}"
        shutil.rmtree(folder, ignore_errors=True)
        out, log, moment, limit = folder / "out", folder / "log", None, None
        out.mkdir(parents=True)
        arguments, is_mounted = make_arguments(kind, out, self.base), False
        if end == "full":
            kib = 4 * max(2, round(0.25 * reference["kib"] * share))
            is_mounted = self.can_mount and self._mount(out, kib)
            limit = None if is_mounted else 1024 * kib // 8
        else:
            moment = share * reference["seconds"]
        try:
            code, _ = self.run(arguments, log, moment, SIGNALS.get(end, 0), limit)
            before = check_interrupted(kind, end, code, out, log)
            if is_mounted:
                self._mount(out, 65536, "remount")
            self._continue(kind, arguments, out, folder / "log_2", before, reference["results"])
        finally:
            if is_mounted:
                subprocess.run(["umount", "-l", str(out)], check=True)
        shutil.rmtree(folder)
        return f"exit status {code}, {before.get('kept', '')}"

    def _continue(self, kind: str, arguments: list[str], out: Path, log: Path, before: dict, expected: dict) -> None:
        """Run the same command again; it must keep what was done and end like one that was not interrupted."""
        counter = Path(os.environ["EVALUATIONS"])
        counter.write_text("")
        code, _ = self.run(arguments, log)
        if code != 0 or "Traceback" in log.read_text():
            raise Broken(f"does not continue: exit status {code}: {log.read_text()[-1500:]}")
        check_files(out)
        if unfinished := find_unfinished(out):
            raise Broken(f"leaves {unfinished} after it has continued")
        results = read_results(kind, out)
        for key, value in expected.items():
            if results.get(key) != value:
                raise Broken(f"{key} differs: {str(results.get(key))[:600]}, not {str(value)[:600]}")
        if "rows" in before:
            rows = read_rows(out / "episodes.csv")[: before["kept"]]
            if rows != before["rows"]:
                raise Broken(f"episodes of the checkpoint were repeated: {before['rows']} became {rows}")
        if "evaluations" in before and len(counter.read_text()) > before["evaluations"]:
            raise Broken(f"{len(counter.read_text())} evaluations, {before['evaluations']} were left to do")
        if "lines" in before:
            lines = (out / "report.jsonl").read_text().splitlines()
            if lines[: len(before["lines"])] != before["lines"]:
                raise Broken("runs were repeated")


def check_interrupted(kind: str, end: str, code: int, out: Path, log: Path) -> dict:
    """Check what an interrupted command left; return what the same command must keep. Raises Broken."""
    accepted = {"kill": (-9, 0), "term": (143, -15, 0), "int": (130, 0), "full": (1, 2, 0)}[end]
    text = log.read_text()
    if code not in accepted:
        raise Broken(f"exit status {code}; {text[-1500:]}")
    if end != "kill" and "Traceback" in text:
        raise Broken(text[-2500:])
    check_files(out)
    if end != "kill" and (unfinished := find_unfinished(out)):
        raise Broken(f"leaves {unfinished}")
    state = read_status(out)
    states = {130: ("interrupted", "finished", None), 143: ("interrupted", "finished", None),
              1: ("failed", "finished", None), 2: ("failed", "running", None)}.get(code)
    if states and state not in states:
        raise Broken(f"exit status {code}, but status.json says {state}; {text[-800:]}")
    command, _, method = kind.partition(" ")
    if command == "train":
        most = (EVERY if end in ("kill", "full") else 0) + METHODS[method][1]
        return {} if state == "finished" else check_checkpoint(
            out, most, is_told=end in ("term", "int") and state == "interrupted", text=text)
    if command == "demo":
        left = 0
        for k in range(2):
            if not (out / f"demonstration_{k}.npz").is_file():
                path = out / f"demonstration_{k}.unfinished.npz"
                left += 8 - (len(np.load(path)["losses"]) if path.is_file() else 0)
        return {"evaluations": left, "kept": 16 - left}
    if command == "rehearse" and (out / "report.json").is_file():
        missing = [name for name in REHEARSAL if not (out / name).is_file()]
        if missing or len(read_rows(out / "trajectory.csv")) != STEPS:
            raise Broken(f"report.json is there, and {missing or 'a part of trajectory.csv'} is missing")
        return {"kept": "all"}
    if command == "report" and (out / "report.jsonl").is_file():
        lines = (out / "report.jsonl").read_text().split("\n")[:-1]
        return {"lines": lines, "kept": len(lines)}
    return {}


def check_checkpoint(out: Path, most: int, is_told: bool, text: str) -> dict:
    """Return the episodes of the checkpoint; raises Broken where more than `most` were lost.

    is_told: whether the message must name them.
    """
    rows, path = read_rows(out / "episodes.csv"), out / "checkpoint.zip"
    kept = 0
    if path.is_file():
        with zipfile.ZipFile(path) as archive:
            kept = len(pickle.loads(archive.read("state.pickle"))["rows"])
    if len(rows) - kept > most:
        raise Broken(f"{len(rows)} episodes, of which the checkpoint has {kept}")
    truth = f"continues after {kept} episodes" if kept else "there is no checkpoint yet"
    if is_told and truth not in text and "continues from the checkpoint" not in text:
        raise Broken(f"the checkpoint has {kept} episodes: {text[-500:]}")
    return {"rows": rows[:kept], "kept": kept}


def read_results(kind: str, out: Path) -> dict:
    """Return what must be the same whether a command was interrupted or not."""
    command = kind.split(" ")[0]
    if command == "train":
        with np.load(out / "best.npz") as best:
            actions = best["actions"].tolist()
        return {"rows": [row[:4] for row in read_rows(out / "episodes.csv")], "best": actions,
                "events": read_events(out), "state": read_status(out)}
    if command == "demo":
        return {f"demonstration {k}": {key: array.tolist() for key, array in
                                       np.load(out / f"demonstration_{k}.npz").items()} for k in range(2)} | {
            "table": json.loads((out / "demonstrations.json").read_text()), "state": read_status(out)}
    if command == "evaluate":
        return {"evaluation": json.loads((out / "evaluation.json").read_text()), "state": read_status(out),
                "film": (out / "episode.mp4").is_file()}
    if command == "report":
        runs = json.loads((out / "report.json").read_text())["runs"]
        return {"runs": [[run["choices"], run["record"]["errors"]] for run in runs], "state": read_status(out),
                "lines": len((out / "report.jsonl").read_text().splitlines())}
    if command == "rehearse":
        return {"report": json.loads((out / "report.json").read_text()), "rows": read_rows(out / "trajectory.csv"),
                "files": sorted(path.name for path in out.iterdir()), "state": read_status(out)}
    if command == "sweep":
        return {"runs": {str(path.relative_to(out)): [row[:4] for row in read_rows(path)]
                         for path in sorted(out.rglob("episodes.csv"))}, "state": read_status(out),
                "table": sorted(json.loads((out / "sweep.json").read_text())["runs"].values())}
    stages = json.loads((out / "pipeline.json").read_text())["stages"]
    return {"stages": {name: stage["state"] for name, stage in stages.items()}, "state": read_status(out),
            "rows": [row[:4] for path in out.rglob("episodes.csv") for row in read_rows(path)]}


def main() -> int:
    """Run the trials; 0 if all hold."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=200)
    parser.add_argument("--first", type=int, default=0, help="index of the first trial")
    parser.add_argument("--only", nargs="+", choices=list(WEIGHTS), default=list(WEIGHTS), help="kinds of trials")
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    install()
    trials, stored = Trials(options.out.resolve()), options.out / "trials.jsonl"
    rows = [json.loads(line) for line in stored.read_text().splitlines()] if stored.is_file() else []
    print("full disk:", "a tmpfs" if trials.can_mount else "RLIMIT_FSIZE", flush=True)
    trials.run(make_arguments("demo descent", trials.base / "demos", trials.base), trials.base / "log")
    for index in range(options.first, options.first + options.trials):
        rng = np.random.default_rng(index)
        kind = str(rng.choice(list(WEIGHTS), p=np.array(list(WEIGHTS.values())) / sum(WEIGHTS.values())))
        end, share = ENDS[index % len(ENDS)], float(rng.uniform(0.0, 1.1))
        if kind not in options.only or index in {row["index"] for row in rows}:
            continue
        try:
            row = {"ended": trials.trial(index, kind, end, share), "broken": ""}
        except Broken as broken:
            row = {"ended": "", "broken": str(broken)}
        rows.append({"index": index, "kind": kind, "end": end, "share": share, **row})
        with stored.open("a") as file:
            file.write(json.dumps(rows[-1]) + "\n")
        print(f"{index:4d} {kind:14s} {end:5s} {share:.3f} {row['ended'] or 'BROKEN: ' + row['broken']}", flush=True)
    broken = [row for row in rows if row["broken"]]
    print(f"{len(rows)} trials, {len(broken)} broken; {dict(Counter((row['kind'], row['end']) for row in rows))}")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
