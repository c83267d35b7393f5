"""Tools from meshes: what they hold is exact, however thick the grains need their wall."""

import io
import runpy
from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh
from own_meshes import BOWL_MM, HANDLE, HANDLE_MM, WALL_MM, half_sphere, ladle_keys, write_ladle

from robosim.base.errors import ConfigError
from robosim.base.resources import folder, part_names
from robosim.config.scene import RegionConfig
from robosim.config.tool import HandleConfig, ToolConfig
from robosim.scene.models import load_tool_model
from robosim.shapes import ToolShape, tool_shape
from robosim.shapes.rigid_models import build_tool_spec

GROWN = 4e-3
"""Wall of the collider [m]."""


def configure(path: Path, **changes) -> ToolConfig:
    return ToolConfig.model_validate(ladle_keys(path, **changes))


@pytest.fixture(scope="module")
def ladle(tmp_path_factory: pytest.TempPathFactory) -> ToolShape:
    return tool_shape(configure(write_ladle(tmp_path_factory.mktemp("ladle") / "ladle.stl")))


def crossings(values: np.ndarray, places: np.ndarray) -> np.ndarray:
    return places[1:][np.diff(np.sign(values)) != 0]


def test_the_inside_is_exact_and_the_wall_grows_outward(ladle: ToolShape) -> None:
    """At every height the inner surface is at sqrt(r^2 - z^2), and straight through the wall it is GROWN thick."""
    grown, radius = ladle.distance(GROWN, 1e-3), 1e-3 * BOWL_MM
    x = np.linspace(0.0, 0.06, 3001)
    for z in (-0.001, -0.01, -0.02):
        inner, outer = crossings(grown.distance(np.column_stack([x, 0 * x, 0 * x + z])), x)
        assert inner == pytest.approx(np.sqrt(radius**2 - z**2), abs=1.5e-4)
        assert outer == pytest.approx(np.sqrt((radius + GROWN) ** 2 - z**2), abs=4e-4)
    above = np.column_stack([x, 0 * x, 0 * x + 0.0015])
    assert len(crossings(grown.distance(above), x)) == 0  # the rim stays where it is
    inner, outer = -crossings(grown.distance(np.column_stack([0 * x, 0 * x, -x])), -x)
    assert (inner, outer) == (pytest.approx(radius, abs=1.5e-4), pytest.approx(radius + GROWN, abs=4e-4))


def test_a_wall_that_is_thick_enough_is_left_alone(ladle: ToolShape) -> None:
    real, grown = ladle.real_distance(1e-3), ladle.distance(0.9e-3 * WALL_MM, 1e-3)
    assert np.array_equal(real.host, grown.host)


def test_it_holds_its_volume_of_water_and_a_heap(ladle: ToolShape) -> None:
    assert ladle.inside.volume == pytest.approx(2.0 / 3.0 * np.pi * (1e-3 * BOWL_MM) ** 3, rel=0.04)
    held = ladle.interior.holds(np.array([[0.0, 0.0, -0.02], [0.02, 0.0, 0.02], [0.0, 0.0, 0.06], [-0.1, 0.0, 0.07]]))
    assert held.tolist() == [True, True, False, False]


def test_the_handle_is_measured_and_held_in_the_middle(ladle: ToolShape) -> None:
    """The hand comes along -y, with z of the grip towards the bowl."""
    assert ladle.radius == pytest.approx(1e-3 * HANDLE_MM, rel=0.02)
    middle = 0.5 * (np.array(HANDLE["head"]) + HANDLE["end"])
    assert ladle.grip[:3, 3] == pytest.approx(middle)
    assert ladle.grip[:3, 1] == pytest.approx([0.0, -1.0, 0.0], abs=1e-3)
    assert ladle.grip[:3, 2] @ (np.array([0.0, 0.0, 0.0]) - middle) > 0.0
    assert np.linalg.det(ladle.grip[:3, :3]) == pytest.approx(1.0)


def test_the_body_has_the_mass_and_the_inertia_of_the_mesh(ladle: ToolShape) -> None:
    model = build_tool_spec(ladle).compile()
    body = model.body("ladle")
    assert body.mass[0] == pytest.approx(0.12)
    assert body.ipos == pytest.approx(ladle.mesh.center_mass, abs=1e-6)
    expected = np.linalg.eigvalsh(ladle.mesh.moment_inertia) * 0.12 / ladle.mesh.volume
    assert np.sort(body.inertia) == pytest.approx(expected, rel=1e-3)
    kinds = {model.geom(k).name: model.geom_type[k] for k in range(model.ngeom) if model.geom_contype[k]}
    assert kinds == {"ladle_head": mujoco.mjtGeom.mjGEOM_MESH, "ladle_handle": mujoco.mjtGeom.mjGEOM_CAPSULE}
    head = model.mesh_vert[model.mesh_vertadr[1] :]
    assert np.ptp(head[:, 0]) < 2.5e-3 * (BOWL_MM + WALL_MM + HANDLE_MM)  # the bowl, without the handle


def test_what_is_wrong_with_a_tool_is_said(tmp_path: Path) -> None:
    path = write_ladle(tmp_path / "ladle.stl")
    point = {"head": (0.1, 0.0, 0.1), "end": (0.1, 0.0, 0.1), "radius": 0.01}
    for changes, message in (
            ({"mass": None}, "mass = None, density = None; accepted: one of the two"),
            ({"density": 7900.0}, "mass = 0.12, density = 7900.0; accepted: one of the two"),
            ({"scale": 1.0}, r"\d+ m long; .* is it in millimetres \(scale: 0.001\)"),
            ({"thickness": 0.001}, "closed, and thickness = 0.001 m is given"),
            ({"inner_face": "face.stl"}, "inner_face without thickness; accepted: the thickness of the wall"),
            ({"inner_face": "face.stl", "thickness": 1e-3}, "face.stl: no such file"),
            ({"holes": {"positions": [(0, 0, 0)], "axis": (0, 0, 0), "diameter": 1e-3}}, "axis = .*; accepted"),
            ({"holes": {"positions": [], "axis": (0, 0, 1), "diameter": 1e-3}}, "holes.positions"),
            ({"thicken": "normals", "thickness": 1e-3}, "2 parts, or several vertices at a place; accepted"),
            ({"lip": (0.0, 1e3, 0.0)}, "lip"),
            ({"lip": (4.05, 0.0, 8.0)}, r"stl: lip = \(4.05, 0.0, 8.0\) is far from .*; accepted: .*metres"),
            ({"handle": {"head": (0.2, 0, 0), "end": (0.3, 0, 0)}}, "no part of the mesh lies along handle"),
            ({"handle": {**HANDLE, "approach": (-1.0, 0.0, 1.0)}}, r"handle.approach = .* is along the handle"),
            ({"handle": point}, "accepted: a line of 1 mm or more"),
            ({"inside": RegionConfig(centre=(0.0, 0.0, -0.5), half=(1e-3, 1e-3, 1e-3))}, "inside .* holds .* places")):
        with pytest.raises((ConfigError, ValueError), match=message):
            tool_shape(configure(path, **changes))
    assert HandleConfig.model_validate(HANDLE).hold == 0.5
    trimesh.creation.box((0.1, 0.05, 0.001)).export(tmp_path / "plate.stl")
    with pytest.raises(ConfigError, match="no inside found: level, it holds no water; .*key inside"):
        tool_shape(configure(tmp_path / "plate.stl", scale=1.0, handle={**HANDLE, "radius": 0.01}))


@pytest.mark.parametrize("name", part_names("tools"))
def test_the_mesh_files_are_up_to_date(name: str) -> None:
    """Each file of a bundled tool holds the mesh that its script makes; the bottle's makes the shaker's, too."""
    tools = folder("models") / "tools"
    script = runpy.run_path(str(tools / ("bottle" if name == "shaker" else name) / "make_meshes.py"))
    for file, content in script["make_shaker" if name == "shaker" else "make"]().items():
        expected, stored = (trimesh.load(io.BytesIO(data), file_type=file[-3:], process=False)
                            for data in (content, (tools / name / "assets" / file).read_bytes()))
        assert np.allclose(stored.vertices, expected.vertices, atol=1e-8)
        assert np.array_equal(stored.faces, expected.faces)


@pytest.mark.parametrize("name", part_names("tools"))
def test_a_bundled_tool_is_its_meshes(name: str) -> None:
    """Mass, inertia and grip of its MJCF are those of its meshes. Along its normals its wall gets as thick as outward
    from what it holds, within a few microns, and what it holds stays."""
    tool = tool_shape(name)
    expected, found = load_tool_model(name).spec.compile(), build_tool_spec(tool).compile()
    assert found.body(name).mass[0] == pytest.approx(expected.body(name).mass[0], rel=2e-3)
    assert found.body(name).ipos == pytest.approx(expected.body(name).ipos, abs=2e-5)
    assert found.body(name).inertia == pytest.approx(expected.body(name).inertia, rel=1e-3)
    for key in ("pos", "quat"):
        assert getattr(found.site(f"{name}_grip"), key) == pytest.approx(getattr(expected.site(f"{name}_grip"), key),
                                                                         abs=1e-6)
    plain = tool_shape(tool.config.model_copy(update={"thicken": "outward", "inner_face": None, "thickness": None}))
    half, centre = np.array(tool.interior.half), np.array(tool.interior.centre)
    points = np.random.default_rng(0).uniform(centre - half, centre + half, (20_000, 3))
    theirs = tool.head_distance(GROWN, 2e-3).distance(points)
    near = np.abs(theirs) < 1.5e-3
    difference = np.abs(plain.head_distance(GROWN, 2e-3).distance(points) - theirs)[near]
    # of a bottle the least wall is made GROWN thick, which is 0.4 mm less than the rest
    assert near.sum() > 500 and np.median(difference) < (4e-4 if name in ("bottle", "shaker") else 3e-5)
    assert tool.growth is not None
    if tool.face is not None:
        stays = tool.head[0].vertices[np.linalg.norm(tool.growth, axis=1) == 0.0]
        gaps = np.linalg.norm(tool.face.vertices[:, None] - stays, axis=2).min(1)
        assert (gaps < 1e-9).sum() >= len(gaps) - 2  # but for poles of the face that are no vertices of the head


@pytest.mark.parametrize(("name", "capacity", "accuracy", "lip"), [
    ("spoon", 2 / 3 * np.pi * 0.035 * 0.025 * 0.030, 0.01, [0.035, 0, 0]),
    ("scoop", 0.25 * np.pi * 0.060 * 0.030 * (0.085 - 0.014 / 3), 0.01, [0.0425, 0, -0.030]),
    ("shovel", 0.06 * 0.08 * 0.05, 0.1, None), ("bottle", None, None, [0.020, 0, 0.0605]),
    ("shaker", None, None, [0, 0, 0.0605])])
def test_capacities_are_those_up_to_the_rim_and_lips_are_there(name: str, capacity: float | None,
                                                               accuracy: float | None, lip: list[float] | None) -> None:
    """Half an ellipsoid; half an elliptic cylinder whose back is half an ellipsoid; and the region before a blade."""
    tool = tool_shape(name)
    assert tool.lip is None if lip is None else tool.lip == pytest.approx(lip, abs=1e-6)
    assert capacity is None or tool.capacity == pytest.approx(capacity, rel=accuracy)


def test_a_handle_has_a_mesh_and_a_mass_of_its_own(tmp_path: Path) -> None:
    """Two balls of 1 and 3 kg, 0.2 m apart: their common centre, and m1 m2 / (m1 + m2) d^2 across."""
    for name, place in (("bowl", 0.0), ("rod", -0.2)):
        ball = half_sphere(BOWL_MM, WALL_MM) if name == "bowl" else trimesh.creation.icosphere(4, 10.0)
        ball.apply_translation([1e3 * place, 0.0, 0.0]).export(tmp_path / f"{name}.stl")
    handle = {"head": (-0.1, 0, 0), "end": (-0.3, 0, 0), "radius": 0.01, "mesh": str(tmp_path / "rod.stl"), "mass": 3.0}
    mass, centre, moments = tool_shape(configure(tmp_path / "bowl.stl", mass=1.0, handle=handle)).inertia()
    shell = half_sphere(BOWL_MM, WALL_MM).center_mass[2] * 1e-3
    assert mass == pytest.approx(4.0) and centre == pytest.approx([-0.15, 0.0, 0.25 * shell], abs=1e-4)
    assert moments[1, 1] == pytest.approx(0.75 * (0.2**2 + shell**2) + 0.4 * 3.0 * 0.01**2, rel=0.02)
    for changes in ({"mass": None}, {"mesh": None}, {"density": 7900.0}):
        with pytest.raises(ValueError, match="accepted: a mesh with one of the two, or none of the three"):
            HandleConfig.model_validate(handle | changes)
