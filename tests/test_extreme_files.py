"""Files that are damaged, or that lie: every reader raises the project's own errors alone, within 2 GB and 10 s."""

import itertools
import json
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pytest
from extreme_values import FILLS, SMALL, array_files, damaged, fuzz, handle, json_files, places, replaced

import mpm
from policies.demonstrations.action_repeat import ActionRepeat
from policies.demonstrations.demo import first_actions
from policies.demonstrations.descent import STATE, Descent
from policies.demonstrations.generator import load_stored
from policies.demonstrations.reading import demonstration_paths, read_actions, read_start
from policies.dynamics.rollouts import describe_environment, read_rollouts
from policies.learning.presets import load_preset
from policies.results.rows import ROW as ROW_FORM
from policies.results.tables import PUBLISHED, collect_rows, fill_page, read_table, summarise_runs
from policies.runs.run_folder import RunFolder
from policies.runs.sweep_file import SweepRun
from robosim.base.digests import cache_folder, digest
from robosim.base.files import write_rows
from robosim.base.resources import folder
from robosim.base.study import Store
from robosim.config.materials import load_material
from robosim.config.table import read
from robosim.envs.start import settled_state
from robosim.planning.recorded_motions import load_motion
from robosim.reports.page import Page
from robosim.reports.plot import Plot
from robosim.studies.policies.make import make_policy, training_options
from robosim.studies.verification.report import read_json, read_peers
from robosim.studies.verification.report_page import add_comparison, draw_peers
from robosim.tasks.task import load_task

TASK = load_task("SpoonTranslate")
STEPS = -(-TASK.steps // 10)
ENV: Any = type("Env", (SimpleNamespace,), {"TASK": "SpoonTranslate"})(
    source="SpoonTranslate", task=TASK, material=load_material("salt"), action_repeat=10,
    observation=np.zeros(5), observation_space=SimpleNamespace(shape=(5,)), solver=SimpleNamespace(),
    world=SimpleNamespace(grains=lambda: np.zeros((4, 6)), observer=SimpleNamespace(names="flat")), step_count=0)
"""What readers ask an environment for."""
MOVE = load_task("ShovelMove")
SOLVER: Any = SimpleNamespace(
    precision="f32", colliders=[], sleep=False, transfer_interval=0.0, dt=1e-4, load=lambda state: None,
    advance=lambda duration: None, features=SimpleNamespace(mobile=(), static_colliders=()),
    mobility=SimpleNamespace(save=dict), state=lambda: {name: np.zeros((4, 3)) for name in ("x", "v")},
    positions=lambda: np.zeros((4, 3)), collider_pose=lambda index: mpm.Pose.identity())
"""What a settled start asks a solver for."""
FEW_AND_MANY = [20, pytest.param(300, marks=pytest.mark.slow)]
"""Examples of a fuzz test."""
ACTIONS = {"actions": np.zeros((STEPS, 3), np.float32), "action_repeat": np.array(10), "seed": np.array(3),
           "task": np.array("SpoonTranslate"), "nominal": np.array(True), "start": np.array(2),
           "needed": np.array(STEPS), "fingerprint": np.array("f"), "losses": np.zeros(3), "norms": np.zeros((5, 2))}
NETWORK = {"weight_0": np.zeros((8, 5)), "bias_0": np.zeros(8), "weight_1": np.zeros((3, 8)), "bias_1": np.zeros(3),
           "activations": np.array(["relu", "none"]), "bound": np.array("tanh"), "obs": np.array("flat"),
           "task": np.array("SpoonTranslate"), "action_repeat": np.array(10)}


def follow(path: Path) -> None:
    training_options(str(path))
    assert make_policy(str(path), ENV, 0)(ENV.observation).shape == (3,)


def read_demonstration(path: Path) -> None:
    """Read a file as each command reads demonstrations."""
    demonstration_paths(path)
    read_start(path)
    assert read_actions(path, STEPS, 10, 3, "SpoonTranslate").shape == (STEPS, 3)


def continue_search(path: Path) -> None:
    stored = load_stored(path, "f")
    assert stored is not None
    search = Descent(np.zeros((STEPS, 3)), 0.05, 0)
    search.load(stored)
    search.step(1.0, np.ones((STEPS, 3)))


def search_state() -> dict[str, np.ndarray]:
    search = Descent(np.zeros((STEPS, 3)), 0.05, 0)
    search.step(1.0, np.ones((STEPS, 3)))
    assert set(search.state()) == set(STATE)
    return {**search.state(), **{key: ACTIONS[key] for key in ("fingerprint", "losses", "norms")}}


def read_rollout(path: Path) -> None:
    for k in range(2):
        (path.parent / f"rollout_0000{k}.npz").write_bytes(path.read_bytes())
    (path.parent / "rollouts.json").write_text(json.dumps(describe_environment(ENV)))
    assert len(read_rollouts(path.parent, ENV).grains) == 2


def read_start_state(path: Path) -> None:
    """Read a settled start, which is made again where it is damaged."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROBOSIM_CACHE", str(path.parent))
        settled_state("test", MOVE, ENV.material, SOLVER)  # leaves a file, whose name this test does not know
        (kept,) = cache_folder("starts").glob("test-*.npz")
        kept.write_bytes(path.read_bytes())
        assert settled_state("test", MOVE, ENV.material, SOLVER)["x"].shape == (4, 3)


class Reader(NamedTuple):
    read: Callable[[Path], object]
    content: dict[str, Any]
    """Arrays, or a table, of a file that it accepts."""
    name: str = "file.json"


ARRAYS = {
    "motion of a policy": Reader(follow, ACTIONS), "network": Reader(follow, NETWORK),
    "motion of a rehearsal": Reader(lambda path: load_motion(path, "SpoonTranslate", TASK), ACTIONS),
    "demonstration": Reader(read_demonstration, ACTIONS),
    "begin of a search": Reader(lambda path: first_actions(path, None, TASK, ActionRepeat(TASK, 10)), ACTIONS),
    "unfinished search": Reader(continue_search, search_state()),
    "rollout": Reader(read_rollout, {"grains": np.zeros((3, 4, 3)), "tool": np.zeros((3, 7))}),
    "settled start": Reader(read_start_state, {"x": np.zeros((4, 3)), "made_for": np.array("digest"),
                                               "checksum": np.array("c")}),
}


def tabulate(path: Path) -> None:
    """Make the tables of runs."""
    rows, _ = collect_rows([path if path.name == "tables.json" else path.parent])
    if path.name == "tables.json":
        assert rows == read_table(path)
    published = read(folder("configs") / "published" / PUBLISHED)
    summaries, notes = summarise_runs(rows, published)
    json.dumps(summaries, allow_nan=False)
    page = Page("tables")
    fill_page(page, summaries, published, [path], {"notes": notes})
    page.html()
    if rows:
        write_rows(path.parent / "tables.csv", rows)


def continue_run(path: Path) -> None:
    """Look at a run's folder as `robosim sweep` and `robosim train` do."""
    assert isinstance(SweepRun(path.parent, ["train", "sac"], PRESET).state, str)
    run = RunFolder(path.parent, MANIFEST)
    run.update_status("running")
    run.close()


def compare(path: Path) -> None:
    page = Page("report")
    add_comparison(page, read_json(path), REPORT)
    page.html()


def draw_points(path: Path) -> None:
    draw_peers(Plot("collapse", "seconds", "error"), read_peers(path))


PRESET = load_preset("sac").model_dump()
ROW: dict[str, Any] = {
    **dict.fromkeys(ROW_FORM, 1.5), "task": "SpoonPour", "method": "dg_sac", "material": "salt", "seed": 0,
    "starts": "nominal", "action_repeat": 10, "obs": "flat", "max_episodes": 5, "commit": "c", "episodes": 5,
    "preset": "p", "demonstrations": None, "n_envs": 1, "task_digest": "t", "field": "f", "code": {"mpm.solver": "d"},
    "command": "robosim train", "curve": [1.0, 2.0]}
REPORT: dict[str, Any] = {
    "made_by": {"commit": "c", "machine": "m"}, "runs": [
        {"case": "vortex", "choices": {"cells": 8}, "failed": "", "record": {
            "case": "vortex", "choices": {"cells": 8}, "particles": 10, "steps": 5, "seconds": 1.0,
            "compile_seconds": 2.0, "errors": {"velocity": 0.01}, "readings": {}, "peak_bytes": 100}}]}
MANIFEST = {"method": "sac", "preset": PRESET, "task": "SpoonPour", "seed": 0, "material": "salt", "starts": "nominal",
            "action_repeat": 10, "n_envs": 1, "commit": "c", "command": "robosim train sac"}
STATUS = {"state": "finished", "replayed": {"tcs": 5.0, "delivered": 0.5}, "last": {"tcs": 4.0, "return": 1.0},
          "seconds": 10.0, "episodes": 5, "best_return": 1.0}
TABLES = {
    "tables of runs": Reader(tabulate, {"runs": [ROW]}, "tables.json"),
    "status of a run": Reader(tabulate, STATUS, "status.json"),
    "manifest of a run": Reader(tabulate, MANIFEST, "manifest.json"),
    "status to continue": Reader(continue_run, {**STATUS, "state": "running"}, "status.json"),
    "manifest to continue": Reader(continue_run, MANIFEST, "manifest.json"),
    "earlier report": Reader(compare, REPORT),
    "points of other codes": Reader(draw_points, {"reference": {"r_final_m": 0.1}, "points": [
        {"code": "other", "cell_m": 0.01, "seconds": 1.0, "r99_m": 0.2, "particles": 10}]}),
    "row of a study": Reader(lambda path: Store(path.parent).find(path.stem), {
        "key": "k", "checksum": digest({"score": 1.0}), "value": {"score": 1.0}}, "k.json"),
}
BESIDE = {"status.json": ("manifest.json", MANIFEST), "manifest.json": ("status.json", STATUS)}
"""File of a run's folder -> the other one."""


@pytest.mark.slow
def test_damaged_checkpoints_are_refused_or_borne(tmp_path: Path) -> None:
    """Its checksums are compared before its pickles are loaded, and its signature before both."""
    from policies.runs import checkpoint  # loads torch

    path, content = tmp_path / "checkpoint.zip", checkpoint.pack(None, episodes=5)
    path.write_bytes(content)
    assert checkpoint.load(path, None, None)[1]["episodes"] == 5
    fuzz(damaged(content), 300, lambda changed: (path.write_bytes(changed), checkpoint.load(path, is_trusted=True)))


@pytest.mark.parametrize("examples", FEW_AND_MANY)
@pytest.mark.parametrize("name", ARRAYS)
def test_arrays_are_refused_or_borne(name: str, examples: int, tmp_path: Path) -> None:
    path, reader = tmp_path / "file.npz", ARRAYS[name]
    np.savez(path, **reader.content)  # pyright: ignore[reportArgumentType]
    assert not handle(lambda: reader.read(path))[1]
    fuzz(array_files(reader.content), examples, lambda content: (path.write_bytes(content), reader.read(path)))


@pytest.mark.parametrize("name", ARRAYS)
def test_every_array_is_refused_or_borne_with_every_value(name: str, tmp_path: Path) -> None:
    """In its own shape, and as a single value."""
    path, reader = tmp_path / "file.npz", ARRAYS[name]
    for (key, array), fill in itertools.product(reader.content.items(), FILLS):
        for shape in {array.shape, ()}:
            np.savez(path, **{**reader.content, key: np.full(shape, fill)})  # pyright: ignore[reportArgumentType]
            handle(lambda: reader.read(path))


def make_place(name: str, folder: Path) -> Path:
    """The path of a table's file, in a folder with the other files that its reader needs."""
    path = folder / TABLES[name].name
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.name in BESIDE and path.parent == folder:
        other, table = BESIDE[path.name]
        (folder / other).write_text(json.dumps(table))
    return path


@pytest.mark.slow
@pytest.mark.parametrize("name", TABLES)
def test_every_place_of_a_table_is_refused_or_borne_with_every_value(name: str, tmp_path: Path) -> None:
    reader, path = TABLES[name], make_place(name, tmp_path)
    for place, wild in itertools.product(places(reader.content), (*SMALL, ...)):
        path.write_text(json.dumps(replaced(reader.content, place, wild), default=str))
        handle(lambda: reader.read(path))


@pytest.mark.parametrize("examples", FEW_AND_MANY)
@pytest.mark.parametrize("name", TABLES)
def test_tables_are_refused_or_borne(name: str, examples: int, tmp_path: Path) -> None:
    reader, path = TABLES[name], make_place(name, tmp_path)
    path.write_text(json.dumps(reader.content))
    assert not handle(lambda: reader.read(path))[1]
    fuzz(json_files(reader.content), examples, lambda content: (path.write_bytes(content), reader.read(path)))
