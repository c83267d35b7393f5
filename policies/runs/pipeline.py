"""The pipeline from nothing to the whole arm's motion (Algorithm 1 of arXiv 2406.09178), one command after the
other, each in a folder of its own: demonstrations, learning, the learnt sub-tasks in a row, the arm."""

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import yaml
from tqdm import tqdm

import mpm
from policies.learning.bundled import configs_folder
from policies.learning.files import claim, write, write_json
from policies.learning.installed import check_installed
from policies.learning.presets import load_preset
from policies.results.tables import aligned

BEGINNINGS = {"SpoonScoop": ("--from", "script", "--until", "0.75", "--rate", "0.03"),
              "ScoopScoop": ("--from", "script", "--rate", "0.01"),
              "ScoopTranslate": ("--rate", "0.03"),
              "SpoonPour": ("--from", "script", "--rate", "0.02"),
              "ScoopPour": ("--from", "script", "--rate", "0.02")}
"""What a descent begins with: where a tool must touch its material first, and where from rest it finds a pour that the
hand is in the way of. ScoopTranslate stops short of its target at the default rate."""

DOWNSTREAM = {"demonstrations": ("learning of {task}", "sub-tasks in a row", "whole arm"),
              "learning": ("sub-tasks in a row", "whole arm")}
"""What a command's outcome goes into."""


def rehearsals() -> dict[str, list[str]]:
    """Sub-tasks of every rehearsal that has learnt ones."""
    files = sorted((configs_folder() / "rehearsals").glob("*.yaml"))
    found = {path.stem: yaml.safe_load(path.read_text()).get("learned", []) for path in files}
    return {name: tasks for name, tasks in found.items() if tasks}


class Pipeline:
    """Runs what is not finished yet; pipeline.json says of every command how it went."""

    def __init__(self, options: argparse.Namespace) -> None:
        check_installed()  # now, and not after the first demonstrations
        known = rehearsals()
        if options.rehearsal not in known:
            raise mpm.InvalidValue(f"rehearsal {options.rehearsal!r}; accepted: {', '.join(known)}")
        if min(options.jobs, options.n) < 1:
            raise mpm.InvalidValue(f"--jobs {options.jobs}, --n {options.n}; accepted: 1 or more")
        preset = load_preset(options.method)
        if preset.graph is not None:
            raise mpm.InvalidValue(f"--method {options.method}: learns from roll-outs; accepted: one that learns from "
                                   f"demonstrations or by itself")
        self._shown = preset.shown
        self.options, self.out, self.tasks = options, options.out, known[options.rehearsal]
        self.out.mkdir(parents=True, exist_ok=True)
        self._file, self._lock = self.out / "pipeline.json", threading.Lock()
        self._running: set[subprocess.Popen] = set()
        self._asked = {name: getattr(options, name) for name in ("seed", "n", "iterations", "episodes", "material")}
        self._stopped = False
        self.stages = self._earlier()
        self._progress: Any = None

    def _earlier(self) -> dict[str, dict[str, Any]]:
        """What an earlier run of the same folder has finished; nothing where that cannot be read. Raises
        mpm.InvalidValue for one with options that its commands would refuse to go on with."""
        try:
            told = json.loads(self._file.read_text())
            stages = {name: stage for name, stage in told["stages"].items() if stage["state"] == "finished"}
            other = [f"--{name} {told['options'][name]}, now {value}" for name, value in self._asked.items()
                     if told["options"][name] != value]
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            return {}
        if other:
            raise mpm.InvalidValue(f"--out {self.out}: holds a pipeline with {'; '.join(other)}; give another folder")
        return stages

    def run(self) -> int:
        """Everything; returns 0, or 1 where a command failed."""
        for name in ("SIGTERM", "SIGHUP"):  # told to go it stops what it began, as after Ctrl-C
            if signal.getsignal(getattr(signal, name, signal.SIGTERM)) == signal.SIG_DFL:
                signal.signal(getattr(signal, name), signal.default_int_handler)
        lock = claim(self.out)
        self._progress = tqdm(total=2 * len(self.tasks) + 2, unit="command", file=sys.stderr)
        pool = ThreadPoolExecutor(self.options.jobs)  # the commands after them, too: Ctrl-C reaches this thread alone
        try:
            made = list(pool.map(self._learn, self.tasks))
            whole = all(made) and pool.submit(self._carry_out).result()
        finally:
            self._stop()
            pool.shutdown()
            self._progress.close()
            lock.release()
        self._keep(table=self._table())
        print(as_text(self._table()))
        for name, stage in self.stages.items():
            if stage["state"] != "finished":
                print(f"{stage['state']}: {name}: {stage['reason']} (robosim {' '.join(stage['words'])})",
                      file=sys.stderr)
        print(self._file)
        return 0 if whole else 1

    def _stop(self) -> None:
        """Begin nothing more, and let what runs end as after Ctrl-C, with its files whole."""
        with self._lock:
            self._stopped = True
            for process in self._running:
                process.send_signal(signal.SIGINT)

    def _learn(self, task: str) -> bool:
        """Demonstrations and learning of a sub-task."""
        o, material = self.options, [] if self.options.material is None else ["--material", self.options.material]
        demos, runs = self.out / "demonstrations" / task, self._runs(task)
        words = ["demo", task, "--out", str(demos), "--n", str(o.n), "--nominal", "--seed", str(o.seed), "--iterations",
                 str(o.iterations), *BEGINNINGS.get(task, ()), *(["--no-video"] if o.no_video else [])]
        if self._shown and not self._done(f"demonstrations of {task}", words):
            return False
        words = ["train", o.method, task, "--seed", str(o.seed), "--out", str(runs), *material,
                 *(["--demos", str(demos)] if self._shown else []),
                 *([] if o.episodes is None else ["--episodes", str(o.episodes)])]
        if not self._done(f"learning of {task}", words):
            return False
        (self.out / "motions").mkdir(exist_ok=True)
        if not (runs / "best.npz").is_file():
            self._keep(f"learning of {task}", **{**self.stages[f"learning of {task}"], "state": "failed",
                                                 "reason": f"{runs} holds no best.npz: every episode diverged"})
            return False
        write(self.out / "motions" / f"{task}.npz", lambda beside: shutil.copyfile(runs / "best.npz", beside))
        return True

    def _runs(self, task: str) -> Path:
        """Folder of a sub-task's learning."""
        return self.out / "learning" / f"{Path(self.options.method).stem}_{self.options.seed}" / task

    def _carry_out(self) -> bool:
        """The sub-tasks in a row, and the whole arm; neither waits for the other to succeed."""
        o, made = self.options, []
        more = ["--motions", str(self.out / "motions"), *([] if o.material is None else ["--material", o.material]),
                *(["--no-video"] if o.no_video else [])]
        for name, words in (("sub-tasks in a row", ["chain", o.rehearsal, "--out", str(self.out / "chain"), *more]),
                            ("whole arm", ["rehearse", o.rehearsal, "--out", str(self.out / "arm"), "--grasp", o.grasp,
                                           *more])):
            made.append(self._done(name, words))
        return all(made)

    def _done(self, name: str, words: list[str]) -> bool:
        """Run a command unless the same one is finished; whether it is now. Its words go to a file of logs/."""
        earlier = self.stages.get(name)
        if self._stopped:
            return False
        if earlier is None or earlier["words"] != words:
            with self._lock:  # what was made of the old is no longer true
                for later in DOWNSTREAM.get(name.split(" of ")[0], ()):
                    self.stages.pop(later.replace("{task}", name.split(" of ")[-1]), None)
            log = self.out / "logs" / f"{name.replace(' ', '_')}.txt"
            log.parent.mkdir(exist_ok=True)
            self._keep(name, state="running", words=words, reason="was cut short; the same command goes on")
            began = time.time()
            with log.open("a") as file:
                process = self._begun(words, file)
                good = process is not None and process.wait() == 0
                with self._lock:
                    self._running.discard(process)
            last = (log.read_text().strip().splitlines() or ["said nothing"])[-1]
            self._keep(name, state="finished" if good else "failed", words=words, reason="" if good else last,
                       seconds=time.time() - began)
        with self._lock:
            self._progress.update()
        return self.stages[name]["state"] == "finished"

    def _begun(self, words: list[str], file: Any) -> subprocess.Popen | None:
        """A command's process, unless nothing more is to begin."""
        with self._lock:
            if self._stopped:
                return None
            process = subprocess.Popen([sys.executable, "-m", "robosim", *words], stdout=file, stderr=file,
                                       env={**os.environ, "OMP_NUM_THREADS": "1"}, start_new_session=True)
            self._running.add(process)
            return process

    def _keep(self, name: str | None = None, table: list[dict[str, Any]] | None = None, **stage: Any) -> None:
        """Write down how a stage stands."""
        with self._lock:
            if name is not None:
                self.stages[name] = stage
            write_json(self._file, {"rehearsal": self.options.rehearsal, "method": self.options.method,
                                    "options": self._asked,
                                    "stages": self.stages, "sub_tasks": table or []})

    def _table(self) -> list[dict[str, Any]]:
        """A row for each sub-task: score of its demonstration and of the best motion that was learnt, how it went on
        from what the one before had left, and the turn of its tool; the last has the arm's fractions."""
        in_a_row = {row["task"]: row for row in read(self.out / "chain" / "chain.json").get("sub_tasks", [])}
        rows = []
        for task in self.tasks:
            shown = read(self.out / "demonstrations" / task / "demonstrations.json").get("demonstrations", [])
            among = [values["tcs"] for row in shown for where, values in row.items() if where.startswith("among")]
            learnt = read(self._runs(task) / "status.json").get("replayed", {})
            row = in_a_row.get(task, {})
            went = row.get("handed_over", row.get("own_start", {}))
            rows.append({"task": task, "demonstration": max(among, default=None), "learnt": learnt.get("tcs"),
                         "grains": went.get("grains"), "delivered": went.get("delivered"),
                         "turned_deg": went.get("turned_deg"), "relative_turn_error": went.get("relative_turn_error")})
        arm = read(self.out / "arm" / "report.json")
        return [*rows, {"task": "whole arm", **{key: arm.get(key) for key in (
            "scooped_mass", "delivered_fraction", "spilled_fraction")}}]


def read(path: Path) -> dict[str, Any]:
    """A table from a JSON file; empty where there is none."""
    return json.loads(path.read_text()) if path.is_file() else {}


def as_text(rows: list[dict[str, Any]]) -> str:
    """The table, for a terminal."""
    def cell(value: Any, form: str) -> str:
        return "-" if value is None else form.format(value)

    lines = [["sub-task", "demonstration", "learnt", "grains", "delivered", "turned [deg]", "off by"]]
    lines += [[row["task"], cell(row["demonstration"], "{:.2f}"), cell(row["learnt"], "{:.2f}"),
               cell(row["grains"], "{}"), cell(row["delivered"], "{:.3f}"), cell(row["turned_deg"], "{:.1f}"),
               cell(row["relative_turn_error"], "{:.1%}")] for row in rows[:-1]]
    arm = rows[-1]
    told = f"whole arm: {cell(arm['scooped_mass'], '{:.4f} kg')} taken up, " \
           f"{cell(arm['delivered_fraction'], '{:.3f}')} delivered, {cell(arm['spilled_fraction'], '{:.3f}')} spilled"
    return f"{aligned(lines)}\n{told}"
