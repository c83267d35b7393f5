"""A thread group: threads of a CPU that run one program together, each with its part of every phase.
Taichi wakes threads for every parallel loop, which takes longer than most phases. So a launch is one such loop with a
turn for each thread, and between phases they wait for each other at a barrier, a counter that they spin on. That is
fast where each has a core. Where other processes take cores away, the first thread goes on alone, with one part after
the other, so that the results are the same."""

from typing import Any, NamedTuple

from mpm.backend import ti
from mpm.state.packs import count_packs

TURNS = 512
"""Turns of a parallel loop that Taichi 1.7.4 gives a thread at least, whatever its settings."""
LONG_WAIT = 20_000
"""Turns of a waiting loop, half a millisecond, after which a thread notes that it waits long."""
MOST_LONG_WAITS = 12
"""Long waits in a substep from which the first thread goes on alone: more than a substep has long phases."""
ARRIVALS, LONG_WAITS, ALONE = range(3)
"""Places in a group's numbers: arrivals at barriers, long waits, and 1 where one thread goes on alone."""


class ThreadGroup(NamedTuple):
    """One thread of a group; by default the only one."""

    thread: Any = 0  # number of this thread
    threads: int = 1  # how many there are, and so how many parts phases have
    numbers: Any = None  # see `ARRIVALS`; None for one thread
    alone: Any = 0  # 1 where the first thread works on all parts


@ti.func
def synchronize(group: ti.template()):
    """Barrier: wait until all threads of the group have come here."""
    if ti.static(group.threads > 1):  # noqa: SIM102  (decided when compiling)
        if group.alone == 0:
            before = ti.atomic_add(group.numbers[ARRIVALS], 1)
            goal = (before // group.threads + 1) * group.threads
            waited = 0
            while ti.atomic_add(group.numbers[ARRIVALS], 0) < goal:
                waited += 1
            if waited > LONG_WAIT:
                ti.atomic_add(group.numbers[LONG_WAITS], 1)


@ti.func
def is_left_alone(group: ti.template()):
    """Return whether the first thread goes on alone from here, after a substep; all threads come here."""
    alone = group.alone
    if ti.static(group.threads > 1):  # noqa: SIM102  (decided when compiling)
        if alone == 0:
            if group.thread == 0:
                if group.numbers[LONG_WAITS] >= MOST_LONG_WAITS:
                    group.numbers[ALONE] = 1
                group.numbers[LONG_WAITS] = 0
            synchronize(group)
            alone = ti.cast(group.numbers[ALONE], ti.i32)
    return alone


@ti.func
def last_part(group: ti.template()):
    """Return the last + 1 of the parts that this thread works on, the first of which has its own number."""
    return group.thread + 1 + group.alone * (group.threads - 1)


@ti.func
def part_of(count, part, group: ti.template()):
    """Return the first and last + 1 of `count` things that belong to a part."""
    first, last = 0, count
    if ti.static(group.threads > 1):
        each = (count + group.threads - 1) // group.threads
        first = ti.min(part * each, count)
        last = ti.min(first + each, count)
    return first, last


@ti.func
def count_of(fields: ti.template(), over: ti.template()):
    """Return the size of a phase's domain."""
    count = 1
    if ti.static(over.startswith("packs")):
        count = count_packs(fields)
    elif ti.static(over in ("blocks", "walls")):
        count = fields.grid.count[None]
    elif ti.static(over == "rows"):
        count = fields.grid.stamp.shape[0] * fields.grid.stamp.shape[1]
    elif ti.static(over == "listed"):
        count = fields.shells.count[None]
    elif ti.static(over == "entering in order"):
        count = fields.shells.entering_count[None] if ti.static(fields.shells.lists_entering) \
            else fields.shells.count[None]
    return count
