"""Signed distances baked from meshes against closed forms."""

import numpy as np
import pytest
import trimesh

import mpm


def test_box_lattice_is_exact_near_the_surface() -> None:
    half = np.array([0.02, 0.015, 0.01])
    lattice = mpm.Sdf.from_mesh(trimesh.creation.box(2 * half), spacing=1e-3)
    points = np.random.default_rng(0).uniform(-half - 1.5e-3, half + 1.5e-3, (4000, 3))
    exact = mpm.Sdf.box(half).distance(points)
    near = np.abs(exact) < 1.5e-3
    # trilinear values bend over edges, where the distance is not smooth
    assert np.abs(lattice.distance(points) - exact)[near].max() < 0.4e-3
    assert np.median(np.abs(lattice.distance(points) - exact)[near]) < 1e-5
    clear = np.abs(exact) > 0.5e-3
    assert (np.sign(lattice.distance(points)) == np.sign(exact))[clear].all()


def test_sphere_lattice_is_accurate() -> None:
    mesh = trimesh.creation.icosphere(subdivisions=5, radius=0.02)
    mesh.vertices *= 0.02 / np.linalg.norm(mesh.vertices, axis=1)[:, None]
    lattice = mpm.Sdf.from_mesh(mesh, spacing=1e-3)
    points = np.random.default_rng(1).normal(size=(2000, 3))
    points *= np.random.default_rng(2).uniform(0.0185, 0.0215, (2000, 1)) / np.linalg.norm(points, axis=1)[:, None]
    exact = np.linalg.norm(points, axis=1) - 0.02
    assert np.abs(lattice.distance(points) - exact).max() < 2e-5


def test_union_of_overlapping_parts_has_no_hole() -> None:
    parts = [trimesh.creation.box((0.02, 0.02, 0.02)),
             trimesh.creation.box((0.02, 0.02, 0.02), trimesh.transformations.translation_matrix((0.01, 0, 0)))]
    lattice = mpm.Sdf.from_mesh(parts, spacing=1e-3)
    assert lattice.distance(np.array([[0.005, 0.0, 0.0]]))[0] < -4.9e-3


def test_open_mesh_is_refused() -> None:
    mesh = trimesh.creation.box((0.02, 0.02, 0.02))
    mesh.update_faces(np.arange(len(mesh.faces)) > 1)
    with pytest.raises(mpm.InvalidValue, match="open edges"):
        mpm.Sdf.from_mesh(mesh)
