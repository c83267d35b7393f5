"""Memory that the fields of a scene take, checked before anything is allocated."""

import math
from pathlib import Path

import numpy as np

from mpm.backend import is_shared
from mpm.errors import InvalidValue
from mpm.scene.features import Features
from mpm.scene.grid import BLOCK, Grid
from mpm.state.packs import LANES

CGROUP = Path("/sys/fs/cgroup")
MOST_NODES = 2**31 - 1  # nodes that a field's 32-bit index reaches
RESERVE = 0.9  # share of the free memory that fields may take


def free_memory() -> int:
    """Return the memory [bytes] that the process may still take: of the machine, and of its control group."""
    free = [math.inf]
    for line in _read(Path("/proc/meminfo")).splitlines():
        if line.startswith("MemAvailable:"):
            free.append(1024 * int(line.split()[1]))
    limit, used = _read(CGROUP / "memory.max").strip(), _read(CGROUP / "memory.current").strip()
    if limit.isdigit() and used.isdigit():
        free.append(int(limit) - int(used))
    return int(min(min(free), 2**62))


def _read(path: Path) -> str:
    """Return the text of a file, empty where there is none: systems differ."""
    try:
        return path.read_text(encoding="utf-8")
    except OSError:
        return ""


def field_memory(grid: Grid, counts: tuple[int, ...], features: Features, parts: int) -> float:
    """Return the memory [bytes] of a scene's fields, without those of colliders; exact but for a few numbers."""
    number = 8 if features.precision == "f64" else 4
    nodes = float(np.prod([float(n) for n in grid.shape]))
    layers = 2 if features.shells else 1
    each_node = 4.0 * number * (layers + parts * layers)
    each_node += (4 * number + 4) * bool(features.static_colliders) + (4 * number + 8) * layers * bool(features.shells)
    each_node += (4.0 * features.solids + 4 * number * len(features.moving_solids)) * layers
    each_node += 2 * number * layers * features.cell_rates
    each_node += (40 + 7 * number) * features.sleep
    each_block = (24.0 + 4.0 * bool(features.solids or features.shells)) * layers + 24.0 * features.sleep
    each_block += 4.0 * bool(features.static_colliders)
    named = 15 + 6 * features.tensor_state + features.volume_state + features.volume_correction
    named += 5 * features.sleep + features.density_state
    named += 3 * (features.precision == "f32") + 3 * features.body_acceleration + 2 * bool(features.shells) + 1
    named += bool(features.static_colliders or features.moving_colliders)
    lanes = sum(-(-count // LANES) * LANES for count in counts)
    each_lane = named * float(number) + (4.0 + 16.0 / LANES) * features.sleep
    return nodes * (each_node + each_block / BLOCK**3) + lanes * each_lane


def check_memory(grid: Grid, counts: tuple[int, ...], features: Features, parts: int) -> None:
    """Raise InvalidValue where the fields would not fit, with the cell that would; checked on a CPU."""
    free = RESERVE * free_memory()
    needed = field_memory(grid, counts, features, parts)
    nodes = float(np.prod([float(n) for n in grid.shape])) * (2 if features.shells else 1) * max(parts, 1)
    if (needed <= free or is_shared()) and nodes <= MOST_NODES:
        return
    fixed = field_memory(Grid(grid.lower, grid.lower + 4 * np.full(3, grid.cell), grid.cell), counts, features, parts)
    where = f"Grid: {grid.lower} .. {grid.upper} m in cells of {grid.cell} m, with {sum(counts)} particles"
    if fixed > free:
        raise InvalidValue(f"{where}: the particles alone need {_size(fixed)}, and {_size(free)} are free; accepted: "
                           f"fewer particles")
    factor = max((needed - fixed) / max(free - fixed, 1.0), nodes / MOST_NODES) ** (1.0 / 3.0)
    raise InvalidValue(f"{where}: needs {_size(needed)}, and {_size(free)} are free; accepted here: cells of "
                       f"{_round_up(1.02 * factor * grid.cell):g} m or more, or a smaller grid")


def _size(n_bytes: float) -> str:
    """Return a memory in units that a person reads."""
    return f"{n_bytes / 1e9:.3g} GB"


def _round_up(length: float) -> float:
    """Return a length with two digits, not below the given one."""
    unit = 10.0 ** (math.floor(math.log10(length)) - 1)
    return math.ceil(length / unit - 1e-9) * unit
