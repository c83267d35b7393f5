"""Light, shadow and heaps in pictures."""

import subprocess
import sys

import mujoco
import numpy as np

from robosim.rendering.grain_skin import find_surface
from robosim.rendering.renderer import SHADE, SceneRenderer

BALL = """<mujoco><statistic center="0 0 0" extent="1"/><worldbody>
  <light type="spot" pos="0 0 2" dir="0 0 -1" castshadow="true"/><geom type="plane" size="1 1 0.1"/>
  <geom type="sphere" pos="0 0 0.4" size="0.1"/><camera name="low" pos="0 -1.2 0.3" xyaxes="1 0 0 0 0.3 1.2"/>
</worldbody></mujoco>"""


def test_a_shadow_takes_its_share_and_has_a_soft_edge() -> None:
    """Of a ball below a lamp on the floor: dark in the middle, no step from row to row at its edge."""
    model = mujoco.MjModel.from_xml_string(BALL)
    renderer = SceneRenderer(model, 0, 320, 240)
    rows = renderer.draw(mujoco.MjData(model), None, "low")[:, :, 0].astype(float)
    renderer.close()
    line = rows[121]  # through the shadow's middle
    assert abs(line[160] / line[100] - (1.0 - SHADE)) < 0.1
    edge = np.flatnonzero((line[100:160] < 0.97 * line[100]) & (line[100:160] > 1.1 * line[160]))
    assert 2 <= len(edge) < 30


def test_a_renderer_frees_what_is_its_own() -> None:
    """Closed beside another one, and left open at the interpreter's exit, also where finalizers were made before."""
    code = f"""import weakref, robosim, mujoco
from robosim.rendering.renderer import SceneRenderer
early = weakref.finalize(mujoco, int)
model = mujoco.MjModel.from_xml_string({BALL!r})
one, other = (SceneRenderer(model, 0, 32, 24) for _ in range(2))
first, _ = (renderer.draw(mujoco.MjData(model), None, "low") for renderer in (one, other))
one.draw(mujoco.MjData(model), None, "low")
other.close()
assert (one.draw(mujoco.MjData(model), None, "low") == first).all()"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")


def test_a_heap_has_a_surface_that_points_outwards() -> None:
    heap = np.stack(np.meshgrid(*3 * [np.arange(-0.05, 0.05, 0.004)]), -1).reshape(-1, 3)
    shown, outward = find_surface(heap, 0.01)
    inner = np.abs(heap).max(1) < 0.025
    assert not inner[shown].any() and (np.abs(heap).max(1) > 0.045)[shown].mean() > 0.5
    top = (heap[shown, 2] > 0.042) & (np.abs(heap[shown, :2]).max(1) < 0.03)
    assert (outward[top, 2] > 0.8).all() and np.abs(outward[top, :2]).max() < 0.5
    assert len(find_surface(heap[:1], 0.01)[0]) == 1
