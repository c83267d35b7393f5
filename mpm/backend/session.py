"""The one place where taichi is imported and started, so that a maintained fork can take its place."""

import contextlib
import io
import os
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from mpm.backend.cache_folder import remove_stale_lock, user_cache_folder, writable_folder
from mpm.backend.owner import Owner
from mpm.backend.tracing import cache_sources, skip_source_lookups
from mpm.errors import BackendError, InvalidValue, MoreThreadsThanCores, UnknownName


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

skip_source_lookups(ti.lang.kernel_impl)

ARCHITECTURES = {"cpu": ti.cpu, "cuda": ti.cuda, "vulkan": ti.vulkan}
PRECISIONS = ("f32", "f64")


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
    one that can use `mpm` from then on."""
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


@contextlib.contextmanager
def default_precision(precision: str) -> Iterator[None]:
    """Compile what is launched inside with literals of this precision.
    Taichi gives a literal such as 1/3 the session's precision, so that a double-precision solver in a single-precision
    session would compute with constants good to 1e-8."""
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
