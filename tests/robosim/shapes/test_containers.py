"""Containers and thin walls: what they hold, and where their shells lie."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh
from own_meshes import BOWL_MM, HANDLE, WALL_MM, half_sphere, ladle_keys, write_bowl, write_ladle
from scipy.spatial.transform import Rotation

import mpm
from robosim.base.errors import ConfigError
from robosim.config.scene import ContainerConfig
from robosim.config.tool import ToolConfig
from robosim.robot.mjspec import assembling, compile_spec
from robosim.scene.build import add_container
from robosim.scene.models import container_shape, load_container
from robosim.shapes import ToolShape, tool_shape
from robosim.shapes.containers import BoxShape, ContainerShape, RoundShape

PLACE = (0.6, 0.1, 0.0)


@pytest.fixture(scope="module")
def bowl(tmp_path_factory: pytest.TempPathFactory) -> ContainerConfig:
    path = write_bowl(tmp_path_factory.mktemp("bowl") / "bowl.stl")
    return ContainerConfig(mesh=str(path), scale=1e-3, position=PLACE)


@pytest.fixture(params=["box", "round", "bowl", "named"])
def container(request: pytest.FixtureRequest, bowl: ContainerConfig) -> ContainerConfig:
    return {"box": ContainerConfig(size=(0.12, 0.1, 0.06), position=PLACE), "bowl": bowl,
            "round": ContainerConfig(radius=0.05, height=0.08, wall=0.003, position=PLACE),
            "named": ContainerConfig(model="target", position=PLACE)}[request.param]


def shape_of(container: ContainerConfig) -> ContainerShape:
    return container_shape("cup", container)


@pytest.mark.long
def test_grains_fill_the_inside_and_no_wall(container: ContainerConfig) -> None:
    """Their volume is that of the inside up to the height, by a hundred times as many random points."""
    shape, spacing, height = shape_of(container), 2e-3, 0.03
    grains, volume = shape.fill(height, spacing, np.random.default_rng(0))
    low, high = shape.bounds
    points = np.random.default_rng(1).uniform(low, [*high[:2], low[2] + height], (200_000, 3))
    share = float(shape.between_walls(points).mean())
    assert volume * len(grains) == pytest.approx(share * height * np.prod((high - low)[:2]), rel=0.03)
    assert shape.holds(grains).all()
    depth = shape.distance(0.012, 2e-3).distance(grains)
    assert depth.min() > -spacing and np.median(depth) > 0.0


def test_the_shown_region_holds_what_counts(container: ContainerConfig) -> None:
    shape = shape_of(container)
    low, high = shape.bounds
    points = np.random.default_rng(0).uniform(low - 0.05, high + 0.05, (50_000, 3))
    assert not np.any(shape.holds(points) & ~shape.region.holds(points) & (points[:, 2] < high[2]))


@pytest.mark.long
def test_walls_thicken_outward(container: ContainerConfig) -> None:
    """What is free inside stays free, and behind the inner surface the wall is solid for its thickness."""
    shape, wall = shape_of(container), 0.012
    grown, spacing = shape.distance(wall, 2e-3), 2e-3
    low, high = shape.bounds
    points = np.random.default_rng(0).uniform(low, high, (50_000, 3))
    inside = points[shape.between_walls(points)]
    assert np.mean(grown.distance(inside) > -0.5 * spacing) > 0.995
    middle = 0.5 * (low + high)
    below = np.array([[middle[0] + x, middle[1], low[2] - z] for z in np.linspace(0.002, wall - 0.002, 5)
                      for x in np.linspace(0.0, 0.024, 13)])
    depth = low[2] - below[:, 2]
    assert np.all(grown.distance(below) < np.maximum(-depth, depth - wall) + spacing)


@pytest.mark.long
def test_convex_parts_hold_the_walls_and_little_else(container: ContainerConfig) -> None:
    """They leave out no point of the wall by 1 mm, and reach less than 2 mm into the inside, 4 mm at a box's edges."""
    if container.is_named:
        pytest.skip("its colliding geoms are in its file")
    shape = shape_of(container)
    spec = load_container("cup", container)
    hulls = [np.array(mesh.uservert).reshape(-1, 3) for mesh in spec.meshes if "_part_" in mesh.name]
    wall = trimesh.sample.sample_surface(shape.walls(), 2000, seed=0)[0]
    low, high = shape.bounds
    points = np.random.default_rng(0).uniform(low, high, (4000, 3))
    real = shape.distance(shape.wall, 1e-3).distance(points)
    deep = points[shape.between_walls(points) & (real > (4e-3 if container.size else 2e-3))]
    covered = np.zeros(len(wall), bool)
    for hull in hulls:
        solid = trimesh.convex.convex_hull(hull)
        planes = np.einsum("fd,fd->f", solid.face_normals, solid.triangles[:, 0])
        assert not np.any(np.all(deep @ solid.face_normals.T < planes, axis=1))
        covered |= np.all(wall @ solid.face_normals.T < planes + 1e-3, axis=1)
    assert covered.all()


def test_a_model_can_stand_twice_under_two_names() -> None:
    spec = mujoco.MjSpec()
    for name, x in (("left", -0.2), ("right", 0.2)):
        one = ContainerConfig(model="target", position=(x, 0.0, 0.0))
        with assembling():
            add_container(spec, name, one)
    model = compile_spec(spec)
    assert {model.body(k).name for k in range(1, model.nbody)} == {"left", "right"}
    assert model.ngeom == 12 and model.nmesh == 2


def test_a_tilted_container_turns_about_its_own_axes_before_its_yaw() -> None:
    pose = ContainerConfig(model="target", position=PLACE, yaw_deg=90.0, tilt_deg=(0.0, 30.0)).pose
    assert pose.matrix @ [0.0, 0.0, 1.0] == pytest.approx([0.0, 0.5, np.sqrt(0.75)], abs=1e-12)


def test_what_is_wrong_with_a_container_is_said(tmp_path: Path, bowl: ContainerConfig) -> None:
    for keys, message in (({"radius": 0.05}, "radius = 0.05, height = None; accepted: both, or none"),
                          ({"radius": 0.05, "height": 0.05, "model": "target"}, "model and radius are given; accepted"),
                          ({"scale": 0.001, "size": (0.1, 0.1, 0.1)}, "scale or thickness without a mesh")):
        with pytest.raises(ValueError, match=message):
            ContainerConfig.model_validate({"position": PLACE, **keys})
    with pytest.raises(ConfigError, match="no such file; accepted: a mesh"):
        shape_of(bowl.model_copy(update={"mesh": str(tmp_path / "missing.stl")}))


CUPS = [RoundShape(0.04, 0.06, 0.003), BoxShape((0.12, 0.08, 0.05), 0.003)]
CELL = 0.006
MIDDLE = 1e-3 * (BOWL_MM + 0.5 * WALL_MM)
"""Radius [m] of the middle of the ladle's wall."""


def check_face(face: trimesh.Trimesh, solid: list[trimesh.Trimesh], wall: float) -> None:
    """A face has no other edge than the rim, and the solid's wall lies behind it, not before."""
    edges = face.edges_sorted
    _, times = np.unique(edges, axis=0, return_counts=True)
    assert face.is_winding_consistent and times.max() == 2 and 10 < (times == 1).sum() < 140
    centres, normals = face.triangles_center, face.face_normals
    large = face.area_faces > 1e-8
    for step, inside in ((-0.5 * wall, True), (0.5 * wall, False)):
        points = (centres + step * normals)[large]
        held = np.any([part.contains(points) for part in solid], axis=0)
        assert np.mean(held == inside) > 0.97, (step, np.mean(held))


@pytest.mark.long
@pytest.mark.parametrize("name", ["spoon", "scoop", "bottle"])
def test_of_tools(name: str) -> None:
    tool = tool_shape(name)
    shell = tool.head_shell
    check_face(shell.mesh, tool.head, 0.0015)
    assert shell.thickness == 0.0015 and shell.behind == 0.00075


@pytest.mark.parametrize("cup", CUPS, ids=["round", "box"])
def test_of_containers(cup: ContainerShape) -> None:
    check_face(cup.shell().mesh, [cup.walls()], cup.wall)


@pytest.fixture(scope="module")
def ladle(tmp_path_factory: pytest.TempPathFactory) -> ToolShape:
    """A ladle of one's own: the middle of its wall, with a rod."""
    path = write_ladle(tmp_path_factory.mktemp("sheet") / "ladle.stl", sheet=True)
    return tool_shape(ToolConfig.model_validate(ladle_keys(path, thickness=1e-3 * WALL_MM)))


def test_an_own_tool_has_a_shell_and_a_lip_where_its_files_tell(ladle: ToolShape, tmp_path: Path) -> None:
    """From the middle of a wall, or a closed mesh with its inner face; a solid has the lip that its file gives."""
    assert ladle.head_shell.behind == 0.0 and ladle.lip == pytest.approx([MIDDLE, 0.0, 0.0], abs=1e-6)
    solid, face = half_sphere(BOWL_MM, WALL_MM), half_sphere(BOWL_MM, WALL_MM)
    face.update_faces(np.linalg.norm(face.triangles_center, axis=1) < BOWL_MM + 0.1)
    face.update_faces(np.linalg.norm(face.vertices[face.faces], axis=2).max(1) < BOWL_MM + 0.1)
    solid.export(tmp_path / "bowl.stl")
    face.invert()  # it is turned to what it holds
    face.export(tmp_path / "face.stl")
    keys = ladle_keys(tmp_path / "bowl.stl", handle={**HANDLE, "radius": 0.01})
    closed = tool_shape(ToolConfig.model_validate(keys | {"thickness": 1e-3 * WALL_MM,
                                                          "inner_face": str(tmp_path / "face.stl")}))
    check_face(closed.head_shell.mesh, closed.head, 1e-3 * WALL_MM)
    assert closed.lip == pytest.approx([1e-3 * BOWL_MM, 0.0, 0.0], abs=1e-6)
    assert closed.capacity == pytest.approx(2.0 / 3.0 * np.pi * (1e-3 * BOWL_MM) ** 3, rel=0.01)
    with pytest.raises(ConfigError, match="'shovel' has no inner_face, and its mesh is closed"):
        _ = tool_shape("shovel").head_shell
    assert tool_shape(ToolConfig.model_validate(keys | {"lip": (0.028, 0.0, 0.0)})).lip == pytest.approx([0.028, 0, 0])


@pytest.mark.long
def test_an_own_thin_ladle_holds_grains_and_pours_them_over_its_lip(ladle: ToolShape) -> None:
    """Level it keeps all of them for 0.15 s; turned by 110 deg about its lip in 0.5 s it loses them ahead of it."""
    lip, start = ladle.lip, mpm.Pose(np.array([0.07, 0.05, 0.09]), np.array([1.0, 0.0, 0.0, 0.0]))
    grains = mpm.sample_box((-MIDDLE,) * 3, (MIDDLE, MIDDLE, 0.0), CELL / 2, np.random.default_rng(0))
    grains = grains[(np.linalg.norm(grains, axis=1) < MIDDLE - 3e-3) & (grains[:, 2] < -5e-3)]
    salt = mpm.DruckerPrager(E=1.5e5, nu=0.2, density=1217.0, friction_angle_deg=33.0)
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.2, 0.1, 0.16), CELL),
                        bodies=[mpm.Body(salt, start.apply(grains), volume=(CELL / 2) ** 3)],
                        colliders=[mpm.Collider(ladle.head_shell, friction=0.1, pose=start)])
    solver.advance(0.15)
    held = solver.positions() - start.position
    assert np.linalg.norm(held, axis=1).max() < MIDDLE + 1e-3 and held[:, 2].max() < 5e-3
    pose = start
    for step in range(1, 251):
        turn = Rotation.from_euler("y", np.radians(110.0) * step / 250)
        end = mpm.Pose(start.position + lip - turn.apply(lip), turn.as_quat(scalar_first=True))
        solver.set_collider_motion(0, pose, end)
        solver.advance(2e-3)
        pose = end
    solver.advance(0.1)
    x = solver.positions()
    left = np.linalg.norm(pose.inverse().apply(x), axis=1) > MIDDLE + 3e-3
    assert left.mean() > 0.9
    assert np.all(x[left, 0] > start.position[0] + lip[0] - 5e-3)  # none through the wall, behind the lip
    solver.close()
