"""Repeated launches of a kernel, without what Taichi does in Python for every argument.
In every launch Taichi 1.7 looks up the compiled kernel, and checks and converts each argument: 60 us for the twelve of
an advance, in which a substep of 600 particles is computed. A `Launcher` uses the memory of the last launch's arguments
again and takes 8 us."""

from collections.abc import Callable
from typing import Any

import numpy as np

from mpm.backend.session import check_owner, present_program, ti

NUMBERS = {"set_arg_int": int, "set_arg_float": float}  # how Taichi is given a number, and what it is before


class Launcher:
    """Launches one kernel of one object, and is called as the kernel itself.
    kernel: as it stands in the object's class. Arguments are contiguous arrays, and numbers. Taichi compiles a version
    of the kernel for each combination of the arrays' types and dimensions. The first launch of each is Taichi's own."""

    def __init__(self, owner: Any, kernel: Callable[..., None]) -> None:
        self._owner, self._kernel = owner, kernel._primal  # type: ignore[attr-defined]
        kinds = [argument.annotation for argument in self._kernel.arguments[1:]]
        self._arrays = [i for i, kind in enumerate(kinds) if isinstance(kind, ti.types.ndarray)]
        is_real = [kind is float or kind in (ti.f32, ti.f64) for kind in kinds]
        self._numbers = [(i, "set_arg_float" if is_real[i] else "set_arg_int")
                         for i in range(len(kinds)) if i not in self._arrays]
        self._versions: dict[tuple, Launch] = {}

    def __call__(self, *arguments: Any) -> None:
        """Launch the kernel with these arguments."""
        check_owner()
        arrays = [arguments[i] for i in self._arrays]
        version = (present_program(), *[array.dtype.num for array in arrays], *[array.ndim for array in arrays])
        launch = self._versions.get(version)
        if launch is None:
            self._kernel(self._owner, *arguments)
            key = self._kernel.ensure_compiled(self._owner, *arguments)
            self._versions[version] = Launch(self._kernel.compiled_kernels[key])
            return
        for i, array in zip(self._arrays, arrays):
            launch.set_array(i, array)
        for i, setter in self._numbers:
            launch.set_number(i, setter, arguments[i])
        launch.start()


class Launch:
    """One compiled version of a kernel with the arguments that it was given last."""

    def __init__(self, compiled: Any) -> None:
        self._context = compiled.make_launch_context()
        self._arrays: dict[int, np.ndarray] = {}
        self._numbers: dict[int, Any] = {}
        program = present_program()
        self._code = program.compile_kernel(program.config(), program.get_device_caps(), compiled)
        """Machine code, which the program keeps: to look it up again takes longer than a short launch."""

    def set_array(self, place: int, array: np.ndarray) -> None:
        """Set an array argument; it is held until the next one takes its place."""
        if self._arrays.get(place) is not array:
            if not array.flags.c_contiguous:
                raise ValueError(f"argument {place} of a kernel: an array that is not contiguous; accepted: "
                                 f"np.ascontiguousarray(...)")
            self._context.set_arg_external_array_with_shape((place,), array.ctypes.data, array.nbytes, array.shape, 0)
            self._arrays[place] = array

    def set_number(self, place: int, setter: str, value: float) -> None:
        """Set an argument that is a number."""
        if self._numbers.get(place) != value:
            getattr(self._context, setter)((place,), NUMBERS[setter](value))
            self._numbers[place] = value

    def start(self) -> None:
        """Launch; returns when the kernel is done."""
        present_program().launch_kernel(self._code, self._context)
