"""Files are whole under their names: a failure keeps the old one, a kill leaves what the next process removes."""

import errno
import json
from pathlib import Path

import pytest

from mpm.files import temporary_path, write
from robosim.base.files import TEMPORARY, append, keep_status, remove_temporary, write_text
from robosim.base.output_folder import OutputFolder


@pytest.mark.parametrize("error", [OSError(errno.ENOSPC, "No space left on device"), KeyboardInterrupt("SIGTERM")])
def test_a_failure_keeps_the_old_file_and_leaves_no_other(tmp_path: Path, error: BaseException) -> None:
    path = tmp_path / "table.csv"
    write_text(path, "old")

    def write_half(temporary: Path) -> None:
        assert temporary.suffix == ".csv" and temporary.parent == tmp_path
        temporary.write_text("ne")
        raise error

    with pytest.raises(type(error)):
        write(path, write_half)
    assert [(one.name, one.read_text()) for one in tmp_path.iterdir()] == [("table.csv", "old")]


def test_what_a_killed_process_left_is_removed(tmp_path: Path) -> None:
    """Files and folders of temporary names, and nothing else."""
    kept = [tmp_path / name for name in ("a.csv", "a.mp4.part", ".lock", ".a.part.csv", "rows/1.json")]
    (tmp_path / "rows").mkdir()
    left = [temporary_path(tmp_path / name) for name in ("a.csv", "b.unfinished.npz", "rows/0.json")]
    for path in [*kept, *left]:
        path.write_text("x")
    folder = temporary_path(tmp_path / "film")
    folder.mkdir()
    (folder / "episode.mp4").write_text("x")
    assert TEMPORARY.fullmatch(folder.name)
    remove_temporary(tmp_path)
    assert sorted(one for one in tmp_path.rglob("*") if one.is_file()) == sorted(kept)


def test_a_line_is_appended_whole_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "report.jsonl"
    append(path, b"one\n")

    def fail(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("os.fsync", fail)
    with pytest.raises(OSError):
        append(path, b"two\n")
    assert path.read_bytes() == b"one\n"


@pytest.mark.parametrize(("error", "state", "reason"), [
    (None, "finished", None), (KeyboardInterrupt("SIGTERM"), "interrupted", "stopped by SIGTERM"),
    (OSError(errno.ENOSPC, "No space left on device"), "failed", "OSError: [Errno 28] No space left on device")])
def test_a_status_says_how_work_ended(tmp_path: Path, error: BaseException | None, state: str,
                                      reason: str | None) -> None:
    try:
        with keep_status(tmp_path):
            assert json.loads((tmp_path / "status.json").read_text())["state"] == "running"
            if error is not None:
                raise error
    except (KeyboardInterrupt, OSError) as raised:
        assert raised is error
    status = json.loads((tmp_path / "status.json").read_text())
    assert (status["state"], status.get("reason")) == (state, reason)


def test_a_part_that_failed_is_a_failure(tmp_path: Path) -> None:
    """As a run of several, or a film, whose command has exit status 1."""
    with OutputFolder(tmp_path) as folder:
        folder.failures.append("seed 3: diverged")
    status = json.loads((tmp_path / "status.json").read_text())
    assert (status["state"], status["reason"]) == ("failed", "seed 3: diverged")


def test_a_status_that_cannot_be_written_is_removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """On a full disk, where "running" would no longer be true."""
    with pytest.raises(RuntimeError), keep_status(tmp_path):
        def fail(descriptor: int) -> None:
            raise OSError(errno.ENOSPC, "No space left on device")

        monkeypatch.setattr("os.fsync", fail)
        raise RuntimeError
    assert list(tmp_path.iterdir()) == []
