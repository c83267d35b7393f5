"""The record: what its bits depend on, and the processes of the groups, which add their cases to it."""

import json
import os
import platform
import re
import subprocess
import sys
import tempfile
import time
from importlib.metadata import version
from pathlib import Path
from typing import Any

from groups import GROUPS, write

LIBRARIES = ("taichi", "mujoco", "pin", "ruckig", "numpy", "scipy", "trimesh", "gymnasium")
SCRIPT = (sys.executable, str(Path(__file__).resolve().parent))
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


def make_record(out: Path, tree: Path, choice: list[str], again: bool) -> int:
    """Run the cases that a file lacks, and write it; returns 1 where one has failed.

    tree: checkout whose code is run. choice: arguments that say which cases. again: run cases that the file has."""
    environment = os.environ | ONE_THREAD | {
        "PYTHONPATH": str(tree), "PYTHONHASHSEED": "0", "PYTHONDONTWRITEBYTECODE": "1"}
    environment.setdefault("TI_OFFLINE_CACHE_FILE_PATH", str(Path(tempfile.gettempdir()) / "states_kernels"))
    head = describe(tree, environment)
    record = json.loads(out.read_text()) if out.is_file() else {**head, "cases": {}}
    if record["code"] != head["code"]:
        print(f"{out.name} is of {record['code']}, and the code is {head['code']}; accepted: a new file")
        return 2
    chosen = subprocess.run([*SCRIPT, "--list", *choice], cwd=tree, env=environment, stdout=subprocess.PIPE, text=True,
                            check=True).stdout.splitlines()
    record["cases"] = {name: case for name, case in record["cases"].items() if not again or name not in chosen}
    write(out, record)
    begin, asked = time.perf_counter(), [name for name in chosen if name not in record["cases"]]
    with tempfile.TemporaryDirectory() as caches:
        environment |= {"ROBOSIM_CACHE": f"{caches}/starts", "MPM_CACHE": f"{caches}/distances", "TMPDIR": caches}
        for group in GROUPS:
            while names := [name for name in asked if name.startswith(f"{group}/") and name not in record["cases"]]:
                done = subprocess.run([*SCRIPT, str(out), "--run", *names], cwd=tree, env=environment)
                record = json.loads(out.read_text())
                if lost := [name for name in names if name not in record["cases"]]:  # another process takes the rest
                    record["cases"][lost[0]] = {"values": {}, "error": f"the process ended with {done.returncode}"}
                    write(out, record)
    failed = sum("error" in record["cases"][name] for name in asked)
    print(f"{len(record['cases'])} cases in {out.name}, {failed} failed; {time.perf_counter() - begin:.0f} s")
    return int(failed > 0)


def describe(tree: Path, environment: dict[str, str]) -> dict[str, Any]:
    """Return what the bits depend on: code, versions, machine; raises RuntimeError where another tree is imported."""
    code = "import mpm, robosim, policies; print(mpm.__file__, robosim.__file__, policies.__file__, sep='\\n')"
    found = subprocess.run([sys.executable, "-c", code], cwd=tree, env=environment, capture_output=True, text=True,
                           check=True).stdout.split()
    strangers = [path for path in found if not Path(path).resolve().is_relative_to(tree)]
    if strangers:
        raise RuntimeError(f"{strangers} are imported, which are not in {tree}")
    commit, changes = (subprocess.run(["git", "-C", str(tree), *rest], capture_output=True, text=True).stdout.strip()
                       for rest in (("rev-parse", "--short", "HEAD"),
                                    ("status", "--porcelain", "--", "mpm", "robosim", "policies", "configs", "models")))
    cpu = re.search(r"model name\s*: (.*)", Path("/proc/cpuinfo").read_text())  # its instructions are compiled for
    return {"code": commit + (" with changes" if changes else ""),
            "versions": {name: version(name) for name in LIBRARIES} | {"python": platform.python_version()},
            "machine": cpu[1] if cpu else ""}
