"""Forked processes and second threads are refused or work; nothing waits for ever, and the first process stays good."""

import json
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

import mpm

SCRIPT = Path(__file__).with_name("other_owners.py")


def run(case: str) -> Any:
    done = subprocess.run([sys.executable, str(SCRIPT), case], capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.fixture(scope="module")
def forked() -> Any:
    return run("fork")


@pytest.mark.long
def test_a_forked_process_uses_the_field_as_its_parent_does(forked: Any) -> None:
    """Also one forked from it; a shape that the parent made is copied to a field of its own."""
    child, parent = forked["child"], forked["parent"]
    assert child["own"] == child["grandchild"][0] == parent


@pytest.mark.long
def test_a_forked_process_ends(forked: Any) -> None:
    """Used or not, at the interpreter's exit as well: Taichi would wait there for threads that it does not have."""
    assert forked["status"] == 0 and forked["unused"] == [0, 0]
    assert forked["child"]["grandchild"][1] == 0


@pytest.mark.long
def test_a_forked_process_cannot_use_what_its_parent_made(forked: Any) -> None:
    """Neither before it has started the backend again nor after."""
    for refused in forked["child"]["refused"]:
        for use, message in refused.items():
            assert message.startswith("BackendError: "), f"{use}: {message}"
            assert 'context="spawn"' in message and "make_vec" in message


def test_a_process_forked_by_another_thread_is_refused() -> None:
    """It may have been forked in the middle of a launch."""
    result = run("fork_in_thread")
    assert result["child"].startswith("BackendError: ") and 'context="spawn"' in result["child"]
    assert result["status"] == 0 and "Error" not in result["parent"]


def test_a_second_thread_is_refused_and_changes_nothing() -> None:
    """Before the main thread has used the field, and after."""
    result = run("thread")
    assert result["first"].startswith("BackendError: thread 'second'") and "mpm.init()" in result["first"]
    for use, message in result["refused"].items():
        assert message.startswith("BackendError: thread 'second'"), f"{use}: {message}"
        assert "MainThread" in message and 'context="spawn"' in message
    assert result["before"] == result["after"]


def test_a_thread_that_calls_init_owns_the_field() -> None:
    result = run("init_in_thread")
    assert "Error" not in result["own"]
    for message in result["main"]:
        assert message.startswith("BackendError: thread 'MainThread'") and "'second'" in message


def test_init_is_refused_in_a_second_thread() -> None:
    """A call that would do nothing, too: what follows it in that thread could not work."""
    with ThreadPoolExecutor() as pool, pytest.raises(mpm.BackendError):
        pool.submit(mpm.init).result()
