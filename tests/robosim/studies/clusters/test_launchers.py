"""A report whose runs are made elsewhere is the report made here; what fails there is named."""

import json
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

from robosim.base.errors import ConfigError
from robosim.base.jobs import Command, Ended
from robosim.commands.main import main
from robosim.studies.clusters.job import ClusterJob, JobFailed
from robosim.studies.clusters.slurm import find_launcher
from robosim.studies.verification.report import report


class OneAfterAnother:
    """A launcher that runs jobs of a cluster in this process, last first."""

    def run(self, commands: Sequence[Command], folder: Path, resumes: bool = True) -> Iterator[Ended]:
        """Run them."""
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
