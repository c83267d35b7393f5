"""One trial a kind of command: SIGTERM in the middle of its work, then the same command again."""

import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

import pytest
from result_files import check_files, find_unfinished, read_status

LATEST = 600.0
"""Time [s] after which a command is taken to hang."""
SMALL = ("--set", "options.batch_size=16", "--set", "options.policy_kwargs.net_arch=[8,8]")
SWEEP = """tasks: [Pendulum-v1]
methods: [sac]
seeds: [0, 1]
episodes: 2
options: [--set, "options.policy_kwargs.net_arch=[8]"]
out: {out}
"""


class Trial(NamedTuple):
    """A command, the pattern of the file that shows that it is at work, and whether it is run to its end afterwards."""

    words: tuple[str, ...]
    begun: str
    is_continued: bool = True


TRIALS = {
    "train": Trial(("train", "sac", "Pendulum-v1", "--episodes", "6", *SMALL), "episodes.csv"),
    "demo": Trial(("demo", "SpoonTranslate", "--n", "1", "--iterations", "3", "--action-repeat", "50", "--no-video"),
                  "demonstration_0.unfinished.npz"),
    "evaluate": Trial(("evaluate", "SpoonTranslate", "--policy", "random", "--episodes", "2"), "*.rec*"),
    "report": Trial(("report", "free_fall", "--quick"), "rows/[!.]*.json"),
    "sweep": Trial(("sweep", "sweep.yaml"), "Pendulum-v1/sac/seed_0/episodes.csv"),
    "rehearse": Trial(("rehearse", "spoon", "--no-video"), "*.rec*", False),
    "pipeline": Trial(("pipeline", "shovel", "--iterations", "2", "--episodes", "2", "--no-video"),
                      "logs/*.txt", False),
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", TRIALS)
def test_a_command_that_is_interrupted_keeps_its_files_and_continues(tmp_path: Path, kind: str) -> None:
    """Exit status 143, "interrupted" in status.json, no traceback, nothing unfinished; then it ends as usual."""
    trial, out = TRIALS[kind], tmp_path / "out"
    if kind == "sweep":
        (tmp_path / "sweep.yaml").write_text(SWEEP.format(out=out))
    words = [sys.executable, "-m", "robosim", *trial.words, *([] if kind == "sweep" else ["--out", str(out)])]
    with (tmp_path / "log").open("w") as log:
        process = subprocess.Popen(words, stdout=log, stderr=log, cwd=tmp_path)
        begin = time.monotonic()
        while not list(out.rglob(trial.begun)) and process.poll() is None and time.monotonic() - begin < LATEST:
            time.sleep(0.02)
        process.send_signal(signal.SIGTERM)
        code = process.wait(LATEST)
    said = (tmp_path / "log").read_text()
    assert code == 143 and "Traceback" not in said and "stopped by SIGTERM" in said, said[-2000:]
    assert read_status(out) == "interrupted" and not find_unfinished(out)
    check_files(out)
    assert not (out / "report.json").exists() or kind == "report"
    if trial.is_continued:
        done = subprocess.run(words, capture_output=True, text=True, cwd=tmp_path, check=False)
        assert done.returncode == 0, done.stderr[-2000:]
        assert read_status(out) == "finished" and not find_unfinished(out)
        check_files(out)
