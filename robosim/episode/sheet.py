"""Captions of a film, and the frames on its sheet."""

import itertools
from collections.abc import Sequence

import numpy as np

from robosim.recordings.reader import Recording

LOAD = "in the tool"
"""Curve of a recording with the mass in the tool; NaN while it digs."""
DOSED = (("in the cup", "target"), ("poured", "target_mass"))
"""Curves with the mass of a dose and with its target, of rehearsals and of episodes."""
SHEET_FRAMES = 9
"""Frames on the sheet."""
FULL, EMPTYING = 0.95, 0.5
"""Shares: of the largest load, from which a tool counts as full, and of what leaves it, from which as emptying."""


def name_passage(recording: Recording, time: float) -> str:
    """Return the waypoint that was passed last at a time [s]; empty for a recording without waypoints."""
    before = "grasp" if recording.waypoints else ""
    return next((entry.name for entry in reversed(recording.waypoints) if entry.time <= time), before)


def name_dose(names: Sequence[str], values: np.ndarray) -> str:
    """Return the mass of a dose and its target in words; empty where curves with these values (curves,) have none."""
    readings = dict(zip(names, values, strict=True))
    return next((f"{readings[mass]:.2f} of {readings[target]:.2f} g" for mass, target in DOSED
                 if np.isfinite([readings.get(mass, np.nan), readings.get(target, np.nan)]).all()), "")


def choose_frames(loads: np.ndarray, passages: list[tuple[float, str]]) -> list[tuple[int, str]]:
    """Choose the frames of the sheet, and their names: waypoints, and those in which the tool is full and empties.
    loads (n, 2): time [s] of every frame and number of grains in the tool, not finite while it digs. Of the waypoints,
    those that follow most closely on another frame are left out."""
    times, counts = loads.T
    chosen = {int(np.argmin(np.abs(times - time))): name for time, name in passages if time <= times[-1]}
    known, events = np.isfinite(counts), {}
    held = np.interp(times, times[known], counts[known]) if known.any() else np.zeros(len(times))
    if held.max() > 0.0:
        full = np.flatnonzero(held >= FULL * held.max())
        events[int(full[len(full) // 2])] = "full"
        least = held[full[-1] :].min()
        left = np.flatnonzero(held[full[-1] :] < least + EMPTYING * (held.max() - least))
        if least < FULL * held.max():
            events[int(full[-1] + left[0])] = "emptying"
    chosen |= events
    while len(chosen) > SHEET_FRAMES:
        order = sorted(chosen)
        gaps = {b: b - a for a, b in itertools.pairwise(order) if b not in events}
        gaps |= {a: b - a for a, b in itertools.pairwise(order) if b in events and a not in events and a != order[0]}
        del chosen[min(gaps, key=lambda index: gaps[index])]
    return sorted(chosen.items()) or [(0, "start")]


def find_passages(recording: Recording) -> dict[int, str]:
    """Return the frames of the sheet, and their names."""
    times, values = recording.values()
    names = [curve.name for curve in recording.header.curves]
    loads = values[:, names.index(LOAD)] if LOAD in names else np.full(len(times), np.nan)
    return dict(choose_frames(np.column_stack([times, loads]), [(e.time, e.name) for e in recording.waypoints]))


def choose_moment(recording: Recording) -> int:
    """Return the frame that tells most: in which the tool empties, or is full, or the middle one."""
    frames = {name: k for k, name in find_passages(recording).items()}
    return frames.get("emptying", frames.get("full", len(recording) // 2))
