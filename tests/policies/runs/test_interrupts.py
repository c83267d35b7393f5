"""Commands that are interrupted or meet a full disk: what they keep, what they say, and how they continue."""

import errno
import json
import os
import signal
from pathlib import Path

import gymnasium
import numpy as np
import pytest
import stand_ins
from result_files import check_files, find_unfinished, read_events, read_rows, read_status

from policies.demonstrations import demo, generator
from policies.demonstrations.demo import demonstrate
from policies.learning.options import SearchOptions
from policies.runs.checkpoint import Checkpoints
from robosim.commands.main import main
from robosim.rendering.video import Mp4Writer

QUICK = ["--set", "options.batch_size=16", "--set", "options.policy_kwargs.net_arch=[8,8]"]


@pytest.fixture
def point(monkeypatch: pytest.MonkeyPatch) -> str:
    """An environment whose episodes take 20 steps."""
    monkeypatch.setitem(gymnasium.registry, "Point-v0", gymnasium.envs.registration.EnvSpec(
        "Point-v0", stand_ins.PointEnv, max_episode_steps=stand_ins.DECISIONS))
    return "Point-v0"


@pytest.mark.parametrize(("number", "status", "name"), [(signal.SIGTERM, 143, "SIGTERM"),
                                                        (signal.SIGINT, 130, "Ctrl-C")])
def test_training_continues_from_its_first_episodes(tmp_path: Path, point: str, monkeypatch: pytest.MonkeyPatch,
                                                    capsys: pytest.CaptureFixture[str], number: int, status: int,
                                                    name: str) -> None:
    """Interrupted in its fourth episode, long before a checkpoint is due: three are kept, and the end has the same
    bits and one log, as without the interrupt."""
    words = ["train", "sac", point, "--episodes", "8", *QUICK, "--out"]
    assert main([*words, str(tmp_path / "whole")]) == 0
    original, steps = stand_ins.PointEnv.step, []

    def step(self: stand_ins.PointEnv, action: np.ndarray) -> tuple:
        steps.append(1)
        if len(steps) == 70:
            os.kill(os.getpid(), number)
        return original(self, action)

    monkeypatch.setattr(stand_ins.PointEnv, "step", step)
    out = tmp_path / "interrupted"
    capsys.readouterr()
    assert main([*words, str(out)]) == status
    message = capsys.readouterr().err
    assert "3 episodes finished; the same command continues after 3 episodes" in message
    assert f"robosim train: stopped by {name}" in message
    stored = json.loads((out / "status.json").read_text())
    assert stored["state"] == "interrupted" and stored["episodes"] == 3
    assert stored["reason"] == f"stopped by {name}; the same command continues after 3 episodes"
    with monkeypatch.context() as other:
        other.setenv("XDG_DATA_HOME", str(tmp_path / "another user's"))
        assert main([*words, str(out)]) == 2 and "--trust accepts it" in capsys.readouterr().err
        assert main([*words, str(out), "--trust"]) == 0 and len(steps) == 60 + 10 + 100 + 20  # the best again
    whole = tmp_path / "whole"
    assert [row[:4] for row in read_rows(out / "episodes.csv")] == [row[:4] for row in
                                                                   read_rows(whole / "episodes.csv")]
    assert read_events(out) == read_events(whole) and len(read_events(out)) == 2
    assert read_status(out) == "finished" and not find_unfinished(out)
    check_files(out)


def test_training_that_has_no_checkpoint_says_so(tmp_path, point: str, monkeypatch, capsys) -> None:
    """PPO checkpoints between its batches only; this is the first."""
    def step(self: stand_ins.PointEnv, action: np.ndarray) -> tuple:
        raise KeyboardInterrupt

    monkeypatch.setattr(stand_ins.PointEnv, "step", step)
    monkeypatch.setattr("policies.results.pages.write_run_page", lambda out: int("a page"))
    assert main(["train", "ppo", point, "--episodes", "8", "--out", str(tmp_path)]) == 130
    said = capsys.readouterr().err
    assert "0 episodes finished; there is no checkpoint yet: the same command begins again" in said
    assert "no page: " in said and read_status(tmp_path) == "interrupted" and not (tmp_path / "checkpoint.zip").exists()


def test_a_checkpoint_is_written_as_often_as_is_asked(tmp_path, point: str, monkeypatch) -> None:
    written, original = [], Checkpoints.write

    def write(self: Checkpoints) -> None:
        original(self)
        written.append(self.stored)

    monkeypatch.setattr(Checkpoints, "write", write)
    words = ["train", "sac", point, "--episodes", "8", *QUICK, "--checkpoint-every"]
    assert main([*words, "3", "--out", str(tmp_path)]) == 0 and written == [3, 6]
    with pytest.raises(SystemExit, match="2"):
        main([*words, "0", "--out", str(tmp_path)])


@pytest.fixture
def valley(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Demonstrations of a loss in closed form; returns the file in which its evaluations are counted."""
    monkeypatch.setattr(generator, "MotionLoss", stand_ins.Valley)
    for module in (demo, generator):
        monkeypatch.setattr(module, "make_environment", lambda task, **options: stand_ins.PointTask())
    monkeypatch.setenv("EVALUATIONS", str(tmp_path / "evaluations"))
    return tmp_path / "evaluations"


@pytest.mark.parametrize("fails_at", [4, 6])
def test_a_demonstration_on_a_full_disk_keeps_its_last_iteration(tmp_path: Path, valley: Path, fails_at: int,
                                                                 monkeypatch: pytest.MonkeyPatch) -> None:
    """The disk is full after three of five iterations, or at the end; the same command makes only those that are
    missing, and ends with the same bits."""
    options = SearchOptions(iterations=5, action_repeat=50)
    demonstrate("SpoonTranslate", tmp_path / "whole", options, n=1, film=False)
    out, original, calls = tmp_path / "full", np.savez, []

    def savez(path: Path, **arrays: np.ndarray) -> None:
        calls.append(path)
        if len(calls) == fails_at:
            Path(path).write_bytes(b"PK half of it")
            raise OSError(errno.ENOSPC, "No space left on device", str(path))
        original(path, **arrays)

    monkeypatch.setattr(np, "savez", savez)
    with pytest.raises(OSError, match="No space left"):
        demonstrate("SpoonTranslate", out, options, n=1, film=False)
    with np.load(out / "demonstration_0.unfinished.npz") as stored:
        assert len(stored["losses"]) == fails_at - 1
    assert not find_unfinished(out) and read_status(out) == "failed"
    valley.write_text("")
    demonstrate("SpoonTranslate", out, options, n=1, film=False)
    assert len(valley.read_text()) == 5 - (fails_at - 1)
    with np.load(tmp_path / "whole" / "demonstration_0.npz") as whole, np.load(out / "demonstration_0.npz") as stored:
        assert all(np.array_equal(whole[key], stored[key]) for key in whole.files)
    assert {path.name for path in out.glob("[!.]*")} == {path.name for path in (tmp_path / "whole").glob("[!.]*")}


@pytest.mark.parametrize(("command", "writer"), [
    ("train", "policies.results.pages.write_text"), ("demo", "policies.results.pages.write_text"),
    ("train", "robosim.base.output_folder.FileLock"), ("demo", "robosim.base.output_folder.FileLock")])
def test_a_full_disk_is_a_failure_with_status_1(tmp_path: Path, valley: Path, point: str, command: str, writer: str,
                                                monkeypatch: pytest.MonkeyPatch) -> None:
    """Whether it is found by the first file or by the last; the same command then ends the work."""
    words = {"train": ["train", "sac", point, "--episodes", "2", *QUICK], "demo": [
        "demo", "SpoonTranslate", "--n", "1", "--iterations", "2", "--action-repeat", "50", "--no-video"]}[command]

    def fail(path: Path, *_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device", str(path))

    with monkeypatch.context() as full:
        full.setattr(writer, fail)
        assert main([*words, "--out", str(tmp_path / "out")]) == 1
        assert "FileLock" in writer or read_status(tmp_path / "out") == "failed"
    ended = int(command == "demo")  # two iterations reach nothing
    assert main([*words, "--out", str(tmp_path / "out")]) == ended
    assert read_status(tmp_path / "out") == "finished" and (tmp_path / "out" / "index.html").is_file()


def test_a_film_that_fails_is_removed(tmp_path: Path) -> None:
    """Also where its index cannot be moved to the front; the film before it stays."""
    frame = np.zeros((32, 32, 3), np.uint8)
    with pytest.raises(RuntimeError), Mp4Writer(tmp_path / "a.mp4") as film:
        film.add(frame)
        raise RuntimeError
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "b.mp4").mkdir()  # cannot be replaced by a file
    film = Mp4Writer(tmp_path / "b.mp4")
    film.add(frame)
    with pytest.raises(OSError):
        film.close()
    film.close()
    assert [path.name for path in tmp_path.iterdir()] == ["b.mp4"]
