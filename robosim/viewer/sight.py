"""Which grains a camera sees: only these are sent to the page and drawn."""

from typing import NamedTuple

import numpy as np
import viser
from scipy.spatial.transform import Rotation

CELL, DEPTH = 1.6, 2.5
"""Side of the cells in which grains hide each other, and the depth below the first one to which they are seen, in
radii of a grain: the first layer and what shines through it."""
MARGIN = 1.15
"""Part of the picture, from its middle, in which grains are kept, so that a small turn shows no gap."""
MOVED, TURNED = 0.02, 0.02
"""Movement of a camera, in its distance from what it looks at, and turn [rad], from which grains are chosen anew."""


class Sight(NamedTuple):
    """A camera, as of a page."""

    eye: np.ndarray
    """(3,) [m]"""
    axes: np.ndarray
    """Columns: its axes to the right, down and ahead (3, 3)."""
    half_height: float
    """Tangent of half the vertical angle of the picture."""
    half_width: float

    def has_moved(self, other: "Sight | None", distance: float) -> bool:
        """Return whether another camera sees other grains; distance: to these [m]."""
        if other is None:
            return True
        turn = np.arccos(np.clip((np.trace(self.axes.T @ other.axes) - 1.0) / 2.0, -1.0, 1.0))
        return bool(np.linalg.norm(self.eye - other.eye) > MOVED * distance or turn > TURNED
                    or abs(self.half_height / other.half_height - 1.0) > TURNED
                    or abs(self.half_width / other.half_width - 1.0) > TURNED)


def read_sight(server: viser.ViserServer) -> Sight | None:
    """Return the camera of the only page; None where there is none, or where several see different things."""
    clients = list(server.get_clients().values())
    if len(clients) != 1:
        return None
    camera = clients[0].camera
    try:
        axes = Rotation.from_quat(camera.wxyz, scalar_first=True).as_matrix()
        half = float(np.tan(camera.fov / 2.0))
        return Sight(np.array(camera.position, float), axes, half, half * float(camera.aspect))
    except (AttributeError, ValueError):  # the page has not said yet where its camera is
        return None


def find_in_sight(positions: np.ndarray, sight: Sight, radius: float) -> np.ndarray:
    """Return which grains (n,) a camera sees past the others; radius: of a grain [m]. positions: (n, 3) [m]."""
    x, y, depth = ((positions - sight.eye) @ sight.axes).T
    ahead = np.maximum(depth, 1e-3)
    right, down = x / ahead, y / ahead
    kept = (depth > 0.0) & (np.abs(right) < MARGIN * sight.half_width) & (np.abs(down) < MARGIN * sight.half_height)
    if not kept.any():
        return kept
    inside = np.flatnonzero(kept)
    step = CELL * radius / float(np.median(ahead[inside]))
    columns, rows = (np.floor(part[inside] / step).astype(np.int64) for part in (right, down))
    columns -= columns.min()
    rows -= rows.min()
    cells = rows * (int(columns.max()) + 1) + columns
    nearest = np.full(int(cells.max()) + 1, np.inf)
    np.minimum.at(nearest, cells, depth[inside])
    kept[inside] = depth[inside] <= nearest[cells] + DEPTH * radius
    return kept
