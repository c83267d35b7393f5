"""The record: starts the processes of the groups, and writes what they say after each case."""

import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from importlib.metadata import version
from pathlib import Path
from typing import Any

from groups import GROUPS, MARK

LIBRARIES = ("taichi", "mujoco", "pin", "ruckig", "numpy", "scipy", "trimesh", "gymnasium")
SCRIPT = (sys.executable, str(Path(__file__).resolve().parent))
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


def make_record(out: Path, tree: Path, choice: list[str], again: bool) -> int:
    """Run the cases that a file lacks, and write it; returns 1 where one has failed.

    tree: checkout whose code is run. choice: arguments that say which cases. again: run cases that the file has.
    """
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
    begin, failed = time.perf_counter(), 0
    with tempfile.TemporaryDirectory() as caches:
        environment |= {"ROBOSIM_CACHE": f"{caches}/starts", "MPM_CACHE": f"{caches}/distances", "TMPDIR": caches}
        for group in GROUPS:
            names = [name for name in chosen if name.startswith(f"{group}/") and (again or name not in record["cases"])]
            while names:  # a process that ends early has its case recorded, and another goes on
                for name, result in run_process(group, names, environment, tree):
                    record["cases"][name] = result
                    write(out, record)
                    names.remove(name)
                    failed += "error" in result
                    print(f"{result['seconds']:7.1f} s, {result.get('cpu_seconds', 0.0):.1f} s of processor: {name} "
                          f"{result.get('error', '')}", flush=True)
    print(f"{len(record['cases'])} cases in {out.name}, {failed} failed; {time.perf_counter() - begin:.0f} s")
    return int(failed > 0)


def run_process(group: str, names: list[str], environment: dict[str, str], tree: Path) -> Any:
    """Run cases in a process of their own; yield names and results until it ends, however it does."""
    command = [*SCRIPT, "--group", group, *names]
    running = None
    with subprocess.Popen(command, cwd=tree, env=environment, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        for line in process.stdout:
            if line.startswith(MARK):
                message = json.loads(line.removeprefix(MARK))
                running = message.get("began")
                if "ended" in message:
                    yield message.pop("ended"), message
    if running or process.returncode:
        yield running or names[0], {"values": {}, "error": f"the process ended with {process.returncode}", "seconds": 0}


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
    return {"code": commit + (" with changes" if changes else ""),
            "versions": {name: version(name) for name in LIBRARIES} | {"python": platform.python_version()},
            "machine": processor()}


def processor() -> str:
    """Return the name of the processor, whose instructions compiled kernels use."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), "")


def write(out: Path, record: dict[str, Any]) -> None:
    """Write the record in one go, so that an interruption leaves a complete one."""
    part = out.with_suffix(".part")
    part.write_text(json.dumps(record, indent=0))
    part.replace(out)
