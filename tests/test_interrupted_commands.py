"""Commands that are killed, interrupted or meet a full disk at random moments, then the same command again."""

import contextlib
import os
import random
import re
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

import pytest
import yaml
from bundled import write_short
from result_files import Broken, check_files, find_unfinished, read_status

LATEST = 600.0
"""Time [s] after which a command is taken to hang."""
EARLIEST = 0.1
"""Work [s] of the interpreter's own start and the package's import: Ctrl-C prints a traceback until they are done."""
MOMENTS = 20
"""Of each command, drawn with its name as seed: as many of each way to end it."""
SIGNALS = {"killed": signal.SIGKILL, "SIGTERM": signal.SIGTERM, "Ctrl-C": signal.SIGINT}
WAYS = {
    "killed": {-signal.SIGKILL: {"running", "finished", None}}, "full": {1: {"failed", None}}, **{way: {
        128 + SIGNALS[way]: {"interrupted", None}, -SIGNALS[way]: {None, "finished"}} for way in ("SIGTERM", "Ctrl-C")}}
"""Way to end a command -> exit status -> states in status.json; None: it had not begun, or a full disk took no status;
"finished": it had only to leave. full: from then on no process of it can write to a file."""
CHANGING = re.compile(rb'"\w*(_s|seconds|factor|process)": .*')
"""Lines of a table that differ from run to run."""
NET = "--set options.batch_size=16 --set options.policy_kwargs.net_arch=[8,8]"
SWEEP = {"tasks": ["Pendulum-v1"], "methods": ["sac"], "seeds": [0, 1], "episodes": 2, "out": "out",
         "options": ["--set", "options.policy_kwargs.net_arch=[8]"]}
LAB = {"description": "sugar", "material": "sugar", "sought": {"friction_angle_deg": [25, 45], "density": [700, 1000]},
       "experiments": {"cup": {"kind": "cup", "volume": 1e-4, "noise": 5e-4, "masses": [0.086, 0.0865]}, "tall": {
           "kind": "heap", "data": "heap.csv", "unit": "mm", "noise": 0.002, "radius": 0.02, "height": 0.02,
           "floor_friction": 0.5, "cells": 4}}}


class Trial(NamedTuple):
    """A command, with "out" for its folder, the files that are the same however it came to its end, and its status."""

    words: str
    results: tuple[str, ...]
    status: int = 0


TRIALS = {
    "rehearse": Trial("rehearse short.yaml --frame-rate 10 --height 144 --out out",
                      ("report.json", "trajectory.csv", "config.yaml"), 1),
    "train": Trial(f"train sac Pendulum-v1 --episodes 5 --checkpoint-every 2 {NET} --out out",
                   ("best.npz", "status.json")),
    "sweep": Trial("sweep sweep.yaml --jobs 2 --set out=out", ("*/*/*/status.json", "*/*/*/best.npz", "sweep.json")),
    "calibrate": Trial("calibrate lab.yaml --runs 10 --out out", ("calibration.json", "material.yaml")),
    "evaluate": Trial("evaluate SpoonTranslate --policy random --episodes 2 --out out", ("evaluation.json",)),
    "demo": Trial("demo SpoonTranslate --n 1 --iterations 2 --action-repeat 100 --no-video --out out",
                  ("demonstration_0.npz", "demonstrations.json"), 1),
    "tune": Trial("tune DoseSpoon --choices 2 --episodes 1 --controller open_loop --set grains.count=100 "
                  "--set dose.target_g=[1,2] --out out", ("tune.json", "numbers.yaml")),
    "film": Trial("film ../recorded --height 144 --out out", ("episode.mp4",)),
}


def prepare(folder: Path) -> Path:
    """Make a folder with the files that commands take."""
    folder.mkdir()
    write_short(folder / "short.yaml")
    (folder / "sweep.yaml").write_text(yaml.safe_dump(SWEEP))
    (folder / "lab.yaml").write_text(yaml.safe_dump(LAB))
    (folder / "heap.csv").write_text("r,z\n" + "".join(f"{r},{max(0.0, 16 - 0.45 * r):.2f}\n" for r in range(45)))
    return folder


def run(words: str, folder: Path, moment: float = LATEST, way: str = "") -> tuple[int, str]:
    """Run a command and end it in a way after some work [s]; return its exit status and what it said."""
    process = subprocess.Popen([sys.executable, "-m", "robosim", *words.split()], stdout=subprocess.PIPE,
                               stderr=subprocess.STDOUT, text=True, cwd=folder)
    while way and process.poll() is None and measure_work(process.pid) < moment:
        time.sleep(0.005)
    if way == "full":
        for child in list_processes(process.pid):
            with contextlib.suppress(OSError):
                resource.prlimit(child, resource.RLIMIT_FSIZE, (0, resource.RLIM_INFINITY))
    elif way:
        process.send_signal(SIGNALS[way])
    said, _ = process.communicate(timeout=LATEST)
    return process.returncode, said


def list_processes(process: int) -> list[int]:
    """Return a process and all that it has started."""
    try:
        children = Path(f"/proc/{process}/task/{process}/children").read_text().split()
    except OSError:
        return []
    return [process, *(one for child in children for one in list_processes(int(child)))]


def measure_work(process: int) -> float:
    """Return the time [s] that a process, all that it has started and what has ended of them took of processors."""
    total = 0
    for one in list_processes(process):
        with contextlib.suppress(OSError):  # it has ended
            total += sum(map(int, Path(f"/proc/{one}/stat").read_text().rpartition(")")[2].split()[11:15]))
    return total / os.sysconf("SC_CLK_TCK")


def read_results(folder: Path, kind: str) -> dict[str, bytes]:
    """Return what a command's results hold by the names of their files."""
    return {str(path.relative_to(folder)): CHANGING.sub(b"", path.read_bytes()) for pattern in TRIALS[kind].results
            for path in (folder / "out").glob(pattern)}


def find_faults(folder: Path, code: int, said: str, *expected: dict[int, set[str | None]]) -> list[str]:
    """Return what is wrong after a command has ended: exit status, status.json, and files."""
    out, state, faults = folder / "out", read_status(folder / "out"), []
    if not any(state in one.get(code, ()) for one in expected):
        faults.append(f"exit status {code}, status.json: {state}")
    if "Traceback" in said or "ignored" in said:
        faults.append("a traceback")
    try:
        check_files(out)
        faults += [f"left {name}" for name in find_unfinished(out)  # a recording is read as far as it goes
                   if code != -signal.SIGKILL and not (code == 1 and name.endswith(".rec.part"))]
    except Broken as error:
        faults.append(str(error))
    return [f"{fault}: {said[-1500:]}" for fault in faults]


@pytest.mark.slow
@pytest.mark.parametrize("kind", TRIALS)
def test_a_command_ends_as_undisturbed_whatever_ended_it_before(tmp_path: Path, kind: str) -> None:
    """Exit status and status.json agree, files are whole, no traceback; then the same command has the same results."""
    words, results, status = TRIALS[kind]
    whole, draw, faults, expected = {status: {"finished"}}, random.Random(kind), list[str](), list[dict[str, bytes]]()
    if kind == "film":
        assert run(f"{TRIALS['evaluate'].words} --no-video".replace(" out", " recorded"), tmp_path)[0] == 0
    for name in ("compiles", "whole"):
        undisturbed, before = prepare(tmp_path / name), resource.getrusage(resource.RUSAGE_CHILDREN)
        assert not find_faults(undisturbed, *run(words, undisturbed), whole)
        after, expected = resource.getrusage(resource.RUSAGE_CHILDREN), [*expected, read_results(undisturbed, kind)]
    assert expected[0] == expected[1] and len(expected[0]) >= len(results)
    work = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    for k in range(MOMENTS):
        way, moment, folder = list(WAYS)[k % len(WAYS)], draw.uniform(EARLIEST, work), prepare(tmp_path / str(k))
        found = find_faults(folder, *run(words, folder, moment, way), WAYS[way], whole)
        found += [f"again: {fault}" for fault in find_faults(folder, *run(words, folder), whole)]
        if read_results(folder, kind) != expected[0]:
            found.append("other results")
        faults += [f"{way} after {moment:.2f} of {work:.1f} s: {fault}" for fault in found]
    assert not faults, "\n\n".join(faults)
