"""Lattices of distances that this machine has computed before: from the user's cache folder instead of anew.

A lattice is found by its mesh, place and spacing, and by the code that computes it. The variable MPM_CACHE names
another folder; where it is empty nothing is kept.
"""

import contextlib
import functools
import hashlib
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import trimesh

from mpm.cache_folder import user_cache_folder, writable_folder
from mpm.errors import InvalidValue
from mpm.files import write
from mpm.geometry import mesh_distance
from mpm.input_files import read_arrays

VARIABLE = "MPM_CACHE"
"""Variable of the environment that names the folder."""
LARGEST_FOLDER = 1_000_000_000
"""Bytes from which the lattices that were written first are removed."""


def kept_lattice(parts: list[trimesh.Trimesh], lower: np.ndarray, spacing: float, shape: tuple[int, ...],
                 compute: Callable[[], tuple[np.ndarray, float]]) -> tuple[np.ndarray, float]:
    """Return what `compute` does, values of a shape and a width: read where they were computed before, or computed.

    parts: the meshes. A file that cannot be read is replaced; where none can be written, nothing is kept.
    """
    chosen, base = os.environ.get(VARIABLE), user_cache_folder()
    if chosen == "":
        return compute()
    try:
        folder = writable_folder(Path(chosen) if chosen else base and base / "mpm", "mpm") / "distances"
        folder.mkdir(exist_ok=True)
    except OSError:
        return compute()
    path = folder / f"{_digest(parts, lower, spacing, shape)}.npz"
    with contextlib.suppress(OSError, InvalidValue):
        arrays = read_arrays(path)
        values, width = arrays["values"], arrays["width"]
        if values.shape == shape and values.dtype == np.float32 and width.shape == ():
            return values, float(width)
    values, width = compute()
    values = values.astype(np.float32)
    with contextlib.suppress(OSError):
        write(path, lambda temporary: _save(temporary, values, width))
        _make_room(folder)
    return values, width


def _save(path: Path, values: np.ndarray, width: float) -> None:
    with path.open("wb") as file:
        np.savez(file, values=values, width=np.float64(width))


def _digest(parts: list[trimesh.Trimesh], lower: np.ndarray, spacing: float, shape: tuple[int, ...]) -> str:
    found = hashlib.sha256(_code())
    found.update(repr((np.asarray(lower).tolist(), spacing, shape)).encode())
    for part in parts:
        for array in (np.ascontiguousarray(part.vertices), np.ascontiguousarray(part.faces)):
            found.update(repr((array.shape, array.dtype)).encode() + array.tobytes())
    return found.hexdigest()[:40]


@functools.cache
def _code() -> bytes:
    """Return what stands for the code that computes distances."""
    return Path(mesh_distance.__file__).read_bytes() + f"{np.__version__} {trimesh.__version__}".encode()


def _make_room(folder: Path) -> None:
    """Remove the files that were written first where all take more than `LARGEST_FOLDER`."""
    files = sorted((file.stat().st_mtime, file.stat().st_size, file) for file in folder.glob("*.npz"))
    total = sum(size for _, size, _ in files)
    for _, size, file in files:
        if total <= LARGEST_FOLDER:
            break
        file.unlink(missing_ok=True)
        total -= size
