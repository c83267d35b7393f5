"""Runs on a cluster: arrays of SLURM jobs, and the job that continues."""

import csv
import json
import os
import pickle
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest
from slurm_cluster import INSTALL, NODES, SlurmCluster, missing_programs

from robosim.base.errors import ConfigError, UnknownName
from robosim.base.jobs import Command, Ended
from robosim.commands.main import main
from robosim.studies.clusters import job as module
from robosim.studies.clusters.job import ClusterJob, JobFailed
from robosim.studies.clusters.slurm import find_launcher, make_launcher, read_table
from robosim.studies.verification.report import report

SWEEP = """
tasks: [Pendulum-v1, SpoonTranslate]
methods:
  - {{name: early, method: sac, set: {{options.learning_starts: 50, options.policy_kwargs: {{net_arch: [64, 64]}}}}}}
  - {{name: late, method: sac, set: {{options.learning_starts: 300, options.policy_kwargs: {{net_arch: [64, 64]}}}}}}
seeds: [0, 1]
episodes: 15
options: [--checkpoint-every, "2"]
out: {out}
launch: {{partition: cpu, hours: {hours}, memory_gb: 1.5, warning_s: 25}}
"""
TIMES = ("seconds", "simulating", "updating")  # columns that differ from run to run


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[SlurmCluster]:
    if missing_programs():
        pytest.skip(f"{', '.join(missing_programs())} missing: {INSTALL}")
    folder = tmp_path / "cluster"
    folder.mkdir()
    cluster = SlurmCluster(folder)
    yield cluster
    cluster.stop()


def start_sweep(file: Path, *words: str, env: dict[str, str] | None = None) -> "subprocess.Popen[str]":
    return subprocess.Popen([sys.executable, "-m", "robosim", "sweep", file.name, *words], cwd=file.parent, env=env,
                            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


def read_rows(out: Path) -> dict[str, list[dict[str, str]]]:
    """Return the episodes of all runs without their times."""
    rows = {}
    for path in sorted(out.rglob("episodes.csv")):
        with path.open() as file:
            rows[str(path.relative_to(out).parent)] = [
                {key: value for key, value in row.items() if key not in TIMES} for row in csv.DictReader(file)]
    return rows


@pytest.mark.slow
def test_a_sweep_on_slurm_ends_as_one_here(cluster: SlurmCluster, tmp_path: Path) -> None:
    """Eight runs; every job reaches its limit of a minute and goes on, and one of the two nodes fails on the way."""
    (tmp_path / "there.yaml").write_text(SWEEP.format(out="there", hours=1 / 60))
    (tmp_path / "here.yaml").write_text(SWEEP.format(out="here", hours=1))
    with start_sweep(tmp_path / "there.yaml", "--launch", "slurm", env=cluster.environment) as sweep:
        while len(list((tmp_path / "there").rglob("checkpoint.zip"))) < 2 and sweep.poll() is None:
            time.sleep(0.5)
        # its job is killed; the node comes back when its daemon reports again
        cluster.call("scontrol", "update", f"nodename={NODES[0]}", "state=down", "reason=test")
        output, _ = sweep.communicate(timeout=1800)
    assert sweep.returncode == 0, output
    killed = (cluster.folder / "controller.log").read_text()
    assert re.search(f"failure of node {NODES[0]}|node {NODES[0]} state set to DOWN", killed, re.IGNORECASE)
    logs = "".join(path.read_text() for path in (tmp_path / "there" / "launch").glob("*_log.*"))
    assert logs.count("Requeued job") >= 2, logs  # at the time limit
    with start_sweep(tmp_path / "here.yaml", "--jobs", "2") as local:
        output, _ = local.communicate(timeout=1800)
    assert local.returncode == 0, output
    there, here = read_rows(tmp_path / "there"), read_rows(tmp_path / "here")
    assert len(here) == 8 and all(len(rows) == 15 for rows in here.values()) and there == here


@pytest.mark.slow
def test_a_failed_run_is_listed_with_its_last_lines(cluster: SlurmCluster, tmp_path: Path) -> None:
    text = SWEEP.format(out="there", hours=1).replace("tasks: [Pendulum-v1, SpoonTranslate]", "tasks: [Pendulum-v1]")
    (tmp_path / "bad.yaml").write_text(text.replace("seeds: [0, 1]", "seeds: [0]").replace(
        "options: [--checkpoint-every, \"2\"]", "options: [--n-envs, \"2\"]").replace("episodes: 15", "episodes: 1"))
    with start_sweep(tmp_path / "bad.yaml", "--launch", "slurm", env=cluster.environment) as sweep:
        output, _ = sweep.communicate(timeout=600)
    failed = re.findall(r"failed: (\S+): (.*)", output)
    assert sweep.returncode == 1 and len(failed) == 2 and "exit status 2" in failed[0][1], output
    runs = json.loads((tmp_path / "there" / "sweep.json").read_text())["runs"]
    assert len(runs) == 2 and "finished" not in runs.values()


@pytest.mark.slow
def test_a_report_on_slurm_is_the_one_made_here(cluster: SlurmCluster, tmp_path: Path) -> None:
    (tmp_path / "cluster.yaml").write_text("partition: cpu\nhours: 0.2\nmemory_gb: 1.5\n")
    errors = {}
    for name, words in (("there", ["--launch", "slurm", "--launch-file", "cluster.yaml"]), ("here", [])):
        made = subprocess.run([sys.executable, "-m", "robosim", "report", "return_mapping", "jerk_limits", "--quick",
                               "--out", name, *words], cwd=tmp_path, env=cluster.environment, capture_output=True,
                              text=True, timeout=900, check=False)
        assert made.returncode == 0, made.stderr
        runs = json.loads((tmp_path / name / "report.json").read_text())["runs"]
        errors[name] = [(run["case"], run["choices"], run["record"]["errors"]) for run in runs]
    assert errors["there"] == errors["here"]


@pytest.mark.slow
def test_a_partition_that_is_not_there_is_refused(cluster: SlurmCluster, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SLURM_CONF", cluster.environment["SLURM_CONF"])
    launcher = make_launcher("slurm")
    with pytest.raises(ConfigError, match=r"launch.partition: 'gpu'; accepted here: cpu"):
        launcher.configure({"partition": "gpu"})


def test_without_slurm_it_is_said_what_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("submitit")
    monkeypatch.setenv("PATH", "")
    with pytest.raises(ConfigError, match=r"--launch slurm: sinfo: .*apt install slurm-client"):
        make_launcher("slurm")


def test_a_launch_table_is_checked() -> None:
    assert make_launcher("local") is None and read_table({"hours": 2, "extra": {"constraint": "avx512"}}).hours == 2
    with pytest.raises(UnknownName, match="local, slurm"):
        make_launcher("cloud")
    for table, message in (({"hours": 0}, "launch: hours"), ({"memory": 3}, "unknown key 'memory'; valid: partition"),
                           ({"setup": "module load"}, "launch: setup")):
        with pytest.raises(ConfigError, match=message):
            read_table(table)


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


@pytest.mark.slow
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
