"""Meshes from files and curves: exact volumes, and what is wrong with a file is refused by name."""

import runpy
from pathlib import Path

import numpy as np
import pytest
import trimesh

from robosim.base.errors import ConfigError
from robosim.base.resources import folder
from robosim.shapes.inside import find_inside
from robosim.shapes.mesh_files import read_parts
from robosim.shapes.solids import loft, make_container_shell, revolve


def half_sphere(radius: float = 0.04, sections: int = 96) -> trimesh.Trimesh:
    """Return the lower half of a sphere, open at the top."""
    angle = np.linspace(-np.pi / 2.0, 0.0, 33)
    return trimesh.creation.revolve(radius * np.column_stack([np.cos(angle), np.sin(angle)]), sections=sections)


@pytest.mark.parametrize(("suffix", "scale"), [(".stl", 1e-3), (".obj", 1.0)])
def test_a_surface_becomes_a_wall_of_its_area_and_thickness(suffix: str, scale: float, tmp_path: Path) -> None:
    """A thin half sphere: 2 pi r^2 t, and inside it 2/3 pi (r - t/2)^3 of water, less what the lattice rounds."""
    path, thickness = tmp_path / f"bowl{suffix}", 1.5e-3
    surface = half_sphere()
    surface.copy().apply_scale(1.0 / scale).export(path)
    (wall,) = read_parts(path, thickness, scale)
    assert wall.is_watertight and wall.volume == pytest.approx(surface.area * thickness, rel=2e-3)
    assert wall.volume == pytest.approx(2.0 * np.pi * 0.04**2 * thickness, rel=0.01)
    inside = find_inside(wall)
    assert inside.volume == pytest.approx(2.0 / 3.0 * np.pi * (0.04 - thickness / 2) ** 3, rel=0.06)


def test_a_closed_mesh_is_a_solid_whatever_its_winding(tmp_path: Path) -> None:
    box = trimesh.creation.box((0.1, 0.05, 0.02))
    box.invert()
    box.export(tmp_path / "box.stl")
    (solid,) = read_parts(tmp_path / "box.stl")
    assert solid.volume == pytest.approx(1e-4) and solid.is_watertight


def refuse(mesh: trimesh.Trimesh, path: Path, message: str, thickness: float | None = None) -> None:
    """Write a mesh and check that it is refused with a message."""
    mesh.export(path)
    with pytest.raises(ConfigError, match=message):
        read_parts(path, thickness)


def self_cutting_box() -> trimesh.Trimesh:
    """Return a box with one corner drawn through the opposite side."""
    box = trimesh.creation.box((0.1, 0.1, 0.1)).subdivide()
    corner = np.linalg.norm(box.vertices - 0.05, axis=1).argmin()
    vertices = box.vertices.copy()
    vertices[corner] = [-0.08, -0.01, -0.02]
    return trimesh.Trimesh(vertices, box.faces)


def test_parts_may_overlap_and_a_thickness_is_that_of_open_ones(tmp_path: Path) -> None:
    """A bowl with a rod through its wall, in one file; two boxes that share a corner of space."""
    rod = trimesh.creation.cylinder(0.005, 0.1).apply_translation([0.0, 0.0, 0.02])
    trimesh.util.concatenate([half_sphere(), rod]).export(tmp_path / "ladle.stl")
    wall, solid = sorted(read_parts(tmp_path / "ladle.stl", 1e-3), key=lambda part: -part.area)
    assert wall.volume == pytest.approx(2.0 * np.pi * 0.04**2 * 1e-3, rel=0.01)
    assert solid.volume == pytest.approx(rod.volume, rel=1e-6)
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    trimesh.util.concatenate([box, box.copy().apply_translation([0.04, 0.03, 0.02])]).export(tmp_path / "boxes.obj")
    assert [part.volume for part in read_parts(tmp_path / "boxes.obj")] == pytest.approx([1e-3, 1e-3])


def test_what_is_wrong_with_a_file_is_said(tmp_path: Path) -> None:
    path, bowl, box = tmp_path / "tool.stl", half_sphere(), trimesh.creation.box((0.1, 0.1, 0.1))
    refuse(bowl, path, r"open at \d+ edges, the first near \(.*\) mm; accepted: a closed mesh, or a surface")
    refuse(box, path, "closed, and thickness = 0.001 m is given", 1e-3)
    refuse(bowl.copy().apply_scale(1000.0), path, r"80 m long; .* is it in millimetres \(scale: 0.001\)", 1e-3)
    refuse(bowl.copy().apply_scale(1e-3), path, r"8e-05 m long; .* is it in another unit", 1e-3)
    refuse(self_cutting_box(), path, r"cuts itself at \d+ pairs of faces, the first near \(.*\) mm; accepted: a mesh")
    refuse(bowl, path, r"cuts itself at .*; accepted: its wall of 100 mm: thinner", 0.1)
    flipped = bowl.copy()
    flipped.faces[::2] = flipped.faces[::2, ::-1]
    refuse(flipped, path, "neighbouring faces look to opposite sides", 1e-3)
    (tmp_path / "no.stl").write_text("not a mesh")
    for name, message in (("no.stl", "cannot be read as a mesh|holds no triangles"), ("missing.stl", "no such file"),
                          ("tool.off", "no such file")):
        with pytest.raises(ConfigError, match=message):
            read_parts(tmp_path / name)
    (tmp_path / "tool.off").write_text("off")
    with pytest.raises(ConfigError, match=r"\.off format; accepted: .stl, .obj, .ply"):
        read_parts(tmp_path / "tool.off")


def test_builders_give_closed_meshes_of_the_right_volume() -> None:
    sweep = runpy.run_path(str(folder("models") / "curves.py"))["sweep"]
    angle = np.linspace(-np.pi / 2, np.pi / 2, 41)
    ball = revolve(np.stack([np.cos(angle), np.sin(angle)], axis=1), 80)
    tube = sweep(np.linspace([0.0, 0.0, 0.0], [1.0, 0.0, 1.0], 9), np.full(9, 0.1), segments=80)
    box = loft([[[0, 0, z], [1, 0, z], [1, 1, z], [0, 1, z]] for z in (0.0, 2.0)])
    for mesh, volume in ((ball, 4 / 3 * np.pi), (tube, np.pi * 0.01 * np.sqrt(2.0)), (box, 2.0)):
        assert mesh.is_watertight and mesh.is_winding_consistent
        assert mesh.volume == pytest.approx(volume, rel=0.01)
    shell = make_container_shell((0.2, 0.15, 0.08))
    assert shell.is_watertight and shell.body_count == 1
