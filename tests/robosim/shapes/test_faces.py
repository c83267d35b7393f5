"""Inner faces, from which thin shells are made: they lie on the solids' inner surfaces and face what these hold."""

import numpy as np
import pytest
import trimesh

from robosim.base.errors import ConfigError
from robosim.shapes import TOOLS, tool_shape
from robosim.shapes.containers import BoxShape, ContainerShape, RoundShape
from robosim.shapes.sheet_tools import TROUGH_DEPTH, TROUGH_LENGTH
from robosim.shapes.tool import WALL, ToolShape
from robosim.shapes.vessels import BOWL, MOUTH, NECK_RADIUS

CUPS = [RoundShape(0.04, 0.06, 0.003), BoxShape((0.12, 0.08, 0.05), 0.003)]


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


@pytest.mark.parametrize("name", ["spoon", "scoop", "bottle"])
def test_of_tools(name: str) -> None:
    shape = tool_shape(name)
    assert isinstance(shape, ToolShape)
    shell = shape.head_shell()
    check_face(shell.mesh, [shape.head(WALL)], WALL)
    assert shell.thickness == WALL and shell.behind == WALL / 2


@pytest.mark.parametrize("cup", CUPS, ids=["round", "box"])
def test_of_containers(cup: ContainerShape) -> None:
    check_face(cup.shell().mesh, [cup.walls()], cup.wall)


def test_a_head_without_a_hollow_is_refused() -> None:
    with pytest.raises(ConfigError, match="tool 'shovel' holds nothing"):
        tool_shape("shovel").head_shell()


def test_lips_of_the_bundled_tools() -> None:
    assert TOOLS["spoon"].lip() == pytest.approx([BOWL[0], 0.0, 0.0])
    assert TOOLS["scoop"].lip() == pytest.approx([0.5 * TROUGH_LENGTH, 0.0, -TROUGH_DEPTH], abs=1e-6)
    assert TOOLS["bottle"].lip() == pytest.approx([NECK_RADIUS, 0.0, MOUTH])
    assert TOOLS["shaker"].lip() == pytest.approx([0.0, 0.0, TOOLS["shaker"].holes.positions[0][2]])
    assert TOOLS["shovel"].lip() is None  # it holds nothing
