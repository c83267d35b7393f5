"""The pipeline: stages in order, each run once."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

import mpm
from policies.runs import pipeline
from robosim.base.errors import ConfigError
from robosim.commands.main import parser
from robosim.config.rehearsal import load_rehearsal


def ended(code: int) -> Mock:
    return Mock(wait=lambda: code)  # hashable, as processes are


def options(out, *more: str):
    return parser().parse_args(["pipeline", "spoon", "--out", str(out), "--no-video", *more])


def test_sub_tasks_are_those_of_the_rehearsals():
    assert {name: tuple(tasks) for name, tasks in pipeline.recorded_rehearsals().items()} == {
        name: load_rehearsal(name).recorded for name in ("bottle", "scoop", "shovel", "spoon")}
    assert set(pipeline.DEMO_ARGUMENTS) < {task for tasks in pipeline.recorded_rehearsals().values() for task in tasks}


def test_stages_run_once_and_failed_ones_again(tmp_path, monkeypatch, capsys):
    """The order is demonstrations, training, sequence, arm. A failed stage is named with the last line of its output
    and run again; with another method the stages that depend on it run again."""
    calls, failing = [], {"SpoonPour"}

    def start(arguments, stdout=None, **_):
        arguments = arguments[3:]
        calls.append(arguments)
        if arguments[0] == "train" and arguments[2] in failing:
            stdout.write("no such grain\n")
            stdout.flush()
            return ended(1)
        if arguments[0] == "train":
            folder = make_folder(Path(arguments[arguments.index("--out") + 1]))
            np.savez(folder / "best.npz", actions=np.zeros((2, 3)))
        return ended(0)

    monkeypatch.setattr(subprocess, "Popen", start)
    assert pipeline.Pipeline(options(tmp_path)).run() == 1
    assert "failed: training of SpoonPour: no such grain" in capsys.readouterr().err
    assert [arguments[0] for arguments in calls] == ["demo", "train"] * 3
    assert calls[0][calls[0].index("--from") + 1] == "script" and "--demos" in calls[1]
    calls.clear()
    failing.clear()
    assert pipeline.Pipeline(options(tmp_path)).run() == 0
    assert [arguments[0] for arguments in calls] == ["train", "chain", "rehearse"]
    assert calls[2][calls[2].index("--grasp") + 1] == "friction"
    motions = {path.stem for path in (tmp_path / "motions").glob("*.npz")}
    assert motions == set(pipeline.recorded_rehearsals()["spoon"])
    calls.clear()
    assert pipeline.Pipeline(options(tmp_path)).run() == 0 and calls == []
    pipeline.Pipeline(options(tmp_path, "--grasp", "weld")).run()
    assert [arguments[0] for arguments in calls] == ["rehearse"]
    calls.clear()
    pipeline.Pipeline(options(tmp_path, "--grasp", "weld", "--method", "rlpd")).run()
    assert [arguments[0] for arguments in calls] == ["train"] * 3 + ["chain", "rehearse"]
    stages = json.loads((tmp_path / "pipeline.json").read_text())["stages"]
    assert len(stages) == 8 and all(stage["state"] == "finished" for stage in stages.values())


def test_settings_go_to_the_stages_of_the_rehearsal(tmp_path, monkeypatch):
    """Its list of sub-tasks is the one that was set; the same settings continue."""
    calls = []

    def start(arguments, **_):
        calls.append(arguments[3:])
        if calls[-1][0] == "train":
            np.savez(make_folder(Path(calls[-1][calls[-1].index("--out") + 1])) / "best.npz", actions=np.zeros((2, 3)))
        return ended(0)

    monkeypatch.setattr(subprocess, "Popen", start)
    changed = options(tmp_path, "--set", "recorded=[SpoonPour]", "--set", "field.cell=4e-3")
    assert pipeline.Pipeline(changed).run() == 0
    assert [call[:3] for call in calls[:2]] == [["demo", "SpoonPour", "--out"], ["train", "residual", "SpoonPour"]]
    given = ["--set", 'recorded=["SpoonPour"]', "--set", "field.cell=0.004"]
    assert [(call[0], call[-4:]) for call in calls[2:]] == [("chain", given), ("rehearse", given)]
    assert pipeline.Pipeline(changed).run() == 0 and len(calls) == 4


def make_folder(out, *parts: str):
    folder = out.joinpath(*parts)
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def test_methods_without_demonstrations_make_none(tmp_path, monkeypatch):
    calls = []
    monkeypatch.setattr(subprocess, "Popen", lambda words, **_: calls.append(words[3:]) or ended(1))
    assert pipeline.Pipeline(options(tmp_path, "--method", "sac", "--jobs", "3")).run() == 1
    assert [words[0] for words in calls] == ["train"] * 3 and not any("--demos" in words for words in calls)


@pytest.mark.slow
def test_ctrl_c_interrupts_the_running_stage_and_starts_no_other(tmp_path):
    """The running command is interrupted and ends; so does the pipeline."""
    out = tmp_path / "out"
    arguments = ["pipeline", "shovel", "--no-video", "--out", str(out)]
    # a background job of a shell ignores SIGINT
    code = "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler); "
    code += "from robosim.commands.main import main; sys.exit(main(sys.argv[1:]))"
    process = subprocess.Popen([sys.executable, "-c", code, *arguments], stderr=subprocess.DEVNULL,
                               stdout=subprocess.DEVNULL)
    log = out / "logs" / "demonstrations_of_ShovelMove.txt"
    try:
        while not (log.is_file() and "demonstration_0" in log.read_text()) and process.poll() is None:
            time.sleep(0.1)
        with pytest.raises(ConfigError, match="another process is at work there"):
            pipeline.Pipeline(parser().parse_args(arguments)).run()
    finally:
        process.send_signal(signal.SIGINT)
        status = process.wait(100)
    assert status == 130 and "robosim demo: stopped by SIGTERM; finished iterations are kept" in log.read_text()
    assert json.loads((out / "status.json").read_text())["state"] == "interrupted"
    stages = json.loads((out / "pipeline.json").read_text())["stages"]
    assert set(stages) == {"demonstrations of ShovelMove"} and stages[min(stages)]["state"] == "interrupted"


def test_wrong_input_is_named(tmp_path):
    for more, message in ((("--method", "magic"), "unknown method 'magic'; valid: bc,"),
                          (("--method", "gnn_cmaes"), "learns from rollouts")):
        with pytest.raises(ValueError, match=message):
            pipeline.Pipeline(options(tmp_path, *more))
    given = options(tmp_path)
    given.rehearsal = "ladle"
    with pytest.raises(mpm.InvalidValue, match="accepted: bottle, scoop, shovel, spoon"):
        pipeline.Pipeline(given)
