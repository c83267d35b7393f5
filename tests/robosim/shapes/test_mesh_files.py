"""Meshes from files and curves: exact volumes, and what is wrong with a file is refused by name."""

import runpy
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
import trimesh

from robosim.base.errors import ConfigError, DoubledFaces
from robosim.base.resources import folder
from robosim.shapes import self_cuts
from robosim.shapes.containers import make_container_shell
from robosim.shapes.inside import find_inside
from robosim.shapes.mesh_files import join, read_parts, thicken


def half_sphere(radius: float = 0.04, sections: int = 96) -> trimesh.Trimesh:
    """Return the lower half of a sphere, open at the top."""
    angle = np.linspace(-np.pi / 2.0, 0.0, 33)
    return trimesh.creation.revolve(radius * np.column_stack([np.cos(angle), np.sin(angle)]), sections=sections)


def flip(faces: np.ndarray) -> np.ndarray:
    """Return faces of which every third looks to the other side."""
    return np.where(np.arange(len(faces))[:, None] % 3 == 0, faces[:, ::-1], faces)


def add_slivers(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """Return a mesh where every ninth face is cut in three, with two slivers in the gap."""
    a, b, c = mesh.faces[::9].T
    d, e = len(mesh.vertices) + np.arange(2 * len(a)).reshape(2, -1)
    begin, end = mesh.vertices[a], mesh.vertices[b]
    cut = np.array([(a, d, c), (d, e, c), (e, b, c), (b, e, a), (e, d, a)]).swapaxes(1, 2).reshape(-1, 3)
    return trimesh.Trimesh(np.concatenate([mesh.vertices, (2.0 * begin + end) / 3.0, 0.5 * (begin + end)]),
                           np.concatenate([np.delete(mesh.faces, np.s_[::9], axis=0), cut]), process=False)


FACES = {
    "plain.stl": lambda faces: faces, "flipped.stl": flip, "inside_out.ply": lambda faces: faces[:, ::-1],
    "one_twice.stl": lambda faces: np.concatenate([faces, faces[:1]]),
    "all_twice.ply": lambda faces: flip(np.concatenate([faces, faces[:, ::-1]])[::-1])}


@pytest.mark.long
@pytest.mark.parametrize("sheet", [False, True])
def test_every_form_of_a_ladle_holds_the_same(sheet: bool, tmp_path: Path, recwarn: pytest.WarningsRecorder) -> None:
    """A wall of 2 pi r^2 t, or its middle and t, around 2/3 pi (r - t/2)^3 of water, with a closed rod through it."""
    bowl, held = half_sphere(sections=24), []
    rod = trimesh.creation.cylinder(0.005, segment=[[0.036, 0.0, -0.01], [0.1, 0.0, 0.02]], sections=12)
    ladle = join([bowl if sheet else thicken(bowl, 1e-3), rod])
    ladle.merge_vertices()
    groups = ladle.submesh([range(99), range(99, len(ladle.faces))], repair=False)
    forms = {k: trimesh.Trimesh(ladle.vertices, change(ladle.faces), process=False) for k, change in FACES.items()}
    forms |= {"a.glb": ladle, "normals.obj": ladle, "groups.obj": trimesh.Scene(groups), "cut.stl": add_slivers(ladle)}
    for name, form in forms.items():
        form.export(tmp_path / name, **({"include_normals": True} if name == "normals.obj" else {}))
        parts = sorted(read_parts(tmp_path / name, 1e-3 if sheet else None), key=lambda part: part.volume)
        assert all(part.nondegenerate_faces().all() and part.is_volume for part in parts), name
        held.append([find_inside(parts, cells=60).volume, *(part.volume for part in parts)])
    np.testing.assert_allclose(held, held[:1] * len(held), rtol=2e-3)
    assert held[0] == pytest.approx([2 / 3 * np.pi * 0.0395**3, rod.volume, 2.0 * np.pi * 0.04**2 * 1e-3], rel=0.05)
    said = [str(one.message) for one in recwarn if (one.category, one.filename) == (DoubledFaces, "robosim")]
    assert len(said) == 2 and f"one_twice.stl: 1 of {len(ladle.faces) + 1} faces join the same corners" in said[0]


def test_slender_faces_take_little_memory_or_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A tilted sheet of 4000 strips, 400 kB as STL, of which all boxes along the axes overlap; then a cone of 600."""
    curve = np.column_stack([np.linspace(0.0, 0.1, 4001), 0.02 * np.sin(np.linspace(0.0, 3.0, 4001))])
    sheet = trimesh.creation.revolve(curve + [1.0, 0.0], angle=0.3, sections=1)
    sheet.apply_transform(trimesh.transformations.euler_matrix(0.5, 0.3, 0.8)).export(tmp_path / "sheet.stl")
    tracemalloc.start()
    (wall,) = read_parts(tmp_path / "sheet.stl", 5e-4)
    assert wall.volume == pytest.approx(5e-4 * sheet.area, rel=1e-3) and tracemalloc.get_traced_memory()[1] < 3e8
    tracemalloc.stop()
    monkeypatch.setattr(self_cuts, "MOST_PAIRS", 100_000)
    cone = trimesh.creation.revolve([[0.005, 0.0], [0.1, 0.03]], sections=600)
    refuse(cone, tmp_path / "cone.stl", r"its 1200 triangles overlap in \d+ pairs .*accepted: up to 100000", 5e-4)


def refuse(mesh: trimesh.Trimesh | trimesh.Scene, path: Path, message: str, thickness: float | None = None) -> None:
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


def test_what_is_wrong_with_a_file_is_said(tmp_path: Path) -> None:
    path, bowl, box = tmp_path / "tool.stl", half_sphere(), trimesh.creation.box((0.1, 0.1, 0.1))
    refuse(bowl, path, r"open at \d+ edges, the first near \(.*\) mm; accepted: a closed mesh, or a surface")
    refuse(box, path, "closed, and thickness = 0.001 m is given", 1e-3)
    refuse(bowl.copy().apply_scale(1000.0), path, r"80 m long; .* is it in millimetres \(scale: 0.001\)", 1e-3)
    refuse(bowl.copy().apply_scale(1e-3), path, r"8e-05 m long; .* is it in another unit", 1e-3)
    refuse(self_cutting_box(), path, r"cuts itself at \d+ pairs of faces, the first near \(.*\) mm; accepted: a mesh")
    refuse(bowl, path, r"cuts itself at .*; accepted: its wall of 100 mm: thinner", 0.1)
    corners, around = [[1, 2, 0], [4, 0, 5], [0, 7, 3], [9, 9, 6], [2, 4, 8]], np.arange(5)[:, None] + np.arange(3)
    refuse(trimesh.Trimesh(0.01 * np.array(corners), around % 5, process=False), path, "no front side, as a Moeb", 1e-3)
    refuse(trimesh.creation.box((0.1, 0.1, 0.0)), path, "flat, its faces enclose no volume")
    refuse(trimesh.Trimesh(box.vertices, box.faces + 1, process=False), tmp_path / "n.ply", "without finite corners")
    refuse(box + box.subdivide(), path, "2 parts, of which some are the same solid; accepted: each part once")
    refuse(trimesh.Scene([box.subdivide_loop(3)] * 300), tmp_path / "n.glb", "230400 triangles; accepted: up to 200000")
    for name in ("no.stl", "tool.off"):
        (tmp_path / name).write_text("not a mesh")
    for name, message in (("no.stl", "cannot be read as a mesh|holds no triangles"), ("missing.stl", "no such file"),
                          ("tool.off", r"\.off format; accepted: .stl, .obj, .ply, .glb")):
        with pytest.raises(ConfigError, match=message):
            read_parts(tmp_path / name)


def test_builders_give_closed_meshes_of_the_right_volume() -> None:
    sweep, revolve, loft = map(runpy.run_path(str(folder("models") / "curves.py")).get, ("sweep", "revolve", "loft"))
    angle = np.linspace(-np.pi / 2, np.pi / 2, 41)
    ball = revolve(np.stack([np.cos(angle), np.sin(angle)], axis=1), 80)
    tube = sweep(np.linspace([0.0, 0.0, 0.0], [1.0, 0.0, 1.0], 9), np.full(9, 0.1), segments=80)
    box = loft([[[0, 0, z], [1, 0, z], [1, 1, z], [0, 1, z]] for z in (0.0, 2.0)])
    for mesh, volume in ((ball, 4 / 3 * np.pi), (tube, np.pi * 0.01 * np.sqrt(2.0)), (box, 2.0)):
        assert mesh.is_watertight and mesh.is_winding_consistent
        assert mesh.volume == pytest.approx(volume, rel=0.01)
    shell = make_container_shell((0.2, 0.15, 0.08))
    assert shell.is_watertight and shell.body_count == 1
