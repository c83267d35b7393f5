"""What part of a picture differs from the one before it: a film redraws that alone.
In the film of the spoon a fifth of the picture differs, and the parts found here are a third of it."""

from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from robosim.rendering.body_shapes import SHOWN_GROUPS, can_move
from robosim.rendering.renderer import aim
from robosim.rendering.views import View, Window

MOVED = 5e-5
"""Way [m] from which a body has moved: a twentieth of a pixel where a metre is a thousand pixels wide."""
GRAIN_MOVED, GRAIN_REACH = 0.05, 18.0
"""Way from which a grain has moved, and how far the shading of others follows it, in radii: `find_surface` averages
over two cubes of four radii on each side, and takes a slope."""
WIDE, UPRIGHT = 0.2, 0.999
"""Half width [m], and cosine of the tilt, from which a box that stands still is a table: what moves throws its shadow
on it, and on nothing below."""
BLUR = 0.06
"""Half width of the edge of a shadow, in the distance from what casts it."""
MARGIN, STEP, MOST = 0.03, 32, 0.7
"""Room about what has changed, in heights of the picture; pixels to which a part is rounded outward, so that its size
changes rarely; and the share of the picture from which all of it is drawn."""
CORNERS = np.array(np.meshgrid(*3 * [(-1.0, 1.0)])).reshape(3, 8).T


class Seen(NamedTuple):
    """What a picture shows, as far as it can change."""

    view: View
    boxes: NDArray[np.float64]
    """Corners (n, 8, 3) [m] of the boxes about geoms that can move."""
    grains: NDArray[np.float64]
    """Positions (m, 3) [m]."""

    def is_of(self, other: "Seen") -> bool:
        """Whether another picture has the same camera and as many grains."""
        return self.view.is_same(other.view) and self.grains.shape == other.grains.shape


class Changes:
    """Compares each picture of a model with the one before it.
    shape: height and width [pixels]; radius: of a grain [m]."""

    def __init__(self, model: mujoco.MjModel, shape: tuple[int, int], radius: float) -> None:
        self._model, self._shape, self._radius = model, shape, radius
        shown = np.isin(model.geom_group, SHOWN_GROUPS)
        moves = can_move(model)[model.geom_bodyid]
        floor, is_box = (model.geom_type == kind for kind in (mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_BOX))
        still = shown & ~moves
        self._geoms, self._floors = np.flatnonzero(shown & moves), np.flatnonzero(still & floor)
        self._still = np.flatnonzero(still & ~floor)  # planes have no end
        self._tables = np.flatnonzero(still & is_box & (model.geom_size[:, :2].min(1) > WIDE))
        flat = model.geom_matid[still & (floor | is_box)]
        self._is_whole = bool(can_move(model)[model.light_bodyid].any() or model.mat_reflectance[flat[flat >= 0]].any())
        """Whether a light moves or something mirrors, so that a change is seen anywhere."""
        self._eye = mujoco.MjvScene(model, 1)
        self._last: Seen | None = None

    def find(self, data: mujoco.MjData, positions: NDArray[np.floating], camera: str | mujoco.MjvCamera,
             light: NDArray[np.float64] | None) -> Window:
        """Return the part of the picture of `data` and of grains at positions (n, 3) [m] that is new.
        Empty where nothing does; all of it for the first, and where the camera has moved.
        light: position (3,) [m] of the one that casts shadows, None without."""
        eye, last = aim(self._model, data, camera), self._last
        mujoco.mjv_updateScene(self._model, data, mujoco.MjvOption(), None, eye, 0, self._eye)  # its camera alone
        now = Seen(View.of(self._eye), self._boxes(data, self._geoms), np.array(positions, float))
        if self._is_whole or last is None or not now.is_of(last):
            self._last = now
            return Window.whole(self._shape)
        moved = np.abs(now.boxes - last.boxes).max((1, 2), initial=0.0) > MOVED
        flown = np.abs(now.grains - last.grains).max(1, initial=0.0) > GRAIN_MOVED * self._radius
        # what moves slowly has moved once it is far from where it was when it was last seen to move
        self._last = now._replace(boxes=np.where(moved[:, None, None], now.boxes, last.boxes),
                                  grains=np.where(flown[:, None], now.grains, last.grains))
        corners = [of.boxes[moved].reshape(-1, 3) for of in (last, now)]
        centres = [of.grains[flown] for of in (last, now)]
        points = np.concatenate([*corners, *centres])
        reach = np.repeat([0.0, GRAIN_REACH * self._radius], [sum(map(len, of)) for of in (corners, centres)])
        if light is not None and len(points):
            ends, blur = self._cast(points, data, light)
            points, reach = np.concatenate([points, ends]), np.concatenate([reach, reach + blur])
        return self._cover(now.view, points, reach) if len(points) else Window(0, 0, 0, 0)

    def _cast(self, points: NDArray[np.float64], data: mujoco.MjData, light: NDArray[np.float64]
              ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return where the shadows of points (n, 3) [m] end at the latest: on a table that is below, or at the height
        of the lowest thing that stands still; and how wide their edges are there (n,) [m].
        Not a number where the light comes from below."""
        lowest = min(self._boxes(data, self._still)[..., 2].min(initial=points[:, 2].min()),
                     data.geom_xpos[self._floors, 2].min(initial=np.inf))
        rays = points - light
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        fall = np.where(rays[:, 2] < 0.0, -rays[:, 2], np.nan)
        way = (points[:, 2] - lowest) / fall
        for table in self._tables:
            (x, y, z), middle = self._model.geom_size[table], data.geom_xpos[table]
            axes = data.geom_xmat[table].reshape(3, 3)
            hit = (points[:, 2] - middle[2] - z) / fall
            place = (points + hit[:, None] * rays - middle) @ axes
            on_it = (hit >= 0.0) & (abs(place[:, 0]) < x) & (abs(place[:, 1]) < y) & (axes[2, 2] > UPRIGHT)
            way = np.where(on_it, np.minimum(way, hit), way)
        return points + way[:, None] * rays, BLUR * way

    def _cover(self, view: View, points: NDArray[np.float64], reach: NDArray[np.float64]) -> Window:
        """Return a part that has points (n, 3) and what is as far from them as their reach (n,) [m]; all of the picture
        where one of them is behind the camera, and where little of it would be left out."""
        whole = Window.whole(self._shape)
        if not np.all((points - view.position) @ view.axes[2] - reach > view.near):
            return whole
        places, scale = view.locate(self._shape, points)
        room = (reach * scale + MARGIN * self._shape[0])[:, None]
        (top, left), (bottom, right) = (STEP * np.floor((places - room).min(0) / STEP),
                                        STEP * np.ceil((places + room).max(0) / STEP))
        height, width = self._shape
        part = Window(*(int(np.clip(edge, 0, most)) for edge, most in zip((top, bottom, left, right),
                                                                        (height, height, width, width))))
        return part if np.prod(part.shape) < MOST * height * width else whole

    def _boxes(self, data: mujoco.MjData, geoms: NDArray[np.intp]) -> NDArray[np.float64]:
        boxes = CORNERS * self._model.geom_aabb[geoms, None, 3:] + self._model.geom_aabb[geoms, None, :3]
        axes = data.geom_xmat[geoms].reshape(-1, 3, 3)
        return np.einsum("nij,nkj->nki", axes, boxes) + data.geom_xpos[geoms, None]
