"""Depth images against the analytic depth of planes and balls, and triangles that reach behind the camera."""

import numpy as np
import pytest
import trimesh

from mpm.observers.depth_image import DepthImage, Lens, Parts

LENS = Lens.from_fovy(64, 48, 50.0)
AHEAD = np.array([[1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0]], float)  # A part in the camera's own axes


def draw(triangles: np.ndarray, frames: np.ndarray = AHEAD, lens: Lens = LENS) -> np.ndarray:
    image = DepthImage(lens)
    depth = image.empty()
    image.draw_parts(Parts(triangles, np.zeros(len(triangles), int), len(frames)), frames, depth)
    return depth


def rays(lens: Lens = LENS) -> np.ndarray:
    x, y = np.meshgrid((np.arange(lens.width) + 0.5 - lens.cx) / lens.fx,
                       (np.arange(lens.height) + 0.5 - lens.cy) / lens.fy)
    return np.stack([x, y, np.ones_like(x)], -1)


def plane_through(normal: np.ndarray, offset: float, size: float = 300.0) -> np.ndarray:
    """Two triangles of the plane normal . x = offset, seen from the origin."""
    normal = normal / np.linalg.norm(normal)
    u = np.cross(normal, [0.3, 0.5, 0.8])
    u /= np.linalg.norm(u)
    v = np.cross(normal, u)
    a, b, c, d = (offset * normal + size * (s * u + t * v) for s, t in ((-1, -1), (1, -1), (1, 1), (-1, 1)))
    return np.array([[a, c, b], [a, d, c]]) if offset > 0 else np.array([[a, b, c], [a, c, d]])


@pytest.mark.parametrize("normal, offset", [((0, 0, 1), 2.0), ((0.3, -0.2, 1), 1.0), ((0, 1, 0.05), 0.4)])
def test_plane_that_passes_behind_the_camera_has_its_analytic_depth(normal: tuple, offset: float):
    n = np.array(normal, float) / np.linalg.norm(normal)
    along = rays() @ n
    expected = np.where(along > 0.0, offset / np.maximum(along, 1e-9), np.inf)
    seen = expected < 100.0
    depth = draw(plane_through(n, offset))
    np.testing.assert_allclose(depth[seen], expected[seen], rtol=2e-4)
    assert seen.any()


def test_triangles_are_seen_from_one_side():
    one = plane_through(np.array([0.0, 0.0, 1.0]), 2.0)
    assert np.isfinite(draw(one)).all() and np.isinf(draw(one[:, ::-1])).all()


def test_ball_occludes_a_plane_and_moves_with_its_frame():
    ball = trimesh.creation.icosphere(5, 0.3)
    place = np.array([0.1, -0.05, 1.5])
    frames = np.concatenate([np.eye(3).ravel(), place])[None]
    depth = np.minimum(draw(np.asarray(ball.triangles), frames), draw(plane_through(np.array([0, 0, 1.0]), 3.0)))
    d = rays()
    a, b, c = (d * d).sum(-1), d @ place, place @ place - 0.3**2
    root = b * b - a * c
    exact = np.where(root > 0.0, (b - np.sqrt(np.maximum(root, 0.0))) / a, 3.0)
    inside = np.abs(root) > 2e-3  # a polyhedron has another outline
    np.testing.assert_allclose(depth[inside], exact[inside], atol=1e-3)


def test_grains_are_drawn_as_parts_are():
    rng = np.random.default_rng(0)
    solid = np.asarray(trimesh.creation.icosphere(1, 0.02).triangles)
    positions = (rng.uniform(-0.3, 0.3, (200, 3)) + [0, 0, 1]).astype(np.float32)
    image = DepthImage(LENS)
    depth = image.empty()
    facets = np.ascontiguousarray(np.broadcast_to(solid, (200, *solid.shape)), np.float32)
    image.draw_grains(positions, facets, AHEAD[0], 0.02, depth)
    one_by_one = draw((solid[None] + positions[:, None, None]).reshape(-1, 3, 3))
    np.testing.assert_allclose(depth, one_by_one, atol=2e-4)  # single precision, faces seen from the side


def test_what_is_nearer_than_the_lens_allows_is_not_seen():
    near = LENS._replace(near=0.5)
    assert np.isinf(draw(plane_through(np.array([0, 0, 1.0]), 0.4), lens=near)).all()
    assert np.isfinite(draw(plane_through(np.array([0, 0, 1.0]), 0.6), lens=near)).all()
