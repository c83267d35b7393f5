"""The pipeline from nothing to the whole arm's motion, a command after the other.
Demonstrations and training of every sub-task, the recorded sub-tasks in sequence, and the whole arm, each in a folder
of its own. Source: arXiv 2406.09178, Algorithm 1."""

import argparse
import shutil
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import mpm
from mpm.files import write
from policies.learning.names import check_installed
from policies.learning.options import to_words
from policies.learning.presets import load_preset
from robosim.base.files import write_json
from robosim.base.input_files import read_json
from robosim.base.jobs import read_last_line, start_command
from robosim.base.output_folder import OutputFolder, is_locked
from robosim.base.progress import Progress
from robosim.base.resources import folder
from robosim.config.table import read

DEMO_ARGUMENTS = {"SpoonScoop": ("--from", "script", "--until", "0.75", "--rate", "0.03"),
                  "ScoopScoop": ("--from", "script", "--rate", "0.01"),
                  "ScoopTranslate": ("--rate", "0.03"),
                  "SpoonPour": ("--from", "script", "--rate", "0.02"),
                  "ScoopPour": ("--from", "script", "--rate", "0.02")}
"""Arguments of `robosim demo` by task. Scooping begins with the script, because the tool must touch its material first;
pouring, because a descent from rest finds pours that the hand obstructs. ScoopTranslate stops short of its target at
the default rate."""
SEQUENCE, ARM = "sub-tasks in sequence", "whole arm"
DEPENDENTS = {"demonstrations": ("training of {task}", SEQUENCE, ARM), "training": (SEQUENCE, ARM)}
"""Kind of stage -> the stages that use its result."""
POLL = 0.5
"""Time [s] between two looks at a folder's lock."""


def recorded_rehearsals() -> dict[str, list[str]]:
    """Return the sub-tasks of every bundled rehearsal that has recorded ones."""
    paths = sorted((folder("configs") / "rehearsals").glob("*.yaml"))
    tasks = {path.stem: read(path).get("recorded", []) for path in paths}
    return {name: names for name, names in tasks.items() if names}


class Pipeline:
    """Runs the stages of a pipeline that are not finished; pipeline.json has the state of each.
    options: of `robosim pipeline`; its commands refuse folders that hold results of others. Raises mpm.InvalidValue for
    a wrong option."""

    def __init__(self, options: argparse.Namespace) -> None:
        check_installed()  # before the first demonstrations, which need less
        rehearsals = recorded_rehearsals()
        if options.rehearsal not in rehearsals:
            raise mpm.InvalidValue(f"rehearsal {options.rehearsal!r}; accepted: {', '.join(rehearsals)}")
        preset = load_preset(options.method)
        if preset.needs_rollouts:
            raise mpm.InvalidValue(f"--method {options.method}: learns from rollouts; accepted: one that learns from "
                                   f"demonstrations or by itself")
        self._needs_demonstrations = preset.needs_demonstrations
        self.options, self.out = options, options.out
        self.tasks = options.settings.apply({"recorded": rehearsals[options.rehearsal]})["recorded"]
        self.out.mkdir(parents=True, exist_ok=True)
        self._file, self._lock = self.out / "pipeline.json", threading.Lock()
        self._processes: set[subprocess.Popen] = set()
        self._is_stopped = False
        self.stages = self._load_finished()
        self._progress: Any = None

    def _load_finished(self) -> dict[str, dict[str, Any]]:
        """Return the stages that earlier calls have finished; none where their file cannot be read."""
        try:
            return {name: stage for name, stage in read_json(self._file)["stages"].items()
                    if stage["state"] == "finished"}
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            return {}

    def run(self) -> int:
        """Run all stages; return 0, or 1 where one failed."""
        with OutputFolder(self.out) as folder:
            self._progress = Progress(total=2 * len(self.tasks) + 2, desc="pipeline", unit="commands")
            pool = ThreadPoolExecutor(self.options.jobs)  # for all stages: this thread stays free to receive Ctrl-C
            try:
                has_motions = list(pool.map(self._learn, self.tasks))
                is_complete = all(has_motions) and pool.submit(self._execute).result()
            finally:
                with self._lock:  # nothing more is started, and what runs is interrupted
                    self._is_stopped = True
                    for process in self._processes:
                        process.terminate()
                pool.shutdown()
                self._progress.close()
            folder.failures += [f"{name}: {one['reason']}" for name, one in self.stages.items()
                                if one["state"] != "finished"]
        for name, stage in self.stages.items():
            if stage["state"] != "finished":
                print(f"{stage['state']}: {name}: {stage['reason']} (robosim {' '.join(stage['arguments'])})",
                      file=sys.stderr)
        print(self._file)
        return 0 if is_complete else 1

    def _learn(self, task: str) -> bool:
        """Make a sub-task's demonstrations and train on them; return whether there is a recorded motion."""
        o, training = self.options, f"training of {task}"
        folder = self.out / "learning" / f"{Path(o.method).stem}_{o.seed}" / task
        demos = self.out / "demonstrations" / task if self._needs_demonstrations else None
        if demos is not None and not self._run_stage(f"demonstrations of {task}", [
                "demo", task, *to_words(out=demos, n=o.n, nominal=True, seed=o.seed, iterations=o.iterations),
                *DEMO_ARGUMENTS.get(task, ()), *to_words(no_video=o.no_video)]):
            return False
        if not self._run_stage(training, ["train", o.method, task, *to_words(
                seed=o.seed, out=folder, material=o.material, demos=demos, episodes=o.episodes)]):
            return False
        (self.out / "motions").mkdir(exist_ok=True)
        if not (folder / "best.npz").is_file():
            self._store(training, **{**self.stages[training], "state": "failed",
                                     "reason": f"{folder} has no best.npz: every episode diverged"})
            return False
        write(self.out / "motions" / f"{task}.npz", lambda path: shutil.copyfile(folder / "best.npz", path))
        return True

    def _execute(self) -> bool:
        """Run the sub-tasks in sequence, and the whole arm, even if the sequence failed."""
        o = self.options
        stages = {SEQUENCE: ["chain", o.rehearsal, *to_words(out=self.out / "chain")],
                  ARM: ["rehearse", o.rehearsal, *to_words(out=self.out / "arm", grasp=o.grasp)]}
        shared = [*to_words(motions=self.out / "motions", material=o.material, no_video=o.no_video),
                  *o.settings.arguments]
        results = [self._run_stage(name, [*arguments, *shared]) for name, arguments in stages.items()]
        return all(results)

    def _run_stage(self, name: str, arguments: list[str]) -> bool:
        """Run a command unless the same one is finished; return whether it is finished now.
        Its output is appended to a file of logs/. Stages that use its result are no longer finished."""
        stage = self.stages.get(name)
        if self._is_stopped:
            return False
        if stage is None or stage.get("arguments") != arguments:
            with self._lock:
                for dependent in DEPENDENTS.get(name.split(" of ")[0], ()):
                    self.stages.pop(dependent.replace("{task}", name.split(" of ")[-1]), None)
            log = self.out / "logs" / f"{name.replace(' ', '_')}.txt"
            log.parent.mkdir(exist_ok=True)
            self._store(name, state="running", arguments=arguments, reason="interrupted; the same command continues")
            began = time.time()
            while is_locked(Path(arguments[arguments.index("--out") + 1])) and not self._is_stopped:
                time.sleep(POLL)  # a killed pipeline has left this stage's process
            with log.open("a") as file:
                with self._lock:
                    process = None if self._is_stopped else start_command(arguments, file)
                    if process is not None:
                        self._processes.add(process)
                is_finished = process is not None and process.wait() == 0
                with self._lock:
                    self._processes.discard(process)
            last_line = read_last_line(log) or "no output"
            state = "finished" if is_finished else "interrupted" if self._is_stopped else "failed"
            self._store(name, state=state, arguments=arguments,
                        reason="" if is_finished else last_line, seconds=time.time() - began)
        with self._lock:
            self._progress.update()
        return self.stages[name]["state"] == "finished"

    def _store(self, name: str, **stage: Any) -> None:
        """Write pipeline.json, with a new state of a stage."""
        with self._lock:
            self.stages[name] = stage
            write_json(self._file, {"rehearsal": self.options.rehearsal, "method": self.options.method,
                                    "stages": self.stages})
