"""The thread that owns the backend: any other, and a forked process, is refused before Taichi is touched.
Taichi 1.7 lays out fields only in the thread that started it, and its kernels share buffers. A forked process has a
copy of its memory without its worker threads, for which a launch there would wait for ever. It can start the backend
again and make fields of its own; those of the process that it was forked from are refused."""

import ctypes
import os
import threading
from typing import Any, NoReturn
from weakref import WeakSet

ADVICE = 'processes started with context="spawn", or gymnasium.make_vec("robosim/...", num_envs=n)'


class Lost:
    """What a field holds in a forked process in place of its memory: each use raises an error.
    error: the type that is raised."""

    def __init__(self, error: type[Exception]) -> None:
        self._error, self.uses = error, 0

    def refuse(self, *_: Any) -> NoReturn:
        """Raise the error, and count the use."""
        self.uses += 1
        raise self._error("a solver, environment, batch or rollout that was made before this process was forked cannot "
                          f"be used in it; accepted: one that is made in this process, or {ADVICE}") from None

    __getitem__ = __iter__ = __len__ = refuse


class Owner:
    """Knows the thread that started the backend, and all fields.
    lang: Taichi's package `lang`, whose launches and reads ask here first. error: the type that is raised."""

    def __init__(self, lang: Any, error: type[Exception]) -> None:
        self.thread: threading.Thread | None = None
        """The thread that may use the backend; None until it is started in this process."""
        self._ident = 0
        self._lang, self._error, self._lost = lang, error, Lost(error)
        self._fields: WeakSet[Any] = WeakSet()
        self._is_forked = False
        """Whether this process was forked from one that used the field, and has not started it again."""
        self._cannot_start = ""  # why a forked process cannot start the backend
        self._guard()
        if hasattr(os, "register_at_fork"):
            os.register_at_fork(after_in_child=self._leave_parent)

    def check(self) -> None:
        """Raise the error in any thread but the owner, and in a forked process that has not started the backend."""
        if threading.get_ident() == self._ident:
            return
        if self._is_forked:
            self._lost.refuse()
        if self.thread is None:
            raise self._error("the field is not started; accepted: mpm.init(), or a solver, first")
        raise self._other_thread(f"the thread {self.thread.name!r} owns the field's backend", "that thread")

    def check_start(self, by_name: bool) -> None:
        """Raise the error where the backend cannot be started from this thread or in this process.
        by_name: `init` was called, and not a solver made, which starts it in the main thread only."""
        if self._cannot_start:
            raise self._error(f"this process was forked {self._cannot_start}; accepted: {ADVICE}")
        if not by_name and threading.current_thread() is not threading.main_thread():
            raise self._other_thread("the field is used first outside the main thread", "the main thread, or in the "
                                     "one that calls mpm.init() first and then is the only one")

    def take(self) -> None:
        """Make the present thread the owner."""
        self.thread, self._ident, self._is_forked = threading.current_thread(), threading.get_ident(), False

    def _other_thread(self, reason: str, accepted: str) -> Exception:
        """Return the error of a thread that may not use the backend."""
        return self._error(f"thread {threading.current_thread().name!r}: {reason}; accepted: make and use solvers and "
                           f"environments in {accepted}, or {ADVICE}")

    def _guard(self) -> None:
        """Let every launch, and every access to a field from Python, ask `check` first."""
        kernel, field, owner = self._lang.kernel_impl.Kernel, self._lang.matrix.Field, self
        launch, access, make = kernel.__call__, field._initialize_host_accessors, field.__init__

        def guarded_launch(self: Any, *arguments: Any, **options: Any) -> Any:
            owner.check()
            uses = owner._lost.uses
            try:
                return launch(self, *arguments, **options)
            except Exception:
                if owner._lost.uses > uses:  # Taichi reports it as an error of the kernel that it was compiling
                    owner._lost.refuse()
                raise

        def guarded_access(self: Any) -> None:
            owner.check()
            access(self)

        def recorded_make(self: Any, *arguments: Any) -> None:
            make(self, *arguments)
            owner._fields.add(self)

        kernel.__call__, field._initialize_host_accessors = guarded_launch, guarded_access
        field.__init__ = recorded_make

    def _leave_parent(self) -> None:
        """In a forked process, give up the backend and the fields of the one that it was forked from."""
        program = self._lang.impl.get_runtime().prog
        if program is None or self.thread is None:
            return
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(program))  # its destructor would wait for the missing threads
        for field in self._fields:
            field.vars = field.host_accessors = self._lost
        self._fields.clear()
        if threading.get_ident() != self._ident:
            self._cannot_start = "by another thread than the one that uses the field, perhaps in the middle of a launch"
        elif program.config().arch == self._lang.misc.cuda:
            self._cannot_start = "from one that uses the GPU, which CUDA does not allow"
        self.thread, self._ident, self._is_forked = None, 0, True
