"""Lattices of distances that were computed before: the same, read from a file that may be damaged or missing."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.ndimage import map_coordinates

import mpm
from mpm.geometry import distance_cache, sdf


@pytest.fixture
def counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list:
    """A folder of its own; a list that grows with every computation."""
    calls, compute = [], sdf.signed_distances
    monkeypatch.setenv("MPM_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(sdf, "signed_distances", lambda *given: calls.append(1) or compute(*given))
    return calls


def lattice(size: float = 0.02, spacing: float = 2e-3) -> mpm.geometry.sampled_sdf.Lattice:
    return mpm.Sdf.from_mesh(trimesh.creation.box((size, size, 0.01)), spacing=spacing)


def test_the_second_is_read_and_the_same(counted: list, tmp_path: Path) -> None:
    first, second = lattice(), lattice()
    assert len(counted) == 1 and np.array_equal(first.host, second.host) and first.passage == second.passage
    lattice(0.021)
    lattice(spacing=1e-3)
    assert len(counted) == 3, "another mesh, and another spacing"
    assert len(list((tmp_path / "cache" / "distances").glob("*.npz"))) == 3


def test_a_shell_is_read_too(counted: list, tmp_path: Path) -> None:
    """Behind its face it is half a thickness closer; the same file serves, as the surface is the same."""
    mpm.init()
    ball = trimesh.creation.icosphere(2, 0.02)
    baked = [mpm.Shell.from_mesh(ball, 2e-3, spacing=1.5e-3).bake(0.006) for _ in range(2)]
    assert np.array_equal(baked[0].host, baked[1].host)
    assert np.array_equal(baked[0].sided.to_numpy(), baked[1].sided.to_numpy())
    assert len(list((tmp_path / "cache" / "distances").glob("*.npz"))) == 1


@pytest.mark.long
def test_a_shell_lies_behind_its_front_face() -> None:
    """The same distances as about the mid-surface, half a thickness further in."""
    mpm.init()
    front, middle = trimesh.creation.icosphere(4, 0.02), trimesh.creation.icosphere(4, 0.018)
    found = mpm.Shell.from_mesh(front, 4e-3, spacing=1e-3, behind=True).bake(0.005)
    expected = mpm.Shell.from_mesh(middle, 4e-3, spacing=1e-3).bake(0.005)
    points = np.random.default_rng(0).uniform(-0.02, 0.02, (500, 3))
    values = [map_coordinates(shell.host, ((points - shell.lower) / shell.spacing).T, order=1)
              for shell in (found, expected)]
    near = np.abs(values[1]) < 0.01
    assert near.sum() > 100 and np.abs(values[0] - values[1])[near].max() < 5e-5


def test_a_damaged_file_is_computed_again(counted: list, tmp_path: Path) -> None:
    expected = lattice().host
    [file] = (tmp_path / "cache" / "distances").glob("*.npz")
    whole = file.read_bytes()
    for content in (b"", whole[:100], whole[: len(whole) // 2], b"x" * len(whole)):
        file.write_bytes(content)
        assert np.array_equal(lattice().host, expected)
    assert len(counted) == 5 and file.read_bytes() == whole


def test_an_empty_name_keeps_nothing_and_other_code_finds_nothing(counted: list, tmp_path, monkeypatch) -> None:
    lattice()
    monkeypatch.setattr(distance_cache, "_code", lambda: b"other")
    lattice()
    monkeypatch.setenv("MPM_CACHE", "")
    lattice()
    assert len(counted) == 3 and len(list((tmp_path / "cache" / "distances").glob("*"))) == 2


def test_old_lattices_make_room(counted: list, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lattice()
    [file] = (tmp_path / "cache" / "distances").glob("*.npz")
    monkeypatch.setattr(distance_cache, "LARGEST_FOLDER", int(1.5 * file.stat().st_size))
    lattice(0.0201)
    assert not file.exists() and len(list(file.parent.glob("*.npz"))) == 1
    assert len(counted) == 2
