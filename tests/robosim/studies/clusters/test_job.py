"""A job of a cluster runs its command and lets it write a checkpoint; a report made elsewhere is the one made here."""

import json
import os
import pickle
import signal
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

from robosim.base.errors import ConfigError
from robosim.base.jobs import Command, Ended
from robosim.commands.main import main
from robosim.studies.clusters import job as module
from robosim.studies.clusters.job import ClusterJob, JobFailed
from robosim.studies.clusters.slurm import find_launcher
from robosim.studies.verification.report import report

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
        job._process.send_signal(signal.SIGUSR2)
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


class OneAfterAnother:
    """A launcher that runs jobs of a cluster in this process, last first."""

    def run(self, commands: Sequence[Command], folder: Path, resumes: bool = True) -> Iterator[Ended]:
        assert not resumes and len({log for _, log in commands}) == len(commands)
        for index in reversed(range(len(commands))):
            try:
                ClusterJob(*commands[index])()
                yield Ended(index, "")
            except JobFailed as error:
                yield Ended(index, str(error))


def test_a_report_made_elsewhere_is_the_one_made_here(tmp_path: Path) -> None:
    for name, launcher in (("here", None), ("there", OneAfterAnother())):
        report(["return_mapping"], tmp_path / name, quick=True, launcher=launcher)
    here, there = (json.loads((tmp_path / name / "report.json").read_text()) for name in ("here", "there"))
    assert [run["record"]["errors"] for run in here["runs"]] == [run["record"]["errors"] for run in there["runs"]]
    assert [run["failed"] for run in there["runs"]] == [""] * len(here["runs"])


def test_a_launch_file_needs_a_launcher(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert find_launcher("local", None) is None
    with pytest.raises(ConfigError, match="with --launch local; accepted: with --launch slurm"):
        find_launcher("local", tmp_path / "cluster.yaml")
    (tmp_path / "cluster.yaml").write_text("partition: cpu\nhour: 2\n")
    assert main(["report", "return_mapping", "--quick", "--out", str(tmp_path / "r"), "--launch", "slurm",
                 "--launch-file", str(tmp_path / "cluster.yaml")]) == 2
    assert "launch: unknown key 'hour'; valid: partition" in capsys.readouterr().err
