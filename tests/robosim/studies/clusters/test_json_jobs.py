"""A report whose runs are made elsewhere is the report made here; what fails there is named."""

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest

from robosim.base.errors import ConfigError
from robosim.commands.main import main
from robosim.studies.clusters.job import ClusterJob, JobFailed
from robosim.studies.clusters.json_jobs import JsonJobs, make_json_jobs
from robosim.studies.clusters.launch import Ended
from robosim.studies.verification.report import report


class OneAfterAnother:
    """A launcher that runs jobs of a cluster in this process, last first."""

    def configure(self, table: Mapping[str, Any]) -> None:
        """Take nothing over."""

    def run(self, commands: Sequence[tuple[list[str], Path]], folder: Path, resumes: bool = True) -> Iterator[Ended]:
        """Run them."""
        assert not resumes and len({log for _, log in commands}) == len(commands)
        for index in reversed(range(len(commands))):
            try:
                ClusterJob(*commands[index])()
                yield Ended(index, "")
            except JobFailed as error:
                yield Ended(index, str(error))


def test_results_belong_to_their_jobs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setattr("robosim.studies.clusters.job.GRACE", 0.0)
    (tmp_path / "one.py").write_text("import sys, atexit\nprint('on the way')\nassert sys.argv[2] == 'any'\n"
                                     "print('[%s, null]' % sys.argv[1])\n"
                                     "atexit.register(lambda: print('late', file=sys.stderr))")
    (tmp_path / "fails.py").write_text("import sys; sys.exit('no such grain')")
    (tmp_path / "silent.py").write_text("print('done')")
    run = JsonJobs(OneAfterAnother(), tmp_path / "launch")
    ended = {index: (value, reason) for index, value, reason in run([
        ("one", ["1"]), ("fails", []), ("one", ["2"]), ("silent", [])])}
    assert ended[0] == ([1, None], "") and ended[2] == ([2, None], "")
    assert ended[1][0] is None and ended[1][1].endswith("no such grain")
    assert ended[3] == (None, "printed no result")

    class Nothing(OneAfterAnother):
        def run(self, commands: Sequence[tuple[list[str], Path]], folder: Path,
                resumes: bool = True) -> Iterator[Ended]:
            asked.extend(words[2] for words, _ in commands)
            return iter(())

    asked: list[str] = []
    kept = list(JsonJobs(Nothing(), tmp_path / "launch")([("one", ["1"]), ("fails", []), ("one", ["3"])]))
    assert kept == [(0, [1, None], "")] and asked == ["fails", "one"]  # what ended well is not run again


def test_a_report_made_elsewhere_is_the_one_made_here(tmp_path: Path) -> None:
    for name, runner in (("here", None), ("there", JsonJobs(OneAfterAnother(), tmp_path / "launch"))):
        report(["return_mapping"], tmp_path / name, quick=True, runner=runner)
    here, there = (json.loads((tmp_path / name / "report.json").read_text()) for name in ("here", "there"))
    assert [run["record"]["errors"] for run in here["runs"]] == [run["record"]["errors"] for run in there["runs"]]
    assert [run["failed"] for run in there["runs"]] == [""] * len(here["runs"])


def test_a_launch_file_needs_a_launcher(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert make_json_jobs("local", None, tmp_path) is None
    with pytest.raises(ConfigError, match="with --launch local; accepted: with slurm or ray"):
        make_json_jobs("local", tmp_path / "cluster.yaml", tmp_path)
    (tmp_path / "cluster.yaml").write_text("partition: cpu\nhour: 2\n")
    pytest.importorskip("ray")
    assert main(["report", "return_mapping", "--quick", "--out", str(tmp_path / "r"), "--launch", "ray",
                 "--launch-file", str(tmp_path / "cluster.yaml")]) == 2
    assert "launch: unknown key 'hour'; valid: partition" in capsys.readouterr().err
