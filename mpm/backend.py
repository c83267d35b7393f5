"""The one place where taichi is imported and started, so that a maintained fork can take its place."""

import contextlib
import io
import os
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mpm.cache_folder import remove_stale_lock, user_cache_folder, writable_folder
from mpm.errors import BackendError, InvalidValue, MoreThreadsThanCores, UnknownName
from mpm.owner import Owner
from mpm.tracing import cache_sources


@contextlib.contextmanager
def _environment(**values: str | None) -> Iterator[None]:
    """Set variables of the environment, or with None unset them, for a call of Taichi."""
    before = {name: os.environ.get(name) for name in values}
    try:
        for name, value in values.items():
            os.environ.pop(name, None)
            os.environ.update({name: value} if value is not None else {})
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name, None)
            os.environ.update({name: value} if value is not None else {})


os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")
os.environ.setdefault("TI_SKIP_VERSION_CHECK", "ON")  # a thread that writes to the user's home and calls a server
# without a home, Taichi ends the process here; nothing is written before `init`
with _environment(XDG_CACHE_HOME=str(user_cache_folder() or os.devnull)):
    import taichi as ti

__all__ = ["PRECISIONS", "Group", "allocating", "check_owner", "default_precision", "free_later", "init",
           "is_concurrent", "is_shared", "is_vulkan", "later", "numerics", "once", "present_program", "put",
           "real_type", "session_precision", "thread_count", "ti"]

ARCHITECTURES = {"cpu": ti.cpu, "cuda": ti.cuda, "vulkan": ti.vulkan}
PRECISIONS = ("f32", "f64")
GROUPS = 500
"""Groups of fields that a process may lay out. Taichi 1.7.4 has room for 512, and ends the process at one more."""


class Session(NamedTuple):
    """What the process was started with."""

    arch: str
    precision: str
    threads: int
    fast_math: bool


DEFAULT = Session("cpu", "f32", 1, True)
_session: Session | None = None
_owner: Owner | None = None
"""Set when the backend was first started, or in a process that this one was forked from."""


def init(*, arch: str | None = None, precision: str | None = None, threads: int | None = None,
         fast_math: bool | None = None) -> None:
    """Start Taichi, once per process; without a call, the first use of `mpm` starts it with the defaults.

    - arch: "cpu" (default), "cuda" or "vulkan", which has "f32" alone.
    - precision: "f32" (default) or "f64"; default of all solvers.
    - threads: number of CPU threads (default 1); more than there are cores are warned of (`MoreThreadsThanCores`).
    - fast_math: False keeps the IEEE order of operations, for bitwise comparisons (default True).

    A second call with the same arguments does nothing. With other arguments it raises BackendError, because it would
    invalidate all existing fields; so does "cuda" or "vulkan" without a device. The thread that calls it is the only
    one that can use `mpm` from then on.
    """
    found = _session or DEFAULT
    arch, precision = arch or found.arch, precision or found.precision
    threads = found.threads if threads is None else threads
    fast_math = found.fast_math if fast_math is None else fast_math
    if arch not in ARCHITECTURES:
        raise UnknownName("arch", arch, ARCHITECTURES)
    if precision not in PRECISIONS:
        raise UnknownName("precision", precision, PRECISIONS)
    if threads < 1:
        raise InvalidValue(f"mpm.init: threads = {threads}; accepted: 1 or more")
    if arch == "vulkan" and precision == "f64":
        raise InvalidValue("mpm.init: arch = 'vulkan' with precision = 'f64'; accepted: 'f32', as Vulkan has no "
                           "logarithm in double precision")
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if threads > cores:
        warnings.warn(MoreThreadsThanCores(f"mpm.init: {threads} threads on {cores} cores; they wait for each other, "
                                           f"and one goes on alone where that takes long"), stacklevel=2)
    wanted = Session(arch, precision, int(threads), bool(fast_math))
    if _is_running():
        check_owner()
        if wanted != _session:
            raise BackendError(f"mpm.init was called with {_session}; a process has one backend, not also {wanted}")
    else:
        _start(wanted, by_name=True)


def _is_running() -> bool:
    """Return whether the backend is started in this process, and not only in one that it was forked from."""
    return _owner is not None and _owner.thread is not None


def check_owner() -> None:
    """Raise BackendError in a thread or a forked process that cannot use the fields that were made before."""
    if _owner is not None:
        _owner.check()


def _start(wanted: Session, by_name: bool) -> None:
    """Start Taichi, which announces its architecture on standard output, where a command's own lines belong."""
    global _session, _owner
    if _owner is None:
        _owner = Owner(ti.lang, BackendError)
        cache_sources(ti.lang)
    _owner.check_start(by_name)
    chosen = os.environ.get("TI_OFFLINE_CACHE_FILE_PATH")
    base = user_cache_folder()
    try:
        folder = writable_folder(Path(chosen) if chosen else base and base / "taichi" / "ticache", "ticache")
    except OSError as error:
        raise BackendError(f"compiled kernels cannot be stored: {error}") from error
    remove_stale_lock(folder)
    # Taichi warns of a variable that an argument replaces
    with contextlib.redirect_stdout(io.StringIO()), _environment(XDG_CACHE_HOME=str(folder.parent),
                                                                 TI_OFFLINE_CACHE_FILE_PATH=None):
        _call_init(wanted, folder)
    if wanted.arch != "cpu" and ti.lang.impl.current_cfg().arch != ARCHITECTURES[wanted.arch]:
        ti.reset()
        raise BackendError(f"mpm.init: arch = {wanted.arch!r}, and this machine has none; accepted here: 'cpu'")
    _session = wanted
    _owner.take()


def _call_init(wanted: Session, folder: Path) -> None:
    """Call `ti.init`, the only time in the process."""
    ti.init(
        arch=ARCHITECTURES[wanted.arch],
        cpu_max_num_threads=wanted.threads,
        default_fp=real_type(wanted.precision),
        fast_math=wanted.fast_math,
        # taichi's own passes take 12 s on the fused kernel and gain nothing that LLVM does not do anyway (measured:
        # 16.7 s to compile and 105 ns per particle and substep with them, 4.6 s and 105 ns without)
        advanced_optimization=False,
        unrolling_limit=64,  # it warns from 32 on: a particle that sleeps beside a shell has 34 fields
        log_level=ti.ERROR,
        offline_cache=True,
        offline_cache_file_path=str(folder),
        random_seed=0,
    )


def session_precision() -> str:
    """Return the precision given to `init`, which is called with its defaults if it was not."""
    if not _is_running():
        _start(_session or DEFAULT, by_name=False)
    check_owner()
    assert _session is not None
    return _session.precision


def numerics() -> dict[str, Any]:
    """Return the arguments of `init` that another process needs for the same bits: precision and fast_math."""
    found = _session or DEFAULT
    return {"precision": found.precision, "fast_math": found.fast_math}


def thread_count() -> int:
    """Return the threads given to `init`."""
    return 1 if _session is None else _session.threads


def is_shared() -> bool:
    """Return whether all threads add to the same nodes, as on a GPU."""
    return _session is not None and _session.arch != "cpu"


def is_vulkan() -> bool:
    """Return whether Vulkan is used: without functions in double precision, with barriers for shared memory alone."""
    return _session is not None and _session.arch == "vulkan"


def is_concurrent() -> bool:
    """Return whether more than one thread adds to the same sums."""
    return is_shared() or thread_count() > 1


def real_type(precision: str):  # noqa: ANN201  (a taichi type object)
    """Return Taichi's type for "f32" or "f64"."""
    return ti.f64 if precision == "f64" else ti.f32


def present_program() -> Any:
    """Return what stands for the backend as it was last started: a forked process has its own."""
    return ti.lang.impl.get_runtime().prog


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
        self.tree = None
        _groups.discard(self)


_groups: set[Group] = set()
"""Groups of fields that are laid out."""
_unused: list[Group] = []
"""Groups that wait to be freed by the next `allocating`."""
_present: Group | None = None
"""The group that fields are being added to."""
_waiting: list[Callable[[], None]] = []
"""Actions on fields that wait until their group is laid out."""


@contextlib.contextmanager
def allocating() -> Iterator[Group]:
    """Lay out all fields made inside as one group; nothing inside may read or launch.

    After an error inside nothing is left. Raises BackendError where the process has no room for another group.
    """
    global _present
    if _present is not None:  # part of a larger group
        yield _present
        return
    check_owner()
    while _unused:
        _unused.pop().free()
    runtime = ti.lang.impl.get_runtime()
    runtime.materialize()
    if len([group for group in _groups if group.is_present]) >= GROUPS:
        raise BackendError(f"this process holds {GROUPS} groups of fields, a few for each open solver; accepted: close "
                           f"solvers that are no longer used (Solver.close, Env.close)")
    _present = group = Group()
    try:
        yield group
        if not ti.lang.impl._root_fb.empty:
            group.tree = ti.lang.impl._root_fb.finalize(raise_warning=False)
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


@contextlib.contextmanager
def default_precision(precision: str) -> Iterator[None]:
    """Compile what is launched inside with literals of this precision.

    Taichi gives a literal such as 1/3 the session's precision, so that a double-precision solver in a
    single-precision session would compute with constants good to 1e-8.
    """
    runtime = ti.lang.impl.get_runtime()
    before = runtime.default_fp
    runtime.default_fp = real_type(precision)
    try:
        yield
    finally:
        runtime.default_fp = before


@ti.func
def once(value):
    """Return the value as a variable: an expression in a list would be computed again at each use."""
    result = value
    return result
