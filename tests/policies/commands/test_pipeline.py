"""One command after the other, each done once."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import mpm
from policies.runs import pipeline
from robosim.commands.main import parser
from robosim.config.rehearsal import load_rehearsal


class Ended:
    """A process that has ended."""

    def __init__(self, code: int) -> None:
        self.wait = lambda: code


def options(out, *more: str):
    return parser().parse_args(["pipeline", "spoon", "--out", str(out), "--no-video", *more])


def test_sub_tasks_are_those_of_the_rehearsals():
    assert {name: tuple(tasks) for name, tasks in pipeline.rehearsals().items()} == {
        name: load_rehearsal(name).learned for name in ("bottle", "scoop", "shovel", "spoon")}
    assert set(pipeline.BEGINNINGS) < {task for tasks in pipeline.rehearsals().values() for task in tasks}


def test_every_command_is_done_once_and_a_failed_one_again(tmp_path, monkeypatch, capsys):
    """The order is demonstrations, learning, a row, the arm; what failed is named with its last words, and done again;
    another method does what depends on it anew; what its commands would refuse to go on with is refused at once."""
    ran, broken = [], {"SpoonPour"}

    def answers(words, stdout=None, **_):
        words = words[3:]
        ran.append(words)
        if words[0] == "train" and words[2] in broken:
            stdout.write("no such grain\n")
            stdout.flush()
            return Ended(1)
        if words[0] == "demo":
            pipeline.write_json(made(tmp_path, "demonstrations", words[1]) / "demonstrations.json", {
                "demonstrations": [{"among grains of salt": {"tcs": 3.0}, "in clay": {"tcs": 9.0}}]})
        if words[0] == "train":
            folder = made(Path(words[words.index("--out") + 1]))
            np.savez(folder / "best.npz", actions=np.zeros((2, 3)))
            pipeline.write_json(folder / "status.json", {"replayed": {"tcs": 4.0}})
        return Ended(0)

    monkeypatch.setattr(pipeline.subprocess, "Popen", answers)
    assert pipeline.Pipeline(options(tmp_path)).run() == 1
    told = capsys.readouterr()
    assert "failed: learning of SpoonPour: no such grain" in told.err and "3.00           4.00" in told.out
    assert [words[0] for words in ran] == ["demo", "train"] * 3
    assert ran[0][ran[0].index("--from") + 1] == "script" and "--demos" in ran[1]
    ran.clear()
    broken.clear()
    assert pipeline.Pipeline(options(tmp_path)).run() == 0
    assert [words[0] for words in ran] == ["train", "chain", "rehearse"]
    assert ran[2][ran[2].index("--grasp") + 1] == "friction"
    assert sorted(path.stem for path in (tmp_path / "motions").glob("*.npz")) == sorted(pipeline.rehearsals()["spoon"])
    ran.clear()
    assert pipeline.Pipeline(options(tmp_path)).run() == 0 and ran == []
    pipeline.Pipeline(options(tmp_path, "--grasp", "weld")).run()
    assert [words[0] for words in ran] == ["rehearse"]
    ran.clear()
    pipeline.Pipeline(options(tmp_path, "--grasp", "weld", "--method", "rlpd")).run()  # what follows is of the old ones
    assert [words[0] for words in ran] == ["train"] * 3 + ["chain", "rehearse"]
    with pytest.raises(mpm.InvalidValue, match="holds a pipeline with --episodes None, now 5; give another folder"):
        pipeline.Pipeline(options(tmp_path, "--episodes", "5"))
    stages = json.loads((tmp_path / "pipeline.json").read_text())["stages"]
    assert len(stages) == 8 and all(stage["state"] == "finished" for stage in stages.values())


def made(out, *parts: str):
    """A folder below, there now."""
    folder = out.joinpath(*parts)
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def test_methods_without_demonstrations_make_none(tmp_path, monkeypatch):
    ran = []
    monkeypatch.setattr(pipeline.subprocess, "Popen", lambda words, **_: ran.append(words[3:]) or Ended(1))
    assert pipeline.Pipeline(options(tmp_path, "--method", "sac", "--jobs", "3")).run() == 1
    assert [words[0] for words in ran] == ["train"] * 3 and not any("--demos" in words for words in ran)


def test_ctrl_c_ends_what_runs_and_begins_nothing(tmp_path):
    """The command that runs gets Ctrl-C, as if it had been typed to it; the pipeline ends; the same folder goes on."""
    words = ["pipeline", "shovel", "--no-video", "--out", str(tmp_path)]
    # a job in the background ignores SIGINT
    heard = "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler); "
    heard += "from robosim.commands.main import main; sys.exit(main(sys.argv[1:]))"
    process = subprocess.Popen([sys.executable, "-c", heard, *words], stderr=subprocess.DEVNULL,
                               stdout=subprocess.DEVNULL)
    log = tmp_path / "logs" / "demonstrations_of_ShovelMove.txt"
    try:
        while not (log.is_file() and "demonstration_0" in log.read_text()) and process.poll() is None:
            time.sleep(0.1)
        with pytest.raises(mpm.InvalidValue, match="another process is at work there"):
            pipeline.Pipeline(parser().parse_args(words)).run()
    finally:
        process.send_signal(signal.SIGINT)
        code = process.wait(100)
    assert code == 130
    assert "stopped by Ctrl-C" in log.read_text()
    stages = json.loads((tmp_path / "pipeline.json").read_text())["stages"]
    assert set(stages) == {"demonstrations of ShovelMove"} and stages[min(stages)]["state"] == "failed"


def test_wrong_input_is_named(tmp_path):
    for more, told in ((("--jobs", "0"), "--jobs 0"), (("--method", "magic"), "method 'magic'; accepted: bc,"),
                       (("--method", "gnn_cmaes"), "learns from roll-outs")):
        with pytest.raises(mpm.InvalidValue, match=told):
            pipeline.Pipeline(options(tmp_path, *more))
    given = options(tmp_path)
    given.rehearsal = "ladle"
    with pytest.raises(mpm.InvalidValue, match="accepted: bottle, scoop, shovel, spoon"):
        pipeline.Pipeline(given)
