"""Parts of a picture that are drawn anew: they hold every change, and no more than a change needs."""

from collections.abc import Callable, Iterator

import mujoco
import numpy as np
import pytest

from robosim.rendering.changes import STEP, Changes
from robosim.rendering.grain_skin import add_grain_skin
from robosim.rendering.renderer import SceneRenderer
from robosim.rendering.views import Window
from robosim.robot.mjspec import compile_spec

SCENE = """<mujoco><statistic center="0 0 0.3" extent="1.2"/>
<asset><material name="floor" reflectance="{mirror}"/></asset><worldbody>
  <light type="spot" pos="0.6 -0.5 2" dir="-0.3 0.25 -1" castshadow="true"/>
  <geom type="plane" size="3 3 0.1" pos="0 0 -0.7" material="floor"/>
  <geom type="box" size="0.5 0.4 0.02" pos="0 0 -0.02" rgba="0.6 0.5 0.4 1"/>
  <body name="arm" mocap="true"><geom type="capsule" size="0.03" fromto="0 0 0 0.2 0 0.1" rgba="0.2 0.7 0.3 1"/>{lamp}
  </body>
  <camera name="still" pos="0.3 -1.9 1.3" xyaxes="1 0 0 0 0.55 0.83" fovy="50"/>
</worldbody></mujoco>"""
SHAPE, COUNT, RADIUS = (360, 640), 400, 0.006
WHOLE = Window.whole(SHAPE)
Place = Callable[[tuple[float, float, float]], None]


def make(mirror: float = 0.0, lamp: str = "") -> tuple[mujoco.MjModel, mujoco.MjData, SceneRenderer]:
    """Make the arm above a table, with grains, and what draws them."""
    spec = mujoco.MjSpec.from_string(SCENE.format(mirror=mirror, lamp=lamp))
    add_grain_skin(spec, COUNT, RADIUS, (1.0, 1.0, 1.0, 1.0))
    model = compile_spec(spec)
    return model, mujoco.MjData(model), SceneRenderer(model, COUNT, *SHAPE[::-1])


@pytest.fixture
def scene() -> Iterator[tuple[mujoco.MjModel, mujoco.MjData, SceneRenderer]]:
    made = make()
    yield made
    made[2].close()


def heap() -> np.ndarray:
    """Grains on the table, seven a layer along each side."""
    places = np.stack(np.meshgrid(*3 * [np.arange(8)], indexing="ij"), -1).reshape(-1, 3)[:COUNT]
    return np.array([-0.3, -0.1, RADIUS]) + 2.0 * RADIUS * places


def test_a_part_holds_all_that_has_changed(scene: tuple[mujoco.MjModel, mujoco.MjData, SceneRenderer]) -> None:
    """The arm, its shadow on table and floor, single grains and a heap: no pixel outside differs, and the picture that
    is put together is the one drawn at once. Parts are a fraction of the picture."""
    model, data, renderer = scene
    changes, grains, rng = Changes(model, SHAPE, RADIUS), heap(), np.random.default_rng(1)
    last, put = None, np.zeros((*SHAPE, 3), int)
    shares = []
    for k in range(24):
        if k % 3:
            data.mocap_pos[:] = rng.uniform((-0.6, -0.3, 0.05), (0.5, 0.3, 0.4))
        if k % 4 == 1:
            grains[rng.integers(COUNT, size=5)] += rng.uniform(-0.05, 0.05, (5, 3))
        part = changes.find(data, grains, "still", renderer.find_light(data))
        whole = renderer.draw(data, grains, "still").astype(int)
        if 0 not in part.shape:
            put[part.rows, part.columns] = renderer.begin(data, grains, "still", part)()
        assert (np.abs(put - whole).max(2) > 8).mean() < 1e-4, k
        if last is not None:
            differs = np.abs(whole - last).max(2) > 4
            differs[part.rows, part.columns] = False
            assert differs.sum() == 0, k
            shares.append(np.prod(part.shape) / np.prod(SHAPE))
        last = whole
    assert 0.05 < np.mean(shares) < 0.5


def test_the_heap_about_a_grain_that_leaves_is_drawn_anew(
        scene: tuple[mujoco.MjModel, mujoco.MjData, SceneRenderer]) -> None:
    """It is shaded by its density, so that a grain that is gone changes the light on others; seen from near, where that
    is more pixels than the room that every part has."""
    model, data, renderer = scene
    camera, grains, rng = mujoco.MjvCamera(), heap(), np.random.default_rng(1)
    camera.lookat[:], camera.distance, camera.elevation = [-0.26, -0.06, 0.03], 0.35, -40.0
    changes, light = Changes(model, SHAPE, RADIUS), renderer.find_light(data)
    changes.find(data, grains, camera, light)
    last = renderer.draw(data, grains, camera).astype(int)
    for _ in range(11):
        grains[rng.integers(COUNT)] += [0.3, 0.3, 0.0]
        part = changes.find(data, grains, camera, light)
        whole = renderer.draw(data, grains, camera).astype(int)
        differs = np.abs(whole - last).max(2) > 4
        differs[part.rows, part.columns] = False
        assert differs.sum() == 0
        last = whole


def test_what_rests_is_not_drawn_and_a_slow_move_is(scene: tuple[mujoco.MjModel, mujoco.MjData, SceneRenderer]) -> None:
    """A hundred steps of a hundredth of what counts as a move are one move."""
    model, data, renderer = scene
    changes, light = Changes(model, SHAPE, RADIUS), renderer.find_light(data)
    assert changes.find(data, heap(), "still", light) == WHOLE
    assert 0 in changes.find(data, heap(), "still", light).shape
    parts = []
    for _ in range(100):
        data.mocap_pos[:, 0] += 1e-6
        parts.append(changes.find(data, heap(), "still", light))
    assert sum(0 not in part.shape for part in parts) == 1 and parts[-1] != WHOLE
    assert all(edge % STEP == 0 or edge in SHAPE for part in parts for edge in part)


@pytest.mark.parametrize(("mirror", "lamp"), [(0.3, ""), (0.0, "<light pos='0 0 0.5'/>")])
def test_all_is_drawn_where_a_change_is_seen_anywhere(mirror: float, lamp: str) -> None:
    """In a mirror, and in the light of a lamp that moves."""
    model, data, renderer = make(mirror, lamp)
    changes = Changes(model, SHAPE, RADIUS)
    assert [changes.find(data, heap(), "still", renderer.find_light(data)) for _ in range(2)] == [WHOLE, WHOLE]
    renderer.close()


def test_all_is_drawn_where_the_camera_moves_or_is_among_what_moves(
        scene: tuple[mujoco.MjModel, mujoco.MjData, SceneRenderer]) -> None:
    model, data, renderer = scene
    changes, light, camera = Changes(model, SHAPE, RADIUS), renderer.find_light(data), mujoco.MjvCamera()
    camera.distance, camera.elevation = 1.0, -30.0
    changes.find(data, heap(), camera, light)
    camera.azimuth += 0.1
    assert changes.find(data, heap(), camera, light) == WHOLE
    data.mocap_pos[:] = model.camera("still").pos
    changes.find(data, heap(), "still", light)
    data.mocap_pos[:, 0] += 0.01
    assert changes.find(data, heap(), "still", light) == WHOLE
