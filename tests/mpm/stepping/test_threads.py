"""Several threads, or a GPU, give what one thread gives; each in a process of its own, which has one backend."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import mpm
from mpm.errors import BackendError

SCRIPT = Path(__file__).with_name("several_threads.py")


def compare(*words: str) -> Any:
    """Run `several_threads.py`; return what it prints."""
    done = subprocess.run([sys.executable, SCRIPT, *words], capture_output=True, text=True)
    if "this machine has none" in done.stderr:
        pytest.skip(f"no GPU: {done.stderr.strip().splitlines()[-1]}")
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.fixture(scope="module")
def elastic() -> Any:
    """What two threads compute, and what they refuse."""
    return compare("elastic")


@pytest.mark.parametrize("material", ["elastic", pytest.param("fluid", marks=pytest.mark.slow)])
def test_two_threads_are_one(material: str, elastic: Any) -> None:
    """The same grains to rounding, the same bits in every run, and every impulse in the ledger; in strides and not."""
    scene = elastic if material == "elastic" else compare(material)
    assert scene["shared"] and scene["same_bits"]
    assert scene["moved"] > 0.02 and scene["ball_pushed"] > 0.1 and scene["post_pushed"] > 0.1
    assert scene["off_one_thread"] < 1e-12
    assert scene["ledger_off"] < 1e-13 and scene["gap"] < 1e-13
    assert scene["readings_off"] < 1e-12


@pytest.mark.parametrize("material", ["elastic", pytest.param("fluid", marks=pytest.mark.slow)])
@pytest.mark.parametrize("where", ["cuda", pytest.param("atomics", marks=pytest.mark.slow)])
def test_a_gpu_is_one_thread(where: str, material: str) -> None:
    """The same particles and the same ledger to rounding; a GPU adds in any order.

    What is compiled for a GPU also runs on the CPU, where it can be checked without one.
    """
    scene = compare(where, material)
    assert scene["shared"] and scene["moved"] > 0.02 and scene["ball_pushed"] > 0.1
    assert scene["off_one_thread"] < 1e-10 and scene["readings_off"] < 1e-10
    assert scene["gap"] < 1e-12


def test_what_one_thread_alone_does_is_refused_by_name(elastic: Any) -> None:
    """A batch and a rollout take a solver of one thread; a shell in a process of two threads has one."""
    assert elastic["refusals"] == [True, "Batch: the solver has several threads; accepted: one of mpm.init(threads=1)",
                                   "Rollout: the solver has several threads; accepted: one of mpm.init(threads=1)"]


def test_another_session_is_refused() -> None:
    """A process has one backend, and who asks for nothing takes it; a number of threads below one is none."""
    mpm.init()
    mpm.init(threads=1)
    with pytest.raises(BackendError, match="a process has one backend"):
        mpm.init(threads=2)
    with pytest.raises(mpm.InvalidValue, match="threads = 0; accepted: 1 or more"):
        mpm.init(threads=0)
