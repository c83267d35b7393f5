"""Signed distances baked from meshes against closed forms."""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

import mpm
from mpm.backend import default_precision, ti


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


TURN = Rotation.from_rotvec([0.4, -0.3, 0.8]).as_matrix()
SHAPES = {
    "plane": mpm.Sdf.plane((0.3, 0.2, 0.9)), "sphere": mpm.Sdf.sphere(0.02), "capsule": mpm.Sdf.capsule(0.01, 0.02),
    "box": mpm.Sdf.box((0.02, 0.015, 0.01)), "cylinder": mpm.Sdf.cylinder(0.012, 0.01),
    "height_field": mpm.Sdf.height_field(
        np.add.outer(2e-3 * np.linspace(0, 1, 9) ** 2, 1e-3 * np.linspace(0, 1, 7) ** 2), (0.02, 0.018)),
    "union": mpm.Sdf.union([
        (mpm.Sdf.box((0.004, 0.006, 0.005)), mpm.Pose.from_matrix(np.array([0.008, 0, 0]), TURN)),
        (mpm.Sdf.cylinder(0.005, 0.004), mpm.Pose.from_matrix(np.array([-0.006, 0.003, 0.002]), TURN.T))]),
}


def test_ellipsoid_is_exact_at_its_surface() -> None:
    half = np.array([0.03, 0.02, 0.01])
    ellipsoid = mpm.Sdf.ellipsoid(half)
    u = np.random.default_rng(0).normal(size=(500, 3))
    u /= np.linalg.norm(u, axis=1)[:, None]
    normal = (u / half) / np.linalg.norm(u / half, axis=1)[:, None]
    for offset in (-2e-4, 0.0, 2e-4):
        points = half * u + offset * normal
        assert ellipsoid.distance(points) == pytest.approx(offset, abs=1e-12 + 0.06 * abs(offset))


@pytest.mark.parametrize("name", [*SHAPES, "lattice"])
def test_kernel_distance_and_normal_are_the_hosts(name: str) -> None:
    """What the kernels read equals the host's distance, and the normal is its gradient."""
    shape = SHAPES.get(name) or mpm.Sdf.from_mesh(trimesh.creation.box((0.03, 0.03, 0.03)), spacing=1e-3)
    if hasattr(shape, "allocate"):
        shape.allocate()
    points = np.random.default_rng(5).uniform(-0.016, 0.016, (300, 3))
    out = np.zeros((300, 4))

    @ti.kernel
    def evaluate(y: ti.types.ndarray(), result: ti.types.ndarray()):
        for i in range(300):
            n, phi = shape.at(ti.Vector([ti.cast(y[i, 0], ti.f64), ti.cast(y[i, 1], ti.f64), ti.cast(y[i, 2], ti.f64)]))
            for d in ti.static(range(3)):
                result[i, d] = n[d]
            result[i, 3] = phi

    with default_precision("f64"):
        evaluate(points, out)
    assert out[:, 3] == pytest.approx(shape.distance(points), abs=2e-8)
    h = 1e-6
    gradient = np.stack([(shape.distance(points + h * e) - shape.distance(points - h * e)) / (2 * h)
                         for e in np.eye(3)], -1)
    size = np.linalg.norm(gradient, axis=1)
    smooth = np.abs(size - 1.0) < 0.02  # edges and medial surfaces have no gradient
    assert smooth.mean() > 0.6 and np.abs(out[smooth, :3] - gradient[smooth] / size[smooth, None]).max() < 0.05
