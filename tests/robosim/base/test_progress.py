"""Progress of long work where stderr is no terminal: few lines, each whole, with an estimate that is right."""

import io
import re
import sys
from collections.abc import Callable

import pytest

from robosim.base import progress
from robosim.base.progress import LINE_INTERVAL, Progress

Work = Callable[..., list[tuple[float, str]]]


class Clock:
    """A clock that the work moves."""

    def __init__(self) -> None:
        self.now = 1000.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def work(monkeypatch: pytest.MonkeyPatch) -> Work:
    """Return what does work of some parts, whose times [s] are given, and what it prints with the time of each line."""
    def do(times: list[float], **options: object) -> list[tuple[float, str]]:
        clock, out, lines = Clock(), io.StringIO(), []
        monkeypatch.setattr(sys, "stderr", out)
        monkeypatch.setattr(Progress, "monitor_interval", 0)
        bar = Progress(total=len(times), desc="work", unit="parts", **options)
        bar._time, bar.start_t, bar.last_print_t = clock, clock.now, clock.now
        for time in times:
            before = len(out.getvalue())
            clock.now += time
            bar.set_postfix(now=f"{clock.now:.1f}")
            bar.update()
            lines += [(clock.now - 1000.0, line) for line in out.getvalue()[before:].splitlines()]
        bar.close()
        assert "\r" not in out.getvalue() and out.getvalue().endswith("\n")
        return [*lines, (clock.now - 1000.0, out.getvalue().splitlines()[-1])]

    return do


@pytest.mark.parametrize("slower", [1.0, 1.5])
def test_the_time_left_is_right_within_a_factor_of_two(slower: float, work: Work) -> None:
    """Also where the parts of the second half take longer than those of the first."""
    times = [2.0] * 200 + [2.0 * slower] * 200
    lines = work(times)
    seconds = {line: time for time, line in lines}
    assert sum(times) / LINE_INTERVAL * 0.4 < len(seconds) < sum(times) / LINE_INTERVAL + 3
    checked = 0
    for line, time in seconds.items():
        found = re.search(r"about (?:(\d+):)?(\d+):(\d+) left", line)
        if found and time < 0.95 * sum(times) and time > 0.05 * sum(times):
            left = 3600 * int(found[1] or 0) + 60 * int(found[2]) + int(found[3])
            assert 0.5 < left / (sum(times) - time) < 2.0, line
            checked += 1
    assert checked > 15


def test_short_work_says_its_end_alone(work: Work) -> None:
    lines = [line for _, line in work([0.1] * 5)]
    assert set(lines) == {lines[-1]} and lines[-1].startswith("work: 5 of 5 parts, 100 %") and "now=1000.5" in lines[-1]


def test_a_terminal_has_a_bar(monkeypatch: pytest.MonkeyPatch) -> None:
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    out = Terminal()
    monkeypatch.setattr(sys, "stderr", out)
    for _ in Progress(range(3), desc="work", unit="parts"):
        pass
    assert "\r" in out.getvalue() and "3/3 parts" in out.getvalue() and progress.LINE not in out.getvalue()
