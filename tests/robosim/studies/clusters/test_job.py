"""A job of a cluster runs its command, keeps its output, and lets it write its checkpoint before its time ends."""

import os
import pickle
import signal
import sys
import threading
import time
from pathlib import Path

import pytest

from robosim.studies.clusters import job as module
from robosim.studies.clusters.job import ClusterJob, JobFailed

PROGRAM = """import pathlib, signal, sys, time
def stop(*_):
    pathlib.Path('checkpoint').write_text('kept')
    sys.exit(3)
signal.signal(signal.SIGTERM, stop)
pathlib.Path('begun').write_text('')
time.sleep(60)
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder with programs in it, in which jobs run."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    (tmp_path / "fails.py").write_text("import sys; print('one'); print('two'); sys.exit('three')")
    (tmp_path / "works.py").write_text("import os, sys; print(sys.argv[1], os.environ['ROBOSIM_CACHE'], os.getcwd())")
    (tmp_path / "long.py").write_text(PROGRAM)
    return tmp_path


def test_a_job_runs_where_it_was_made_with_caches_of_its_machine(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ROBOSIM_CACHE", raising=False)
    job = pickle.loads(pickle.dumps(ClusterJob(["works", "word"], folder / "out" / "log.txt")))
    monkeypatch.chdir(folder.parent)
    assert job() == 0
    word, cache, where = (folder / "out" / "log.txt").read_text().split()
    assert word == "word" and where == str(folder) and cache.endswith("/robosim")
    monkeypatch.setenv("ROBOSIM_CACHE", "/mine")
    assert job() == 0 and " /mine " in (folder / "out" / "log.txt").read_text()


def test_a_failed_job_says_its_last_lines(folder: Path) -> None:
    with pytest.raises(JobFailed, match=r"exit status 1 \| one \| two \| three"):
        ClusterJob(["fails"], folder / "log.txt")()


@pytest.mark.skipif(sys.platform != "linux", reason="SIGUSR2")
def test_a_warned_job_lets_its_command_write_a_checkpoint(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """SLURM warns every process of a job; the job's handler, which interrupts its waiting, ends the command."""
    pytest.importorskip("submitit")
    monkeypatch.setattr(module, "GRACE", 20.0)
    job, queued = ClusterJob(["long"], folder / "log.txt"), []

    def warn() -> None:
        while not (folder / "begun").exists():
            time.sleep(0.05)
        job._process.send_signal(signal.SIGUSR2)  # type: ignore[union-attr]
        time.sleep(0.3)
        os.kill(os.getpid(), signal.SIGUSR2)

    before = signal.signal(signal.SIGUSR2, lambda *_: queued.append((job.checkpoint(), time.monotonic())))
    began = time.monotonic()
    try:
        warner = threading.Thread(target=warn)
        warner.start()
        with pytest.raises(JobFailed, match="exit status 3"):
            job()
        warner.join()
    finally:
        signal.signal(signal.SIGUSR2, before)
    delayed, ended = queued[0]
    assert (folder / "checkpoint").read_text() == "kept" and ended - began < 15.0
    assert delayed.function is job and pickle.loads(pickle.dumps(job)).arguments == ["long"]
