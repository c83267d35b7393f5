"""Where episodes start: the options of a reset, and the settled state, cached in a file for each configuration."""

import hashlib
import json
import sys
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import mpm
from mpm.array_files import MAX_STATE, read_arrays
from mpm.files import write
from robosim.base.digests import cache_folder, code_digest
from robosim.base.errors import ConfigError, UnknownName
from robosim.config.materials import MaterialConfig
from robosim.scene.settle import settle
from robosim.shapes import tool_shape
from robosim.tasks.counting import TOOL
from robosim.tasks.task import TaskConfig

FORMAT = 3
"""Raised when a change of robosim makes other starts out of the same configuration, see SETTLED_BY."""
SETTLED_BY = ("mpm", "robosim.scene.settle")
"""Modules whose code makes another start: a start that another version of them has settled is another one."""
SETTLING, WINDOW = 1.0, 5e-3
"""Time in which the grains settle, and interval between dampings [s]."""
ATTEMPTS = 8
"""Times that grains which fell off the tool are put back."""
SPACING = 0.006
"""Distance [m] between grains that are put back."""
HOLDING = 2.0
"""Time [s] for which a dosing tool has to hold its load at rest; other tools have to for as long as an episode."""
AXES, SPREAD = np.eye(3), np.eye(6)[[0, 3, 4, 3, 1, 5, 4, 5, 2]]
"""Rotation of no angle, and the strain's matrix, row by row (9, 6), out of xx, yy, zz, xy, xz, yz."""
BLOCK = 1024
"""Rows of an array that are multiplied at once."""
NOT_IN_START = {"description", "reward", "success", "script", "action", "goal", "target", "randomize", "dose",
                "coupling"}
"""Parts of a task that its start does not depend on."""


class StartOptions(NamedTuple):
    """Where an episode starts, as the options of a reset say."""

    nominal: bool = False
    """Whether nothing is drawn at random."""
    shift: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Displacement of the tool [m], within the box of commanded positions."""
    turn_deg: float = 0.0
    """Turn of the tool about the vertical through its origin."""
    draw: Any = None
    """What another episode has drawn, `info["draw"]` of its reset, in place of all else."""


def copy_options(options: dict[str, Any] | None) -> dict[str, Any]:
    """Return a copy of the options of a reset; raises ConfigError for what is no dict."""
    if not isinstance(options, dict | None):
        raise ConfigError(f"options of reset: {options!r:.60}; accepted: a dict of {', '.join(StartOptions._fields)}")
    return dict(options or {})


def read_start(options: dict[str, Any] | None) -> StartOptions:
    """Return the options of a reset.
    Raises UnknownName for one that does not exist, ConfigError for a value that cannot be used."""
    given = copy_options(options)
    unknown = set(given) - set(StartOptions._fields)
    if unknown:
        raise UnknownName("option of reset", sorted(unknown)[0], StartOptions._fields)
    if given.get("draw") is not None and len(given) > 1:
        others = ", ".join(sorted(set(given) - {"draw"}))
        raise ConfigError(f"options of reset: draw with {others}; accepted: draw alone")
    nominal = given.get("nominal", False)
    if not isinstance(nominal, bool | np.bool_):
        raise ConfigError(f"options of reset: nominal = {nominal!r:.60}; accepted: True or False")
    shift, turn = given.get("shift", (0.0, 0.0, 0.0)), given.get("turn_deg", 0.0)
    try:
        numbers = np.array(shift, float)
        if numbers.shape != (3,) or not np.isfinite([*numbers, float(turn)]).all():
            raise ValueError
    except (TypeError, ValueError):
        raise ConfigError(f"options of reset: shift = {shift!r}, turn_deg = {turn!r}; accepted: three lengths in "
                          f"metres and an angle") from None
    x, y, z = (float(value) for value in numbers)
    return StartOptions(bool(nominal), (x, y, z), float(turn), given.get("draw"))


def rotate_grains(state: dict[str, np.ndarray], R: np.ndarray) -> dict[str, np.ndarray]:
    """Return velocities and strains of a state after a rotation R (3, 3) of all that they belong to."""
    if np.abs(R - AXES).max() <= 1e-12:
        return {}
    both = (R[:, None, :, None] * R[None, :, None, :]).reshape(9, 9)  # of R C R^T, row by row
    matrices = {"v": R.T, "C": both.T, "e": (both @ SPREAD)[[0, 4, 8, 1, 2, 5]].T, "remainder": R.T}
    return {name: _multiply(state[name], matrix) for name, matrix in matrices.items() if name in state}


def _multiply(values: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Return values (n, k) times a matrix (k, k) in double precision, in the values' own.
    By blocks of rows: for all at once the memory of the products is allocated anew, which takes longer than they do."""
    result = np.empty_like(values)
    for first in range(0, len(values), BLOCK):
        result[first : first + BLOCK] = values[first : first + BLOCK] @ matrix
    return result


def settled_state(name: str, task: TaskConfig, material: MaterialConfig, solver: mpm.Solver,
                  variant: tuple[float, float] | None = None) -> dict[str, np.ndarray]:
    """Return a task's settled state, from the cache or settled now, and leave the solver in it.
    name: of the cache file. variant: fill and slope of grains that the solver was not built with.
    Raises mpm.InvalidValue where the tool cannot hold the grains."""
    numbers = {"law": type(material).__name__} | material.values()
    shapes = [str(collider.sdf.signature()) for collider in solver.colliders]
    mobile = "-arm" if solver.features.mobile else ""  # contact that moves the tool is solved in another order
    table = {"format": FORMAT, "precision": solver.precision, "material": numbers, "mobile": mobile, "shapes": shapes,
             "interior": tool_shape(task.tool).interior, "sleep": bool(solver.sleep), "dt": solver.dt,
             "code": code_digest(*SETTLED_BY, with_data=False), "transfer_interval": solver.transfer_interval,
             "variant": variant, "static": list(solver.features.static_colliders),
             "task": task.model_dump(mode="json", exclude=NOT_IN_START)}
    digest = hashlib.sha256(json.dumps(table, sort_keys=True).encode()).hexdigest()
    path = cache_folder("starts") / f"{name}-{digest[:16]}.npz"
    state = _read_state(path, digest, solver)
    if state is None:
        state = _settle(task, solver)
        # a tool that an arm carries has a state of its own, and the grains' is the same with and without it
        _write_state(path, digest, {key: value for key, value in state.items() if key not in solver.mobility.save()})
    solver.load(state)
    return state


def _settle(task: TaskConfig, solver: mpm.Solver) -> dict[str, np.ndarray]:
    """Settle the grains; those that fall off the tool within the time of an episode are put back on top."""
    interior = tool_shape(task.tool).interior
    if TOOL in solver.features.mobile:  # held until an arm carries it
        solver.set_collider_mobility(TOOL, np.zeros((6, 6)), np.zeros(6))
    fallen = np.zeros(0, bool)
    for _ in range(ATTEMPTS):
        settle(solver, solver.advance, SETTLING, WINDOW)
        if task.carried:
            solver.advance(task.steps * task.step_dt if task.dose is None else HOLDING)
        state = solver.state() | {"time": np.array(0.0), "steps": np.array(0)}
        local = solver.collider_pose(TOOL).inverse().apply(solver.positions())
        fallen = ~interior.holds(local)
        if not (task.carried and fallen.any()):
            return state
        if fallen.all():
            break
        top = solver.collider_pose(TOOL).apply(_top_positions(local[~fallen], interior, int(fallen.sum())))
        state["x"][fallen] = top - solver.grid.origin
        for name in {"v", "C", "e", "j", "vc"} & state.keys():
            state[name][fallen] = 0.0
        solver.load(state)
    raise mpm.InvalidValue(f"the {task.tool_name} does not hold {task.grains.count} grains: {fallen.sum()} keep "
                           f"falling off; accepted: fewer grains.count")


def _top_positions(held: np.ndarray, interior: mpm.Region, count: int) -> np.ndarray:
    """Return positions [m] (count, 3) on top of a heap's middle in the tool's frame; held: the heap's grains (n, 3)."""
    side = int(np.ceil(np.sqrt(min(count, 9))))
    grid = (np.arange(side) - (side - 1) / 2) * SPACING
    positions = np.array([[x, y, z * SPACING] for z in range(count // side**2 + 1) for x in grid for y in grid])[:count]
    middle = np.linalg.norm(held[:, :2] - interior.centre[:2], axis=1) < 1.5 * side * SPACING
    top = held[middle, 2].max() if middle.any() else held[:, 2].max()
    return positions + [interior.centre[0], interior.centre[1], top + SPACING]


def _read_state(path: Path, digest: str, solver: mpm.Solver) -> dict[str, np.ndarray] | None:
    """Read a state and load it into the solver; None where the file is missing or corrupt, as reported on stderr."""
    if not path.is_file():
        return None
    try:
        state = dict(read_arrays(path, MAX_STATE))
        made_for, checksum = str(state.pop("made_for")), str(state.pop("checksum"))
        is_whole = made_for == digest and checksum == _checksum(state)
        state |= solver.mobility.save()
        if is_whole:
            solver.load(state)
    except (OSError, ValueError, KeyError):
        is_whole, state = False, {}
    if not is_whole:
        print(f"robosim: cache file {path} is corrupt; rebuilding", file=sys.stderr)
    return state if is_whole else None


def _write_state(path: Path, digest: str, state: dict[str, np.ndarray]) -> None:
    """Write a state, as other processes may at the same time; report a folder that cannot be written to on stderr."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write(path, lambda temporary: np.savez(temporary, made_for=digest, checksum=_checksum(state),
                                               **state))  # pyright: ignore[reportArgumentType]
    except OSError as error:
        print(f"robosim: cannot write the cache file {path}: {error}", file=sys.stderr)


def _checksum(state: dict[str, np.ndarray]) -> str:
    total = hashlib.sha256()
    for key in sorted(state):
        total.update(key.encode() + np.ascontiguousarray(state[key]).tobytes())
    return total.hexdigest()
