"""The code of an earlier commit, unpacked from the checkout's history."""

import subprocess
import tarfile
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


@contextmanager
def past_code(commit: str) -> Iterator[Path | None]:
    """Give a folder with the files of a commit, for as long as the context lasts; None where no checkout has it."""
    with tempfile.TemporaryDirectory(prefix="past_code_") as folder:
        archive, files = Path(folder) / "files.tar", Path(folder) / "files"
        try:
            subprocess.run(["git", "archive", "--output", str(archive), commit], cwd=ROOT, check=True,
                           capture_output=True)
        except (OSError, subprocess.CalledProcessError):  # no git, no checkout, or one without this commit
            yield None
            return
        with tarfile.open(archive) as tar:
            tar.extractall(files, filter="data")
        yield files
