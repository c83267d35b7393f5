"""The code of an earlier commit, unpacked from the checkout's history."""

import subprocess
import tarfile
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import mpm

ROOT = Path(__file__).resolve().parents[2]


@contextmanager
def past_code(commit: str, root: Path = ROOT) -> Iterator[Path]:
    """Give a folder with the files of a commit of the checkout `root`, for as long as the context lasts.

    Raises:
        mpm.InvalidValue: no such commit is there, or it cannot be unpacked.
    """
    with tempfile.TemporaryDirectory(prefix="past_code_") as folder:
        archive, files = Path(folder) / "files.tar", Path(folder) / "files"
        found = run_git(root, "rev-parse", "--verify", "--quiet", "--end-of-options", f"{commit}^{{commit}}")
        if not found:
            raise mpm.InvalidValue(f"commit {commit!r}: {root} has no such commit; accepted: one of its history, "
                                   f"without -dirty")
        run_git(root, "archive", "--output", str(archive), found)
        with tarfile.open(archive) as tar:
            if hasattr(tarfile, "data_filter"):  # Python 3.10.12, 3.11.4 and later
                tar.extractall(files, filter="data")
            else:
                tar.extractall(files)
        archive.unlink()
        yield files


def run_git(root: Path, *words: str) -> str:
    """Return what git prints in a folder, empty where it finds nothing; raises mpm.InvalidValue where it cannot."""
    try:
        process = subprocess.run(["git", *words], cwd=root, capture_output=True, text=True, check=False)
    except OSError as error:
        raise mpm.InvalidValue(f"git {words[0]}: {error}") from error
    if process.returncode != 0 and process.stderr:
        raise mpm.InvalidValue(f"git {words[0]} in {root}: {process.stderr.strip()}")
    return process.stdout.strip()
