"""Thin shells of tools' heads and of containers: where the middle of their walls lies, and what is left open."""

import numpy as np
import pytest
import trimesh
from own_meshes import write_bowl

from robosim.config.scene import ContainerConfig
from robosim.scene.models import container_shape
from robosim.shapes import TOOLS
from robosim.shapes.tool import WALL

HOLDING = ("spoon", "scoop", "bottle")
PLACE = (0.6, 0.1, 0.05)


@pytest.mark.parametrize("name", TOOLS)
def test_a_sheet_lies_in_the_middle_of_the_wall(name: str) -> None:
    """Half a wall from the surfaces of the head with its real wall, by the distances of the closed mesh."""
    tool = TOOLS[name]
    sheet, head = tool.sheet(0.5 * WALL), tool.head(WALL)
    centres = sheet.triangles_center
    depth = trimesh.proximity.signed_distance(head, centres)
    away = np.array([0.0, 0.0, centres[:, 2].max()]) - centres  # near the rim the edge is closer than the faces
    inner = depth[np.abs(away[:, 2]) > 2.0 * WALL]
    assert np.median(inner) == pytest.approx(0.5 * WALL, rel=0.05)
    assert inner.min() > 0.25 * WALL


@pytest.mark.parametrize("name", HOLDING)
def test_a_sheet_is_open_at_the_rim_alone(name: str) -> None:
    sheet = TOOLS[name].sheet(0.5 * WALL)
    edges, counts = np.unique(sheet.edges_sorted, axis=0, return_counts=True)
    border = sheet.vertices[np.unique(edges[counts == 1])]
    assert sheet.is_winding_consistent and counts.max() == 2 and len(border)
    if name == "scoop":  # open in front, too; its back ends 1.6 mm below the rim
        assert np.all((border[:, 2] > -2.0 * WALL) | np.isclose(border[:, 0], sheet.bounds[1, 0]))
    else:
        assert np.ptp(border[:, 2]) < 1e-9 and border[0, 2] == pytest.approx(sheet.bounds[1, 2])


@pytest.mark.parametrize("kind", ["box", "round", "mesh"])
def test_a_container_as_a_shell_has_its_real_wall(kind: str, tmp_path_factory: pytest.TempPathFactory) -> None:
    """The shell's front is where the closed walls have theirs: points of the middle of the wall lie inside them."""
    given = {"box": {"size": (0.12, 0.1, 0.06)}, "round": {"radius": 0.05, "height": 0.08, "wall": 0.003}}.get(kind) or {
        "mesh": str(write_bowl(tmp_path_factory.mktemp("bowl") / "bowl.stl")), "scale": 1e-3}
    shape = container_shape("cup", ContainerConfig(position=PLACE, shell=True, **given))  # pyright: ignore
    shell = shape.shell()
    assert shell.thickness == pytest.approx(shape.wall)
    middle = shell.mesh.triangles_center - shell.behind * shell.mesh.face_normals
    low, high = shape.bounds
    depth = trimesh.proximity.signed_distance(shape.walls(), middle[middle[:, 2] < high[2] - shape.wall])
    assert np.median(depth) == pytest.approx(0.5 * shape.wall, rel=0.2)
    assert np.mean(depth > 0.0) > 0.9  # a mesh's rim belongs to its inner surface, too
