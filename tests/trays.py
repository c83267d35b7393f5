"""A tray of sand below a scene of MuJoCo, coupled to its bodies."""

import mujoco
import numpy as np
from field_parts import block, sand

import mpm
from robosim import GranularPlugin

CELL = 0.01


def tray(xml: str, size: tuple[float, float, float] = (0.1, 0.1, 0.02), dt: float | None = None,
         data: mujoco.MjData | None = None, **choices: object) -> GranularPlugin:
    """Sand of a size [m] below a scene; choices: of the plugin; data: of a scene that there is already."""
    data = mujoco.MjData(mujoco.MjModel.from_xml_string(xml)) if data is None else data
    bed = block(sand(E=1.5e5), (0, 0, 0), size, CELL / 2, rng=np.random.default_rng(0))
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (size[0], size[1], 0.15), CELL), walls=mpm.Walls(friction=0.5), dt=dt,
                        bodies=[bed])
    return GranularPlugin(data.model, data, solver, **choices)  # type: ignore[arg-type]
