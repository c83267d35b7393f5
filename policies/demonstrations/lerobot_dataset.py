"""Demonstrations as a LeRobot dataset of version 3: parquet, mp4 and meta.
Source of the layout: https://huggingface.co/docs/lerobot/lerobot-dataset-v3."""

import json
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa  # pyright: ignore[reportMissingImports]  (of the extra `lerobot`)
import pyarrow.parquet as pq  # pyright: ignore[reportMissingImports]

import mpm
from mpm.files import temporary_path
from policies.demonstrations.reading import PlayedDemonstration
from robosim.rendering.video import Mp4Writer

VERSION = "v3.0"
FILES_PER_CHUNK = 1000
FRAMES_PER_FILE = 10_000
"""Frames after which the next episode begins a file of its own, so that no reader loads a whole dataset at once."""
CAMERA = "observation.images.task"
INDICES = {"timestamp": "float32", "frame_index": "int64", "episode_index": "int64", "index": "int64",
           "task_index": "int64"}
"""Columns that every dataset has."""
TYPES = {"float32": pa.float32(), "int64": pa.int64(), "bool": pa.bool_()}
SAMPLED_PICTURES = 100
"""About how many pictures statistics of colours are of."""


def write_lerobot_dataset(out: Path, episodes: Sequence[PlayedDemonstration], *, fps: float, task: str, robot: str,
                          state: str) -> None:
    """Write a dataset as the folder `out`, whole or not at all.
    fps: decisions per second. task: what is done, in words. state: layout of the observations. Raises mpm.InvalidValue
    where `out` exists."""
    if out.exists():
        raise mpm.InvalidValue(f"--out {out}: exists; accepted: a new folder")
    unfinished = temporary_path(out)
    try:
        _write(unfinished, episodes, fps, task, robot, state)
        unfinished.replace(out)
    finally:
        shutil.rmtree(unfinished, ignore_errors=True)


def _write(root: Path, episodes: Sequence[PlayedDemonstration], fps: float, task: str, robot: str, state: str) -> None:
    first = episodes[0].transitions[0]
    lengths = np.array([len(episode.transitions) for episode in episodes])
    ends = np.cumsum(lengths)
    begins, file = ends - lengths, _divide(lengths)
    features: dict[str, Any] = {
        "observation.state": _feature("float32", [f"{state}_{k}" for k in range(len(first.observation))]),
        "action": _feature("float32", [f"velocity_{k}" for k in range(len(first.action))]),
        "next.reward": _feature("float32"), "next.done": _feature("bool")}
    if episodes[0].pictures is not None:
        _, height, width, _ = episodes[0].pictures.shape
        for number in range(file[-1] + 1):
            with Mp4Writer(root / "videos" / CAMERA / f"{_place(number)}.mp4", fps, keyframes=2) as film:
                for shown in (episodes[int(k)].pictures for k in np.flatnonzero(file == number)):
                    for picture in shown if shown is not None else ():
                        film.add(picture)
        features[CAMERA] = {"dtype": "video", "shape": [height, width, 3], "names": ["height", "width", "channels"],
                            "info": {"video.height": height, "video.width": width, "video.codec": "h264",
                                     "video.pix_fmt": "yuv420p", "video.is_depth_map": False, "video.fps": fps,
                                     "video.channels": 3, "has_audio": False}}
    features |= {name: _feature(kind) for name, kind in INDICES.items()}
    steps = [step for episode in episodes for step in episode.transitions]
    pictures = [picture for episode in episodes if episode.pictures is not None for picture in episode.pictures]
    number, index = np.repeat(np.arange(len(episodes)), lengths), np.arange(len(steps))
    frame = index - begins[number]
    columns = {name: np.asarray(part, features[name]["dtype"]) for name, part in {
        "observation.state": [step.observation for step in steps], "action": [step.action for step in steps],
        "next.reward": [step.reward for step in steps], "next.done": frame == lengths[number] - 1,
        "timestamp": frame / fps, "frame_index": frame, "episode_index": number, "index": index,
        "task_index": np.zeros(len(steps))}.items()}

    def describe(begin: int, end: int) -> dict[str, Any]:
        stats = {name: summarize(part[begin:end].reshape(end - begin, -1).astype(float))
                 for name, part in columns.items()}
        return stats | ({CAMERA: summarize_pictures(pictures[begin:end])} if pictures else {})

    def row_of(k: int) -> dict[str, Any]:
        begin, end, shift = int(begins[k]), int(ends[k]), int(begins[file == file[k]][0])
        place = dict(zip(("chunk_index", "file_index"), map(int, divmod(file[k], FILES_PER_CHUNK))))
        row = {"episode_index": k, "tasks": [task], "length": end - begin,
               **{f"data/{key}": value for key, value in place.items()},
               "dataset_from_index": begin, "dataset_to_index": end}
        if pictures:
            times = {"from_timestamp": (begin - shift) / fps, "to_timestamp": (end - shift) / fps}
            row |= {f"videos/{CAMERA}/{key}": value for key, value in {**place, **times}.items()}
        return {**row, **{f"stats/{name}/{key}": value for name, one in describe(begin, end).items()
                          for key, value in one.items()}, "meta/episodes/chunk_index": 0, "meta/episodes/file_index": 0}

    rows = [row_of(k) for k in range(len(episodes))]
    for one in range(file[-1] + 1):
        part = slice(int(begins[file == one][0]), int(ends[file == one][-1]))
        _write_table(root / "data" / f"{_place(one)}.parquet", {
            name: _column(values[part], features[name]) for name, values in columns.items()})
    _write_table(root / "meta" / "episodes" / f"{_place(0)}.parquet", {
        key: pa.array([row[key] for row in rows]) for key in rows[0]})
    _write_tasks(root / "meta" / "tasks.parquet", task)
    info = {"codebase_version": VERSION, "robot_type": robot, "total_episodes": len(episodes), "total_tasks": 1,
            "total_frames": len(steps), "chunks_size": FILES_PER_CHUNK, "data_files_size_in_mb": 100,
            "video_files_size_in_mb": 200, "fps": fps, "splits": {"train": f"0:{len(episodes)}"},
            "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
            "video_path": "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
            if pictures else None, "features": features}
    (root / "meta" / "info.json").write_text(json.dumps(info, indent=4), encoding="utf-8")
    (root / "meta" / "stats.json").write_text(json.dumps(describe(0, len(steps)), indent=4), encoding="utf-8")


def _divide(lengths: np.ndarray) -> np.ndarray:
    """Return the number of the file (n,) of each episode, by their numbers of frames (n,)."""
    files, frames = [0], 0
    for length in lengths:
        files.append(files[-1] + int(frames > 0 and frames + length > FRAMES_PER_FILE))
        frames = int(length) + (frames if files[-1] == files[-2] else 0)
    return np.array(files[1:])


def _place(file: int) -> str:
    """Return the place of a file of any kind, without its ending."""
    return "chunk-{:03d}/file-{:03d}".format(*divmod(file, FILES_PER_CHUNK))


def _feature(kind: str, names: list[str] | None = None) -> dict[str, Any]:
    return {"dtype": kind, "shape": [1 if names is None else len(names)], "names": names}


def _column(values: np.ndarray, feature: dict[str, Any]) -> Any:
    kind = TYPES[feature["dtype"]]
    if feature["shape"] == [1]:
        return pa.array(values.ravel(), kind)
    return pa.FixedSizeListArray.from_arrays(pa.array(values.ravel(), kind), feature["shape"][0])


def _write_table(path: Path, columns: dict[str, Any]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    pq.write_table(pa.table(columns), path, compression="snappy")


def _write_tasks(path: Path, task: str) -> None:
    """Write the table of tasks, whose index of pandas is their text."""
    table = pa.table({"task_index": pa.array([0], pa.int64()), "__index_level_0__": pa.array([task])})
    index = {"index_columns": ["__index_level_0__"], "column_indexes": [], "columns": [
        {"name": "task_index", "field_name": "task_index", "pandas_type": "int64", "numpy_type": "int64",
         "metadata": None},
        {"name": None, "field_name": "__index_level_0__", "pandas_type": "unicode", "numpy_type": "object",
         "metadata": None}], "pandas_version": "2.0.0"}
    path.parent.mkdir(parents=True, exist_ok=True)
    pq.write_table(table.replace_schema_metadata({"pandas": json.dumps(index)}), path)


def summarize(values: np.ndarray) -> dict[str, list[Any]]:
    """Return statistics of values (T, n), over time."""
    return {"min": values.min(0).tolist(), "max": values.max(0).tolist(), "mean": values.mean(0).tolist(),
            "std": values.std(0).tolist(), "count": [len(values)]}


def summarize_pictures(pictures: Sequence[np.ndarray]) -> dict[str, Any]:
    """Return statistics of colours from 0 to 1, each (3, 1, 1)."""
    chosen = np.stack(pictures[:: max(1, len(pictures) // SAMPLED_PICTURES)]).reshape(-1, 3) / 255.0
    return {key: np.reshape(value, (3, 1, 1)).tolist() if key != "count" else [len(pictures)]
            for key, value in summarize(chosen).items()}
