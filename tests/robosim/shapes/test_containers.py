"""Containers from sizes and meshes: their inside, walls and grains agree."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh
from own_meshes import write_bowl

from robosim.base.errors import ConfigError
from robosim.config.scene import ContainerConfig
from robosim.robot.mjspec import compile_spec, quiet_attachment
from robosim.scene.build import add_container
from robosim.scene.models import container_shape, load_container
from robosim.shapes.containers import ContainerShape

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
        with quiet_attachment():
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
