"""The film's process: it draws what it is handed, says why it cannot, and never holds the simulation up."""

from pathlib import Path
from types import SimpleNamespace

import av
import mujoco
import numpy as np
import pytest

from robosim.base.output_folder import OutputFolder
from robosim.config.rehearsal import load_rehearsal
from robosim.rehearsal.film import FRAME_RATE
from robosim.rehearsal.film_process import FilmFailed, FilmProcess
from robosim.rehearsal.planning.motion_sequence import place_target
from robosim.scene.build import compile_rehearsal

FRAMES = 12


def make_run() -> SimpleNamespace:
    """What a film asks a run for: the spoon's scene with 60 grains that rise."""
    config = place_target(load_rehearsal("spoon"))
    scene = compile_rehearsal(config)
    grid = np.stack(np.meshgrid(*[np.arange(4)] * 3, indexing="ij"), -1).reshape(-1, 3)[:60]
    run = SimpleNamespace(config=config, data=mujoco.MjData(scene.model), time=0.0, delay=0.0,
                          material=SimpleNamespace(colour=(0.9, 0.9, 0.9, 1.0)), grains=SimpleNamespace(
                              grain_volume=8e-6))
    run.plan = SimpleNamespace(path=SimpleNamespace(times={"dig": 0, "lift": 0}))
    run.planned_passages = lambda: [(0.0, "dig"), (0.2, "lift")]
    run.passages_after_dose = lambda: [(0.25, "home")]
    run.solver = SimpleNamespace(
        awake=np.arange(60) % 2 == 0, particles=SimpleNamespace(counts=(60,)),
        positions=lambda: np.array([0.7, -0.2, 0.05 + 0.2 * run.time]) + 0.02 * grid)
    return run


def shoot(folder: Path, steps: int = FRAMES, colour: str = "material", rate: int = FRAME_RATE) -> FilmProcess:
    """Film so many steps, 1 / FRAME_RATE long each."""
    run = make_run()
    film = FilmProcess(OutputFolder(folder))
    film.begin(run, "close", colour, rate)
    for k in range(steps):
        run.time = k / FRAME_RATE
        film.add_due_frame()
    return film


def test_all_frames_are_drawn_and_the_grains_are_seen_to_move(tmp_path: Path) -> None:
    shoot(tmp_path).close()
    assert (tmp_path / "frames.png").is_file() and not (tmp_path / "rehearsal.mp4.part").exists()
    frames = read_film(tmp_path)
    assert len(frames) == FRAMES and frames[0].shape == (720, 1280, 3)
    changed = np.abs(frames[-1] - frames[0]).max(2) > 60
    assert 200 < changed.sum() < 0.2 * changed.size


def read_film(folder: Path) -> list[np.ndarray]:
    """Read the frames (height, width, 3) of a film."""
    with av.open(str(folder / "rehearsal.mp4")) as film:
        return [frame.to_ndarray(format="rgb24").astype(int) for frame in film.decode(video=0)]


@pytest.mark.slow
def test_grains_that_sleep_are_marked(tmp_path: Path) -> None:
    shoot(tmp_path / "material").close()
    shoot(tmp_path / "awake", colour="awake").close()
    white, marked = read_film(tmp_path / "material")[-1], read_film(tmp_path / "awake")[-1]
    blue = (marked[..., 2] - marked[..., 0] > 40) & (np.abs(white - marked).max(2) > 40)
    assert 100 < blue.sum() < 0.1 * blue.size
    assert (np.abs(white - marked).max(2) > 40).sum() < 1.5 * blue.sum()  # the others have kept their colour


def test_frames_come_at_the_rate_that_is_asked_for(tmp_path: Path) -> None:
    shoot(tmp_path, steps=9, rate=FRAME_RATE // 2).close()
    assert len(read_film(tmp_path)) == 5


def test_where_nothing_can_be_drawn_it_says_so_once_and_the_run_goes_on(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture) -> None:
    monkeypatch.setenv("MUJOCO_GL", "disable")
    film = shoot(tmp_path)
    film._process.wait()
    film.add_due_frame()
    film.close()
    said = capsys.readouterr().err
    assert said.count("no video") == 1 and "OpenGL" in said
    assert not list(tmp_path.glob("rehearsal*"))


def test_a_film_that_cannot_be_written_is_an_error_with_its_reason(tmp_path: Path) -> None:
    (tmp_path / "rehearsal.mp4.part").mkdir()
    with pytest.raises(FilmFailed, match=r"rehearsal\.mp4\.part"):
        shoot(tmp_path).close()


def test_a_film_that_never_began_leaves_nothing(tmp_path: Path) -> None:
    film = FilmProcess(OutputFolder(tmp_path))
    film.close()
    assert film._process.poll() is not None and not list(tmp_path.glob("rehearsal*"))


def test_the_film_of_a_killed_run_ends_where_it_was_killed(tmp_path: Path) -> None:
    film = shoot(tmp_path)
    film._send_all()
    film._stdin.close()
    assert film._process.wait() == 1
    film._log.close()
    with av.open(str(tmp_path / "rehearsal.mp4")) as whole:
        assert sum(1 for _ in whole.decode(video=0)) == FRAMES
