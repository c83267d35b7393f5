"""Shapes of bodies are those of MuJoCo, frames lie on a grid of times, and a run is the same with a recording."""

import io
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh
from trays import tray

from robosim.recordings.reader import Recording
from robosim.recordings.scene_recorder import SceneRecorder
from robosim.rendering.body_shapes import body_shapes

SCENE = """
<mujoco>
  <option timestep="0.001"/>
  <asset><mesh name="wedge" vertex="0 0 0  0.03 0 0  0 0.03 0  0 0 0.03"/>
    <hfield name="ground" nrow="5" ncol="4" size="0.05 0.04 0.01 0.01"/></asset>
  <worldbody>
    <geom type="hfield" hfield="ground" pos="0 0 -1"/>
    <camera name="eye" pos="0.5 0 0.3" xyaxes="0 1 0 -0.5 0 1"/>
    <body name="block" pos="0.05 0.05 0.07"><freejoint/>
      <geom type="box" size="0.01 0.012 0.014" density="3000" pos="0.002 0 0" euler="10 20 30"/></body>
    <body name="parts" pos="0.2 0 0" euler="0 0 30">
      <geom type="sphere" size="0.02"/><geom type="capsule" size="0.01 0.03" pos="0.1 0 0"/>
      <geom type="cylinder" size="0.02 0.01" pos="0 0.1 0" euler="90 0 0"/>
      <geom type="ellipsoid" size="0.01 0.02 0.03" pos="0 0 0.1"/>
      <geom type="mesh" mesh="wedge" pos="0.1 0.1 0" euler="0 40 0"/>
      <geom type="box" size="1 1 1" group="3" contype="0" conaffinity="0"/></body>
  </worldbody>
</mujoco>
"""


def test_shapes_are_those_of_mujoco() -> None:
    """The box about each geom of a body's .glb file is MuJoCo's, and group 3 is not drawn."""
    model = mujoco.MjModel.from_xml_string(SCENE)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    shapes = body_shapes(model)
    assert set(shapes) == {0, model.body("block").id, model.body("parts").id}
    for body, content in shapes.items():
        loaded = trimesh.load(io.BytesIO(content), file_type="glb")
        assert isinstance(loaded, trimesh.Scene)
        drawn = np.array(loaded.to_mesh().vertices)
        expected = np.concatenate([corners(model, geom) for geom in range(model.ngeom)
                                   if model.geom_bodyid[geom] == body and model.geom_group[geom] < 3])
        tolerance = 0.02 * np.ptp(expected, axis=0).max()  # circles are polygons
        assert np.abs(drawn.min(0) - expected.min(0)).max() < tolerance
        assert np.abs(drawn.max(0) - expected.max(0)).max() < tolerance


def corners(model: mujoco.MjModel, geom: int) -> np.ndarray:
    """Return points (n, 3) on a geom whose box is its own, by its support in 2000 directions."""
    rng = np.random.default_rng(0)
    directions = np.concatenate([np.eye(3), -np.eye(3), rng.normal(size=(2000, 3))])
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    size, kinds = model.geom_size[geom], mujoco.mjtGeom
    kind = kinds(model.geom_type[geom])
    if kind == kinds.mjGEOM_MESH:
        mesh = model.geom_dataid[geom]
        points = model.mesh_vert[model.mesh_vertadr[mesh]:][:model.mesh_vertnum[mesh]]
    elif kind == kinds.mjGEOM_HFIELD:
        x, y = model.hfield_size[0, :2]
        points = np.array([[sx * x, sy * y, 0.0] for sx in (-1, 1) for sy in (-1, 1)])
    else:
        # directions are in the body's frame: the support of the turned shape
        rotation = np.empty(9)
        mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
        d = directions @ rotation.reshape(3, 3)
        points = {kinds.mjGEOM_BOX: lambda: np.sign(d) * size,
                  kinds.mjGEOM_SPHERE: lambda: d * size[0],
                  kinds.mjGEOM_CAPSULE: lambda: d * size[0] + np.sign(d) * [0, 0, 1] * size[1],
                  kinds.mjGEOM_CYLINDER: lambda: np.column_stack(
                      [size[0] * d[:, :2] / np.maximum(np.linalg.norm(d[:, :2], axis=1), 1e-9)[:, None],
                       np.sign(d[:, 2]) * size[1]]),
                  kinds.mjGEOM_ELLIPSOID: lambda: d * size**2 / np.linalg.norm(d * size, axis=1)[:, None]}[kind]()
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
    return points @ rotation.reshape(3, 3).T + model.geom_pos[geom]


@pytest.mark.long
@pytest.mark.parametrize("rate", [20.0, 300.0])
def test_frames_have_the_state_of_their_time(rate: float, opened: Callable[[Path], Recording],
                                             tmp_path: Path) -> None:
    plugin = tray(SCENE, (0.1, 0.1, 0.04), bodies={"block": None})
    model, data, solver = plugin.model, plugin.data, plugin.solver
    recorder = SceneRecorder(tmp_path / "recording.rec", model, data, solver, kind="scene", title="a block",
                             frame_rate=rate, tool="block")
    kept = []
    for _ in range(60):
        plugin.step()
        if recorder.add(data, wrench=plugin.wrench("block")):
            kept.append((data.time, data.body("block").xpos.copy(), solver.positions(), plugin.wrench("block").force))
    recorder.close()
    recording = opened(tmp_path / "recording.rec")
    assert len(recording) == len(kept) == (2 if rate == 20.0 else 19)
    assert [body.name for body in recording.header.moving] == ["block"] and recording.header.cameras[0].name == "eye"
    for k, (time, place, positions, force) in enumerate(kept):
        assert recording.scene(k).time == pytest.approx(time) and abs(time - k / rate) <= 1e-3 + 1e-9
        assert np.allclose(recording.scene(k).poses[0, :3], place, atol=1e-6)
        assert np.allclose(recording.scene(k).wrench[:3], force, rtol=1e-6)
        assert np.abs(recording.grains(k).positions - positions).max() < 1e-5


@pytest.mark.long
def test_a_run_is_the_same_with_a_recording(tmp_path: Path) -> None:
    """Recording only reads: every bit of the state is as without it."""
    ends = []
    for records in (False, True):
        plugin = tray(SCENE, (0.1, 0.1, 0.04), bodies={"block": None})
        model, data, solver = plugin.model, plugin.data, plugin.solver
        recorder = SceneRecorder(tmp_path / "recording.rec", model, data, solver, kind="scene", title="a block",
                                 frame_rate=500.0) if records else None
        for _ in range(40):
            plugin.step()
            if recorder is not None:
                recorder.add(data)
        if recorder is not None:
            recorder.close()
        ends.append((data.qpos.copy(), solver.state()))
    assert np.array_equal(ends[0][0], ends[1][0])
    assert all(np.array_equal(ends[0][1][key], ends[1][1][key]) for key in ends[0][1])
