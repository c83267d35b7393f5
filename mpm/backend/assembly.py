"""Fields and kernels that outlive their solver: an equal scene takes them over, and compiles nothing.
Taichi compiles a kernel for the very fields that it was first called with, and keeps it until the process ends. So a
solver gives its fields back when it is closed or no longer used, and the next solver of an equal scene takes them. What
nobody has taken over is freed once it exceeds `IDLE_BYTES` or Taichi's room, the longest unused first."""

import gc
import weakref
from collections.abc import Callable, Hashable
from typing import Any

from mpm.backend.allocation import Group, allocating, count_groups
from mpm.backend.session import default_precision, present_program
from mpm.errors import InvalidValue

IDLE_BYTES = 500_000_000  # memory [bytes] that fields of closed solvers may take
MOST_GROUPS = 300  # groups of fields above which those of closed solvers are freed; Taichi has room for 512


class Assembly:
    """The fields of a scene, and what else was laid out or compiled for them.
    key: what two scenes share that can share an assembly. precision: of literals in what is compiled."""

    def __init__(self, key: Hashable, precision: str) -> None:
        self.key, self.precision, self._program = key, precision, present_program()
        self._groups: list[Group] = []
        self._idle: dict[Hashable, list[Any]] = {}
        self._taken: list[tuple[Hashable, Any]] = []
        self.shared: dict[Hashable, Any] = {}  # what was made once for all who ask, by key
        _all.add(self)

    def take(self, key: Hashable, make: Callable[[], Any]) -> Any:
        """Return what was made under a key and is not in use, or make it; it is the caller's until `release`."""
        if self._idle.get(key):
            made = self._idle[key].pop()
        else:
            with default_precision(self.precision), allocating() as group:
                made = make()
            self._groups.append(group)
        self._taken.append((key, made))
        return made

    def share(self, key: Hashable, make: Callable[[], Any]) -> Any:
        """Return what was made under a key, or make it; all who ask get the same."""
        if key not in self.shared:
            with default_precision(self.precision), allocating() as group:
                made = make()
            self._groups.append(group)
            self.shared[key] = made
        return self.shared[key]

    def release(self) -> None:
        """Take back all that was taken."""
        for key, made in self._taken:
            self._idle.setdefault(key, []).append(made)
        self._taken.clear()

    @property
    def is_present(self) -> bool:
        """Whether it is of this process, and not of one that it was forked from."""
        return self._program is present_program()

    @property
    def bytes(self) -> int:
        """Memory [bytes] of all fields."""
        return sum(group.bytes for group in self._groups)

    def free(self) -> None:
        """Give the memory back; nothing may use the assembly from now on."""
        for group in self._groups:
            group.free()
        self._idle.clear()
        self.shared.clear()


_all: "weakref.WeakSet[Assembly]" = weakref.WeakSet()  # assemblies in use or idle
_idle: list[Assembly] = []  # assemblies that nobody uses, the longest unused first


def take_assembly(key: Hashable, precision: str) -> Assembly:
    """Return an assembly that nobody uses for a scene's key, or a new, empty one."""
    _idle[:] = [assembly for assembly in _idle if assembly.is_present]
    limit_idle()
    found = _take_idle(key)
    if found is None and any(assembly.key == key and assembly.is_present for assembly in list(_all)):
        # solvers refer to themselves; to collect takes a tenth of a second, to compile takes seconds
        gc.collect()
        found = _take_idle(key)
    return found or Assembly(key, precision)


def _take_idle(key: Hashable) -> Assembly | None:
    """Return an idle assembly for a scene's key, the last one given back, or None."""
    for place in reversed(range(len(_idle))):
        if _idle[place].key == key:
            return _idle.pop(place)
    return None


def give_back(assembly: Assembly) -> None:
    """Take back an assembly whose solver is closed; frees nothing, so that the garbage collector may call it."""
    assembly.release()
    _idle.append(assembly)


def limit_idle(budget: int = IDLE_BYTES) -> None:
    """Free the longest unused assemblies until the others take `budget` [bytes] at most, and leave room for groups."""
    sizes = [assembly.bytes for assembly in _idle]
    while sum(sizes) > budget or (_idle and count_groups() > MOST_GROUPS):
        sizes.pop(0)
        _idle.pop(0).free()


class Tenure:
    """The time for which a solver has an assembly: until it is closed, or nobody refers to the tenure any more."""

    def __init__(self, key: Hashable, precision: str) -> None:
        self._assembly = take_assembly(key, precision)
        self._give_back = weakref.finalize(self, give_back, self._assembly)
        self._give_back.atexit = False

    @property
    def assembly(self) -> Assembly:
        """Fields and kernels of the scene; raises InvalidValue once the tenure has ended."""
        self.check_open()
        return self._assembly

    def check_open(self) -> None:
        """Raise InvalidValue once the tenure has ended."""
        if not self._give_back.alive:
            raise InvalidValue("the solver is closed, or has other fields since set_colliders; accepted: what is asked "
                               "before close(), and counters and samples made after set_colliders")

    def close(self) -> None:
        """Give the assembly back for the next solver of an equal scene."""
        if self._give_back.alive:
            self._give_back()
            limit_idle()
