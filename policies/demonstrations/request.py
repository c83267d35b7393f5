"""What demonstrations are to be made, and the files that they are stored in."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import mpm
from mpm.array_files import StoredArrays, read_arrays
from policies.learning.environments import fingerprint, make_environment
from policies.learning.options import SearchOptions

CLAY = "clay"
"""Material of the search where the tool is empty at the start. A fluid's surface lies below the rim of a level spoon
that stands on the container's floor, so that there is nothing to scoop."""
FLUID = "glycerol"
"""Not water, which splashes: over a pour its derivatives by positions grow by four orders of magnitude, glycerol's by
two."""


def surrogate_material(task: Any) -> str:
    """Return the material that demonstrations of a task are searched in."""
    return FLUID if task.carried else CLAY


class DemonstrationRequest(NamedTuple):
    """The settings that all demonstrations of a folder share."""

    task: str
    """Name of a sub-task, or a task's .yaml file."""
    out: Path
    material: str
    """Material of the search."""
    first_actions: np.ndarray
    """(decisions, dimensions), where the search begins."""
    fixed: int
    """Number of first actions that the search does not change."""
    options: SearchOptions

    @property
    def name(self) -> str:
        """The task's name in files."""
        return Path(self.task).stem

    def path(self, k: int) -> Path:
        """Return the file of demonstration k."""
        return self.out / f"demonstration_{k}.npz"

    def unfinished_path(self, k: int) -> Path:
        """Return the file of demonstration k while its search runs."""
        return self.out / f"demonstration_{k}.unfinished.npz"

    def reset_arguments(self, k: int) -> dict[str, Any]:
        """Return the arguments of the environment's reset for demonstration k."""
        return {"seed": self.options.seed + k, "options": {"nominal": self.options.nominal and k == 0}}

    def fingerprint(self, k: int, env: Any) -> str:
        """Return a digest of all that demonstration k depends on."""
        o = self.options
        return fingerprint(env, self.material, o.action_repeat, o.limit, self.reset_arguments(k), o.rate,
                           self.first_actions.tolist(), self.fixed, o.method, o.arm_weight)

    def make_environment(self, **options: Any) -> Any:
        """Make the task's environment with the demonstrations' action_repeat."""
        return make_environment(self.task, action_repeat=self.options.action_repeat, **options).unwrapped


def load_stored(path: Path, expected: str) -> StoredArrays | None:
    """Return the arrays that an earlier call stored with the fingerprint `expected`, or None without a file.
    Raises mpm.InvalidValue for a file that cannot be read, has another fingerprint, or lacks the losses."""
    if not path.is_file():
        return None
    try:
        arrays = read_arrays(path)
    except ValueError as error:
        raise mpm.InvalidValue(f"{error}; give another --out, or remove it") from None
    if arrays.text("fingerprint", "none") != expected:
        raise mpm.InvalidValue(f"{path}: made for another scene, task, material, method, seed or start (fingerprint "
                               f"{arrays.text('fingerprint', 'none')}, now {expected}); give another --out, or remove "
                               f"it")
    if "losses" not in arrays:
        raise mpm.InvalidValue(f"{path}: has no array 'losses'; give another --out, or remove it")
    losses, norms = arrays["losses"], arrays.get("norms", np.zeros((0, 2)))
    if losses.ndim != 1 or losses.dtype.kind not in "iuf" or norms.shape[1:] != (2,) or norms.dtype.kind not in "iuf":
        raise mpm.InvalidValue(f"{path}: losses have shape {losses.shape}, norms {norms.shape}; accepted: numbers of "
                               f"shapes (n,) and (n, 2); remove it")
    return arrays
