"""The sheet of a film shows the full tool and the pour, whatever the waypoints are."""

import numpy as np
import pytest

from robosim.episode.sheet import SHEET_FRAMES, choose_frames, name_dose

TIMES = 0.05 * np.arange(200)
COUNTS = np.interp(TIMES, [0.0, 4.0, 7.0, 7.5, 10.0], [0.0, 100.0, 100.0, 0.0, 0.0])
COUNTS[(TIMES > 1.0) & (TIMES < 4.0)] = np.nan


@pytest.mark.parametrize("count", [2, 8, 30])
def test_the_full_tool_and_the_pour_are_among_the_frames(count: int) -> None:
    passages = [(float(t), f"w{k}") for k, t in enumerate(np.linspace(0.0, 9.9, count))]
    chosen = choose_frames(np.column_stack([TIMES, COUNTS]), passages)
    names = {name: TIMES[index] for index, name in chosen}
    assert len(chosen) <= SHEET_FRAMES and [index for index, _ in chosen] == sorted(index for index, _ in chosen)
    assert 4.0 <= names["full"] <= 7.05 and 7.1 <= names["emptying"] <= 7.4
    assert "w0" in names and len(chosen) == min(count + 2, SHEET_FRAMES)


def test_a_dose_that_leaves_most_in_the_tool_is_among_the_frames() -> None:
    """A third of the load leaves between 3 s and 6 s."""
    counts = np.interp(TIMES, [0.0, 3.0, 6.0, 10.0], [90.0, 90.0, 60.0, 60.0])
    names = {name: TIMES[index] for index, name in choose_frames(np.column_stack([TIMES, counts]), [(0.0, "held")])}
    assert names["emptying"] == pytest.approx(4.5, abs=0.06)


def test_a_tool_that_never_holds_anything_shows_its_waypoints() -> None:
    empty = np.column_stack([TIMES, np.zeros(len(TIMES))])
    assert [name for _, name in choose_frames(empty, [(0.0, "start"), (5.0, "push"), (99.0, "never")])] == ["start",
                                                                                                           "push"]
    kept = np.column_stack([TIMES, np.linspace(100.0, 97.0, len(TIMES))])
    assert "emptying" not in [name for _, name in choose_frames(kept, [(0.0, "start")])]
    digging = np.column_stack([TIMES, np.full(len(TIMES), np.nan)])
    assert choose_frames(digging, []) == [(0, "start")]


def test_a_dose_is_named_with_its_target() -> None:
    assert name_dose(("return", "in the cup", "target"), np.array([1.0, 4.318, 9.06])) == "4.32 of 9.06 g"
    assert name_dose(("poured", "target_mass"), np.array([0.0, 60.0])) == "0.00 of 60.00 g"
    assert name_dose(("poured", "target_mass"), np.array([np.nan, np.nan])) == ""
    assert name_dose(("delivered",), np.array([50.0])) == ""
