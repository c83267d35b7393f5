"""A LeRobot dataset has the demonstrations step by step; LeRobot's own package opens it where it is installed."""

import json
import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import av
import numpy as np
import pytest

import mpm
from policies.demonstrations import lerobot_dataset
from policies.demonstrations.export import export_lerobot
from policies.demonstrations.reading import PlayedDemonstration
from policies.learning.environments import make_environment
from robosim.episode.play import Transition, run_episode

TASK, REPEAT = "SpoonTranslate", 100
READ = """
import json, sys
from lerobot.datasets.lerobot_dataset import LeRobotDataset
data = LeRobotDataset("local/demonstrations", root=sys.argv[1], video_backend="pyav")
rows = [data[k] for k in range(len(data))]
print(json.dumps({"episodes": data.num_episodes, "fps": data.fps, "task": rows[0]["task"],
                  "actions": [row["action"].tolist() for row in rows],
                  "states": [row["observation.state"].tolist() for row in rows],
                  "shape": list(rows[0]["observation.images.task"].shape),
                  "means": [float(row["observation.images.task"].mean()) for row in rows],
                  "action_mean": data.meta.stats["action"]["mean"].tolist()}))
"""


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Return the folders of two demonstrations and of the dataset made of them."""
    pytest.importorskip("pyarrow")
    folder = tmp_path_factory.mktemp("lerobot")
    for k in range(2):
        actions = np.random.default_rng(k).uniform(-0.2, 0.2, (10, 3)).astype(np.float32)
        np.savez(folder / f"demonstration_{k}.npz", actions=actions, action_repeat=REPEAT, nominal=True)
    assert export_lerobot(TASK, folder, folder / "dataset", obs="moments", action_repeat=REPEAT) == 0
    return folder, folder / "dataset"


def played(folder: Path) -> list[list]:
    env = make_environment(TASK, obs="moments", action_repeat=REPEAT)
    return [list(run_episode(env, np.load(folder / f"demonstration_{k}.npz")["actions"], seed=0,
                             options={"nominal": True})) for k in range(2)]


@pytest.mark.slow
def test_tables_and_film_have_the_demonstrations_step_by_step(dataset: tuple[Path, Path]) -> None:
    import pyarrow.parquet as pq

    folder, out = dataset
    info = json.loads((out / "meta" / "info.json").read_text())
    assert info["codebase_version"] == "v3.0" and info["total_frames"] == 20 and info["fps"] == 5.0
    table = pq.read_table(out / "data" / "chunk-000" / "file-000.parquet").to_pydict()
    transitions = [t for episode in played(folder) for t in episode]
    assert np.allclose(table["action"], [t.action for t in transitions])
    assert np.allclose(table["observation.state"], [t.observation for t in transitions], atol=1e-6)
    assert np.allclose(table["next.reward"], [t.reward for t in transitions], atol=1e-5)
    assert table["frame_index"] == [*range(10), *range(10)] and table["index"] == list(range(20))
    assert np.allclose(table["timestamp"][:10], np.arange(10) / 5.0) and table["next.done"].count(True) == 2
    episodes = pq.read_table(out / "meta" / "episodes" / "chunk-000" / "file-000.parquet").to_pydict()
    assert episodes["dataset_to_index"] == [10, 20]
    assert episodes["videos/observation.images.task/to_timestamp"] == [2.0, 4.0]
    stats = json.loads((out / "meta" / "stats.json").read_text())
    assert np.allclose(stats["action"]["mean"], np.mean(table["action"], 0), atol=1e-7)
    assert np.allclose(stats["action"]["std"], np.std(table["action"], 0), atol=1e-7)
    with av.open(str(out / "videos" / "observation.images.task" / "chunk-000" / "file-000.mp4")) as film:
        pictures = [frame.to_ndarray(format="rgb24") for frame in film.decode(video=0)]
    assert len(pictures) == 20 and pictures[0].shape == (480, 640, 3) and pictures[0].std() > 20
    first = pictures[0].astype(int)  # both begin at the same start
    assert np.abs(first - pictures[10]).mean() < 2 < np.abs(first - pictures[9]).max()


@pytest.mark.slow
def test_lerobot_opens_it(dataset: tuple[Path, Path]) -> None:
    python = os.environ.get("LEROBOT_PYTHON") or (sys.executable if find_spec("lerobot") else "")
    if not python:
        pytest.skip("needs LeRobot, whose requirements do not go with ours: python3 -m venv lerobot && "
                    "lerobot/bin/pip install lerobot, then LEROBOT_PYTHON=lerobot/bin/python")
    folder, out = dataset
    done = subprocess.run([python, "-c", READ, str(out)], capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    read = json.loads(done.stdout.strip().splitlines()[-1])
    transitions = [t for episode in played(folder) for t in episode]
    assert read["episodes"] == 2 and read["fps"] == 5 and read["shape"] == [3, 480, 640] and "spoon" in read["task"]
    assert np.allclose(read["actions"], [t.action for t in transitions])
    assert np.allclose(read["states"], [t.observation for t in transitions], atol=1e-6)
    assert np.allclose(read["action_mean"], np.mean(read["actions"], 0), atol=1e-6) and min(read["means"]) > 0.1


def test_long_datasets_are_divided_between_episodes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Three episodes of which two fit into a file: every row says in which file, and from when on in its film."""
    pq = pytest.importorskip("pyarrow.parquet")
    monkeypatch.setattr(lerobot_dataset, "FRAMES_PER_FILE", 21)
    steps = [Transition(np.full(2, k), np.full(2, k), np.full(3, k), 0.0, False, {}) for k in range(10)]
    pictures = np.random.default_rng(0).integers(0, 255, (10, 48, 64, 3), np.uint8)
    lerobot_dataset.write_lerobot_dataset(tmp_path / "set", [PlayedDemonstration("one", 0, steps, pictures)] * 3,
                                          fps=5.0, task="pour", robot="spoon", state="flat")
    rows = pq.read_table(tmp_path / "set" / "meta" / "episodes").to_pydict()
    assert rows["data/file_index"] == rows["videos/observation.images.task/file_index"] == [0, 0, 1]
    assert rows["videos/observation.images.task/from_timestamp"] == [0.0, 2.0, 0.0]
    assert rows["dataset_from_index"] == [0, 10, 20]
    for number, frames in ((0, 20), (1, 10)):
        table = pq.read_table(tmp_path / "set" / "data" / "chunk-000" / f"file-{number:03d}.parquet").to_pydict()
        assert len(table["index"]) == frames and table["index"][0] == 20 * number
        film = tmp_path / "set" / "videos" / "observation.images.task" / "chunk-000" / f"file-{number:03d}.mp4"
        with av.open(str(film)) as opened:
            assert sum(1 for _ in opened.decode(video=0)) == frames


def test_what_exists_is_not_replaced(dataset: tuple[Path, Path]) -> None:
    folder, out = dataset
    before = sorted(path.name for path in folder.iterdir())
    with pytest.raises(mpm.InvalidValue, match="exists; accepted: a new folder"):
        export_lerobot(TASK, folder, out, obs="moments", action_repeat=REPEAT, with_pictures=False)
    with pytest.raises(mpm.InvalidValue, match="a layout that is one array"):
        export_lerobot(TASK, folder, folder / "other", obs="dict", action_repeat=REPEAT, with_pictures=False)
    assert sorted(path.name for path in folder.iterdir()) == before
