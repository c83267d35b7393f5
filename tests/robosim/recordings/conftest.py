"""Recordings that are closed after a test."""

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from robosim.recordings.reader import Recording


@pytest.fixture
def opened() -> Iterator[Callable[[Path], Recording]]:
    """Opens recordings that are closed after the test."""
    with contextlib.ExitStack() as stack:
        yield lambda path: stack.enter_context(Recording(path))
