"""Lattices of distances that this machine has computed before: from the user's cache folder instead of anew.
A lattice is found by its mesh, place and spacing, and by the code that computes it. The variable MPM_CACHE names
another folder; where it is empty nothing is kept."""

import ast
import contextlib
import functools
import hashlib
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import trimesh

from mpm.array_files import read_arrays
from mpm.backend.cache_folder import user_cache_folder, writable_folder
from mpm.errors import InvalidValue
from mpm.files import syntax_of, write
from mpm.geometry import mesh_distance

VARIABLE = "MPM_CACHE"  # variable of the environment that names the folder
LARGEST_FOLDER = 1_000_000_000  # bytes from which the lattices that were written first are removed


def kept_lattice(parts: list[trimesh.Trimesh], lower: np.ndarray, spacing: float, shape: tuple[int, ...],
                 kinds: dict[str, type], compute: Callable[[], dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """Return what `compute` does, arrays of a shape, or numbers: read where they were computed before, or computed.
    parts: the meshes. kinds: type of each array, by its name. A file that cannot be read is replaced; where none can be
    written, nothing is kept."""
    def compute_now() -> dict[str, np.ndarray]:
        return {name: np.asarray(values, kinds[name]) for name, values in compute().items()}

    chosen, base = os.environ.get(VARIABLE), user_cache_folder()
    if chosen == "":
        return compute_now()
    try:
        folder = writable_folder(Path(chosen) if chosen else base and base / "mpm", "mpm") / "distances"
        folder.mkdir(exist_ok=True)
    except OSError:
        return compute_now()
    path = folder / f"{_digest(parts, lower, spacing, shape, tuple(kinds))}.npz"
    with contextlib.suppress(OSError, InvalidValue):
        arrays = read_arrays(path)
        if arrays.keys() == kinds.keys() and all(values.dtype == kinds[name] and values.shape in (shape, ())
                                                 for name, values in arrays.items()):
            return arrays
    arrays = compute_now()
    with contextlib.suppress(OSError):
        write(path, lambda temporary: _save(temporary, arrays))
        _make_room(folder)
    return arrays


def _save(path: Path, arrays: dict[str, np.ndarray]) -> None:
    with path.open("wb") as file:
        np.savez(file, **arrays)  # pyright: ignore[reportArgumentType]


def _digest(parts: list[trimesh.Trimesh], lower: np.ndarray, spacing: float, shape: tuple[int, ...],
            names: tuple[str, ...]) -> str:
    found = hashlib.sha256(_code())
    found.update(repr((np.asarray(lower).tolist(), spacing, shape, names)).encode())
    for part in parts:
        for array in (np.ascontiguousarray(part.vertices), np.ascontiguousarray(part.faces)):
            found.update(repr((array.shape, array.dtype)).encode() + array.tobytes())
    return found.hexdigest()[:40]


@functools.cache
def _code() -> bytes:
    """Return what stands for the code that computes distances: its syntax, and the libraries' versions."""
    syntax = ast.dump(syntax_of(Path(mesh_distance.__file__).read_text(encoding="utf-8")))
    return f"{syntax} {np.__version__} {trimesh.__version__}".encode()


def _make_room(folder: Path) -> None:
    """Remove the files that were written first where all take more than `LARGEST_FOLDER`."""
    files = sorted((file.stat().st_mtime, file.stat().st_size, file) for file in folder.glob("*.npz"))
    total = sum(size for _, size, _ in files)
    for _, size, file in files:
        if total <= LARGEST_FOLDER:
            break
        file.unlink(missing_ok=True)
        total -= size
