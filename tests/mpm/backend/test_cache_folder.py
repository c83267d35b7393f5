"""Caches where the user's folder cannot be written: in a temporary folder of the user's own, said in one line."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from mpm.backend import cache_folder
from mpm.backend.cache_folder import user_cache_folder, writable_folder

NO_FOLDER = Path("/dev/null/cache")  # cannot be made by anybody, root included
USE = """import mpm, numpy as np
from mpm.backend import allocating, put, ti
mpm.init()
with allocating():
    field = ti.field(ti.f32, 3)
    put(field, np.ones(3, np.float32))
print(field.to_numpy().sum())"""  # compiles two small kernels


@pytest.fixture
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of a user's caches in an empty temporary folder, not yet made; nothing has been reported."""
    monkeypatch.setattr(cache_folder.tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(cache_folder, "_is_reported", False)
    return tmp_path / f"robosim-cache-{os.getuid()}"


def test_a_folder_that_can_be_written_is_used(temporary: Path, tmp_path, capsys) -> None:
    assert writable_folder(tmp_path / "wanted" / "kernels", "kernels") == tmp_path / "wanted" / "kernels"
    assert not list((tmp_path / "wanted" / "kernels").iterdir())
    assert not temporary.exists() and not capsys.readouterr().err


def test_processes_share_the_temporary_folder_and_say_so_once(temporary: Path, capsys) -> None:
    assert writable_folder(NO_FOLDER, "kernels") == temporary / "kernels"
    assert writable_folder(None, "kernels") == temporary / "kernels" and temporary.stat().st_mode & 0o777 == 0o700
    (line,) = capsys.readouterr().err.splitlines()
    assert str(NO_FOLDER) in line and line.endswith(f"caches are in {temporary}")


@pytest.mark.parametrize("planted", ["link", "writable", "another's"])
def test_a_folder_that_others_can_write_is_not_used(planted: str, temporary: Path, tmp_path: Path) -> None:
    """Whoever can write the folder can have kernels of theirs run."""
    if planted == "link":
        (tmp_path / "elsewhere").mkdir(mode=0o700)
        temporary.symlink_to(tmp_path / "elsewhere")
    else:
        temporary.mkdir()
        temporary.chmod(0o777 if planted == "writable" else 0o700)
    if planted == "another's":
        if os.getuid() != 0:
            pytest.skip("only root can make a folder of another user")
        os.chown(temporary, 12345, 12345)
    folder = writable_folder(NO_FOLDER, "kernels")
    assert temporary not in folder.parents and folder.parent.parent == tmp_path
    assert folder.parent.stat().st_mode & 0o777 == 0o700


def test_a_home_that_is_missing_is_not_made(temporary: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path / "missing"))
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    folder = user_cache_folder()
    assert folder is not None and folder == tmp_path / "missing" / ".cache"
    assert writable_folder(folder / "taichi", "kernels") == temporary / "kernels"
    assert not (tmp_path / "missing").exists()


def test_the_environment_names_the_user_s_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", "/home/user")
    monkeypatch.setenv("XDG_CACHE_HOME", "/var/cache")
    assert user_cache_folder() == Path("/var/cache")
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    assert user_cache_folder() == Path("/home/user/.cache")
    monkeypatch.delenv("HOME")
    assert user_cache_folder() is None


def test_no_folder_at_all_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cache_folder, "_temporary_folder", lambda: NO_FOLDER)
    with pytest.raises(OSError, match="XDG_CACHE_HOME or TMPDIR"):
        writable_folder(NO_FOLDER, "kernels")


@pytest.mark.parametrize("unusable", ["HOME is no folder", "HOME is not set", "TI_OFFLINE_CACHE_FILE_PATH"])
def test_a_run_without_a_home_ends_well(unusable: str, tmp_path: Path) -> None:
    """Taichi 1.7.4 ends the process at import where HOME is not set, and by a segmentation fault at the end where its
    cache folder cannot be made."""
    variables = {key: value for key, value in os.environ.items()
                 if key not in ("HOME", "XDG_CACHE_HOME", "TI_OFFLINE_CACHE_FILE_PATH")}
    if unusable != "HOME is not set":
        variables["HOME"] = str(tmp_path if unusable.startswith("TI_") else NO_FOLDER)
    if unusable.startswith("TI_"):
        variables[unusable] = str(NO_FOLDER)
    done = subprocess.run([sys.executable, "-c", USE], env=variables | {"TMPDIR": str(tmp_path)}, timeout=600,
                          capture_output=True, text=True)
    assert done.returncode == 0 and done.stdout.splitlines()[-1] == "3.0", done.stderr
    (line,) = done.stderr.splitlines()
    assert "cache" in line and str(tmp_path) in line
    assert list(tmp_path.glob("robosim-cache-*/ticache/*.tic"))


@pytest.mark.parametrize("age", [3600.0, 0.0])
def test_a_lock_of_a_killed_process_does_not_keep_kernels_from_being_stored(age: float, tmp_path: Path) -> None:
    """Taichi 1.7.4 gives up its cache, without a word, while the lock of another process is there."""
    folder = tmp_path / "ticache"
    folder.mkdir()
    lock = folder / "ticache.lock"
    lock.touch()
    os.utime(lock, (lock.stat().st_atime, lock.stat().st_mtime - age))
    done = subprocess.run([sys.executable, "-c", USE], env=os.environ | {"TI_OFFLINE_CACHE_FILE_PATH": str(folder)},
                          timeout=600, capture_output=True, text=True)
    assert done.returncode == 0 and done.stdout.splitlines()[-1] == "3.0", done.stderr
    if age:
        assert str(lock) in done.stderr and not lock.exists() and list(folder.glob("*.tic"))
    else:  # it may be that of a running process
        assert lock.exists() and not done.stderr
