"""Groups of fields that are laid out together and freed together."""

import contextlib
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from mpm.backend.session import check_owner, present_program, ti
from mpm.errors import BackendError

TREES = 512
"""Trees of fields that Taichi 1.7.4 has room for, those of other code included; one more ends the process."""


class Group:
    """Fields that were laid out together, and are freed together."""

    def __init__(self) -> None:
        self.tree: Any = None
        """Taichi's tree of the fields; None before they are laid out, where there are none, and once they are freed."""
        self.is_laid_out = False
        self._program = present_program()

    @property
    def is_present(self) -> bool:
        """Whether the fields are of this process, and not of one that it was forked from."""
        return self._program is present_program()

    @property
    def bytes(self) -> int:
        """Memory [bytes] that the fields take once they are written to."""
        return 0 if self.tree is None else self._program.get_snode_root(self.tree.id).cell_size_bytes

    def free(self) -> None:
        """Give the memory back; nothing may read the fields from now on."""
        if self.tree is not None and self.is_present:
            # not `SNodeTree.destroy`, which would have every kernel of the process compiled anew
            self.tree.ptr.destroy_snode_tree(self._program)
            _vacant_trees().add(self.tree.id)
        self.tree = None
        _groups.discard(self)


_groups: set[Group] = set()  # groups of fields that are laid out
_vacant: tuple[Any, set[int]] = (None, set())  # a program, and the trees that it has room for again
_unused: list[Group] = []  # groups that wait to be freed by the next `allocating`
_present: Group | None = None  # the group that fields are being added to
_waiting: list[Callable[[], None]] = []  # actions on fields that wait until their group is laid out


@contextlib.contextmanager
def allocating() -> Iterator[Group]:
    """Lay out all fields made inside as one group; nothing inside may read or launch.
    After an error inside nothing is left. Raises BackendError where the process has no room for another group."""
    global _present
    if _present is not None:  # part of a larger group
        yield _present
        return
    check_owner()
    while _unused:
        _unused.pop().free()
    runtime = ti.lang.impl.get_runtime()
    runtime.materialize()
    if not _vacant_trees() and present_program().get_snode_tree_size() >= TREES:
        raise BackendError(f"this process holds {TREES} groups of fields, a few for each open solver; accepted: close "
                           f"solvers that are no longer used (Solver.close, Env.close)")
    _present = group = Group()
    try:
        yield group
        if not ti.lang.impl._root_fb.empty:
            group.tree = ti.lang.impl._root_fb.finalize(raise_warning=False)
            _vacant_trees().discard(group.tree.id)
            ti.lang.impl._root_fb = ti.FieldsBuilder()
            runtime.materialize()
            _groups.add(group)
        group.is_laid_out = True
        due = list(_waiting)
        _waiting.clear()
        for act in due:
            act()
    except BaseException:
        _discard(runtime, group)
        raise
    finally:
        _present = None
        _waiting.clear()


def count_groups() -> int:
    """Return how many groups of this process are laid out."""
    return sum(group.is_present for group in _groups)


def _vacant_trees() -> set[int]:
    """Return the trees that were freed in this process, whose room the next ones take."""
    global _vacant
    if _vacant[0] is not present_program():
        _vacant = (present_program(), set())
    return _vacant[1]


def _discard(runtime: Any, group: Group) -> None:
    """Forget the fields of a group that could not be laid out or filled."""
    if group.tree is not None:
        group.free()
        return
    runtime.unfinalized_fields_builder.pop(ti.lang.impl._root_fb, None)
    ti.lang.impl._root_fb = ti.FieldsBuilder()
    for pending in (runtime.global_vars, runtime.grad_vars, runtime.dual_vars, runtime.matrix_fields):
        pending.clear()


def free_later(group: Group) -> None:
    """Free a group when the next one is laid out: safe anywhere, as in what the garbage collector calls."""
    _unused.append(group)


def put(field, values: np.ndarray) -> None:  # noqa: ANN001  (a taichi field)
    """Copy an array to a field, once its group is laid out."""
    later(lambda: field.from_numpy(values))


def later(act: Callable[[], None]) -> None:
    """Do something with fields, once their group is laid out."""
    if _present is None or _present.is_laid_out:
        act()
    else:
        _waiting.append(act)
