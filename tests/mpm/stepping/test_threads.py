"""Several threads, or a GPU, give what one thread gives; each in a process of its own, which has one backend."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import mpm
from mpm.errors import BackendError

SCRIPT = Path(__file__).with_name("several_threads.py")
SOFTWARE = Path("/usr/share/vulkan/icd.d/lvp_icd.x86_64.json")
"""The driver of Vulkan's software device in Debian's mesa-vulkan-drivers."""
SLOW = pytest.mark.slow
Results = dict[str, np.ndarray]


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Results]:
    """Runs `several_threads.py`, once for the same words; returns what it wrote."""
    folder, known = tmp_path_factory.mktemp("threads"), {}

    def get(*words: str) -> Results:
        if words not in known:
            out, environment = folder / f"{'_'.join(words)}.npz", dict(os.environ)
            if words[0] == "vulkan" and SOFTWARE.exists():
                environment["VK_ICD_FILENAMES"] = str(SOFTWARE)
            done = subprocess.run([sys.executable, SCRIPT, *words[:2], out, *words[2:]], capture_output=True, text=True,
                                  env=environment)
            if "this machine has none" in done.stderr:
                pytest.skip(f"{done.stderr.strip().splitlines()[-1]} (software device: apt install libvulkan1 "
                            f"mesa-vulkan-drivers)")
            assert done.returncode == 0, done.stderr
            known[words] = dict(np.load(out))
        return known[words]

    return get


def off(one: Results, other: Results, *names: str) -> float:
    """The largest difference of arrays, each over its own largest value."""
    found = [float(np.abs(one[n] - other[n]).max() / (np.abs(other[n]).max() or 1.0)) for n in names if other[n].size]
    return max(found, default=0.0)


def gap(result: Results) -> float:
    """What the ledger misses of the change of momentum, over its largest entry."""
    return float(np.abs(result["gap"]).max() / np.abs(result["ledger"]).max())


@pytest.mark.slow
@pytest.mark.parametrize("scene", ["elastic", "tools", "fluid", "sleep"])
def test_two_threads_are_one(scene: str, results: Callable[..., Results]) -> None:
    """The same grains to rounding, the same bits in every run, and every impulse in the ledger; in strides and not.
    "tools": a shell and a ball that grains move, and periodic sides."""
    two, one = results("two", scene), results("one", scene)
    assert one["serial"] and not two["serial"] and two["same_bits"]
    assert np.abs(two["x"] - two["start"]).max() > 0.02 and np.abs(two["ledger"][2:4]).max(axis=1).min() > 0.01
    assert off(two, one, *two["names"]) < 1e-11
    assert off(two, one, "ledger", "read") < 1e-11 and gap(two) < 1e-13
    assert "substep 1:" in str(one["diverged"]) and str(two["diverged"]) == str(one["diverged"])


@pytest.mark.parametrize("scene", ["elastic", pytest.param("fluid", marks=SLOW)])
@pytest.mark.parametrize("where", ["cuda", pytest.param("atomics", marks=SLOW)])
def test_a_gpu_is_one_thread(where: str, scene: str, results: Callable[..., Results]) -> None:
    """The same particles and the same ledger to rounding; a GPU adds in any order.
    What is compiled for a GPU also runs on the CPU, where it can be checked without one."""
    gpu, one = results(where, scene), results("one", scene)
    assert np.abs(gpu["x"] - gpu["start"]).max() > 0.02 and np.abs(gpu["ledger"][3]).max() > 0.1
    assert off(gpu, one, *gpu["names"], "read") < 1e-10 and gap(gpu) < 1e-12


@pytest.mark.parametrize("where", ["cuda", pytest.param("atomics", marks=SLOW)])
def test_a_gpu_moves_tools_as_one_thread(where: str, results: Callable[..., Results]) -> None:
    """Particles that enter a tool are stopped one after the other, as each moves it."""
    gpu, one = results(where, "tools"), results("one", "tools")
    assert off(gpu, one, "x", "twists") < 1e-9 and gap(gpu) < 1e-12


@SLOW
@pytest.mark.parametrize("scene", ["elastic", "fluid", "tools"])
def test_vulkan_is_one_thread(scene: str, results: Callable[..., Results]) -> None:
    """In single precision, all that Vulkan has functions for; on a software device where there is no other."""
    gpu, one = results("vulkan", scene), results("one", scene, "f32")
    assert np.abs(gpu["x"] - gpu["start"]).max() > 0.02 and np.abs(gpu["x"] - one["x"]).mean() < 1e-5
    assert off(gpu, one, "ledger") < 1e-3 and off(gpu, one, "twists") < 1e-2 and gap(gpu) < 1e-4


def test_double_precision_is_refused_on_vulkan() -> None:
    done = subprocess.run([sys.executable, "-c", "import mpm; mpm.init(arch='vulkan', precision='f64')"],
                          capture_output=True, text=True)
    assert "arch = 'vulkan' with precision = 'f64'; accepted: 'f32'" in done.stderr


@pytest.mark.long
def test_what_one_thread_alone_does_is_refused_by_name(results: Callable[..., Results]) -> None:
    """A batch and a rollout take a solver of one thread."""
    assert list(results("two", "elastic")["refusals"]) == [
        "Batch: the solver has several threads; accepted: one of mpm.init(threads=1)",
        "Rollout: the solver has several threads; accepted: one of mpm.init(threads=1)"]


def test_one_thread_goes_on_alone_where_others_are_kept_from_their_core() -> None:
    """Two threads on one core end soon, with the same bits as those that have a core each."""
    code = """import hashlib, os, sys, mpm
mpm.init(threads=2, fast_math=False)
block = mpm.sample_box((0, 0, 0), (0.1, 0.1, 0.1), 0.01)
solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.2, 0.2, 0.2), 0.02),
                    bodies=[mpm.Body(mpm.Elastic(E=1e5, nu=0.2, density=1e3), block, volume=1e-6)])
solver.compile()
for thread in os.listdir("/proc/self/task"):
    os.sched_setaffinity(int(thread), {int(core) for core in sys.argv[1].split(",")})
left_alone = 0
for _ in range(20):
    solver.advance(2e-3)
    left_alone = max(left_alone, solver.loop.stepper.numbers[2])
print(left_alone, hashlib.sha256(solver.positions()).hexdigest())"""
    cores = sorted(os.sched_getaffinity(0))
    kept = subprocess.run([sys.executable, "-c", code, str(cores[0])], capture_output=True, text=True, timeout=300)
    free = subprocess.run([sys.executable, "-c", code, ",".join(map(str, cores))], capture_output=True, text=True)
    assert kept.returncode == free.returncode == 0, kept.stderr + free.stderr
    assert kept.stdout.split()[0] == "1" and kept.stdout.split()[1] == free.stdout.split()[1]


def test_another_session_is_refused() -> None:
    """A process has one backend, and who asks for nothing takes it; a number of threads below one is none."""
    mpm.init()
    mpm.init(threads=1)
    with pytest.raises(BackendError, match="a process has one backend"):
        mpm.init(threads=2)
    with pytest.raises(mpm.InvalidValue, match="threads = 0; accepted: 1 or more"):
        mpm.init(threads=0)
