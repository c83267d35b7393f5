"""The settled state that episodes start from: made once per configuration, kept in a file, checked when read."""

import hashlib
import json
import os
import sys
import tempfile
import zipfile
from pathlib import Path

import numpy as np
import platformdirs

import mpm
from mpm.geometry.sampled_sdf import Lattice
from robosim.config.materials import MaterialConfig
from robosim.scene.settle import settle
from robosim.shapes import tool_shape
from robosim.tasks.counting import TOOL
from robosim.tasks.task import TaskConfig

FORMAT = 2
"""Raised when a change of the code makes other starts out of the same configuration."""
SETTLING, WINDOW = 1.0, 5e-3
"""Time to settle [s], and between two dampings of it."""
ATTEMPTS = 8
NOT_IN_START = {"description", "reward", "success", "script", "action", "goal", "target"}
"""Parts of a task that its start does not depend on."""


def cache_folder() -> Path:
    """Where settled states are kept: ROBOSIM_CACHE, or the user's cache folder."""
    return Path(os.environ.get("ROBOSIM_CACHE") or platformdirs.user_cache_dir("robosim")) / "starts"


def settled(name: str, task: TaskConfig, material: MaterialConfig, solver: mpm.Solver) -> dict[str, np.ndarray]:
    """The settled state of a task: from its file, or made and kept there; the solver is left in it."""
    numbers = {"law": type(material).__name__} | {n: getattr(material, n).value for n in material.numbers()}
    shapes = [hashlib.sha256(collider.sdf.host.tobytes()).hexdigest() for collider in solver.colliders
              if isinstance(collider.sdf, Lattice)]
    mobile = "-arm" if solver.features.mobile else ""  # contact that moves the tool is solved in another order
    digest = _digest({"format": FORMAT, "precision": solver.precision, "material": numbers, "mobile": mobile,
                      "shapes": shapes, "interior": tool_shape(task.tool).interior,
                      "transfer_interval": solver.transfer_interval,
                      "task": task.model_dump(mode="json", exclude=NOT_IN_START)})
    path = cache_folder() / f"{name}-{digest[:16]}.npz"
    state = _read(path, digest, solver)
    if state is None:
        state = _settle(task, solver)
        # a tool that an arm carries has a state of its own; the grains' is the same
        _keep(path, digest, {key: value for key, value in state.items() if key not in solver.mobility.kept()})
    solver.load(state)
    return state


def _digest(words: dict) -> str:
    """Of a table of plain values."""
    return hashlib.sha256(json.dumps(words, sort_keys=True).encode()).hexdigest()


def _checksum(state: dict[str, np.ndarray]) -> str:
    """Of all arrays."""
    total = hashlib.sha256()
    for key in sorted(state):
        total.update(key.encode() + np.ascontiguousarray(state[key]).tobytes())
    return total.hexdigest()


def _read(path: Path, digest: str, solver: mpm.Solver) -> dict[str, np.ndarray] | None:
    """The state kept in a file, or None where there is none or it is damaged; says so."""
    if not path.is_file():
        return None
    try:
        # opened here: numpy leaves a damaged file open
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
            state = {key: stored[key] for key in stored.files}
        made_for, checksum = str(state.pop("made_for")), str(state.pop("checksum"))
        fits = made_for == digest and checksum == _checksum(state)
        state |= solver.mobility.kept()
        if fits:
            solver.load(state)
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        fits, state = False, {}
    if not fits:
        print(f"robosim: the settled start {path} is damaged; it is made anew", file=sys.stderr)
    return state if fits else None


def _keep(path: Path, digest: str, state: dict[str, np.ndarray]) -> None:
    """Write beside and rename; a folder that cannot be written to costs the next start its time, nothing else."""
    beside = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        # a name of its own: several processes may make the same start at once
        with tempfile.NamedTemporaryFile(dir=path.parent, suffix=".npz", delete=False) as file:
            beside = Path(file.name)
            np.savez(file, made_for=digest, checksum=_checksum(state), **state)  # pyright: ignore[reportArgumentType]
        os.replace(beside, path)
    except OSError as error:
        print(f"robosim: the settled start is not kept: {error}", file=sys.stderr)
        if beside is not None:
            beside.unlink(missing_ok=True)


def _settle(task: TaskConfig, solver: mpm.Solver) -> dict[str, np.ndarray]:
    """Let the grains come to rest; what falls off the tool, then or in the time of an episode, is put back on top until
    all of them stay."""
    interior = tool_shape(task.tool).interior
    fallen = np.zeros(0, bool)
    for _ in range(ATTEMPTS):
        settle(solver, solver.advance, SETTLING, WINDOW)
        if task.carried:
            solver.advance(task.steps * task.step_dt)
        state = solver.state() | {"time": np.array(0.0), "steps": np.array(0)}
        local = solver.collider_pose(TOOL).inverse().apply(solver.positions())
        fallen = ~interior.holds(local)
        if not (task.carried and fallen.any()):
            return state
        if fallen.all():
            break
        place = solver.collider_pose(TOOL).apply(_on_top(local[~fallen], interior, int(fallen.sum())))
        state["x"][fallen] = place - solver.grid.origin
        for name in {"v", "C", "e", "j", "vc"} & state.keys():
            state[name][fallen] = 0.0
        solver.load(state)
    raise mpm.InvalidValue(f"the {task.tool} does not hold {task.grains.count} grains: {fallen.sum()} keep falling "
                           f"off; accepted: fewer grains.count")


def _on_top(held: np.ndarray, interior: mpm.Region, count: int) -> np.ndarray:
    """Places (count, 3) in the tool's frame on top of the heap's middle, a grain apart."""
    spacing = 0.006
    side = int(np.ceil(np.sqrt(min(count, 9))))
    grid = (np.arange(side) - (side - 1) / 2) * spacing
    places = np.array([[x, y, z * spacing] for z in range(count // side**2 + 1) for x in grid for y in grid])[:count]
    middle = np.linalg.norm(held[:, :2] - interior.centre[:2], axis=1) < 1.5 * side * spacing
    top = held[middle, 2].max() if middle.any() else held[:, 2].max()
    return places + [interior.centre[0], interior.centre[1], top + spacing]
