"""Open shells are tight: wherever and however they stand, moved and shaken."""

from collections.abc import Callable

import numpy as np
import pytest
import trimesh
from field_parts import UPRIGHT, sand
from scipy.spatial.transform import Rotation

import mpm

CELL, HALF, RADIUS = 0.006, 0.021, 0.03
PLACES = [np.zeros(3), *(np.array(p) for p in ((.5, 0, 0), (.5, .5, 0), (0, .5, .5), (.5,) * 3, (.25,) * 3, (.1,) * 3,
                                               (.2, .2, 0), (.3,) * 3, (.4, .4, 0)))]
"""On nodes, between them, and on the points of the lattices of distances that lie between."""


def upper_open(mesh: trimesh.Trimesh, height: float) -> trimesh.Trimesh:
    """The part of a surface below a height."""
    return trimesh.Trimesh(mesh.vertices, mesh.faces[mesh.triangles_center[:, 2] < height])


def cone() -> trimesh.Trimesh:
    mesh = trimesh.creation.cone(RADIUS, 2 * RADIUS, sections=48)
    mesh.apply_transform(trimesh.transformations.rotation_matrix(np.pi, (1, 0, 0), (0, 0, 0.5 * RADIUS)))
    return upper_open(mesh, mesh.bounds[1, 2] - 1e-6)


SHAPES: dict[str, tuple[trimesh.Trimesh, Callable[[np.ndarray], np.ndarray]]] = {
    # surface, and how far a place (n, 3) lies inside it [m]
    "box": (upper_open(trimesh.creation.box((2 * HALF, 2 * HALF, 0.07)), 0.034),
            lambda y: np.minimum(HALF - np.abs(y[:, :2]).max(1), y[:, 2] + 0.035)),
    "bowl": (upper_open(trimesh.creation.icosphere(4, RADIUS), 0.0), lambda y: RADIUS - np.linalg.norm(y, axis=1)),
    "cone": (cone(), lambda y: (y[:, 2] + RADIUS - 2 * np.hypot(y[:, 0], y[:, 1])) / np.sqrt(5.0))}


def count_outside(name: str, pose: mpm.Pose, move: Callable[[float], np.ndarray], duration: float = 0.25) -> int:
    """Fill a shell, let it settle and move by move(time) [m] (3,); return how many grains have passed it."""
    sheet, depth = SHAPES[name]
    turn = Rotation.from_quat(np.roll(pose.quaternion, -1))
    place = mpm.sample_box((-RADIUS, -RADIUS, -0.036), (RADIUS, RADIUS, -0.004), CELL / 2)
    x = turn.apply(place[depth(place) > 0.0025]) + pose.position
    shell = mpm.Collider(mpm.Shell.from_mesh(sheet, 1.2e-3), friction=0.3, pose=pose)
    with mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.36, 0.126, 0.21), CELL), colliders=[shell], precision="f32",
                    bodies=[mpm.Body(sand(), x, volume=(CELL / 2) ** 3)]) as solver:
        solver.advance(0.15)
        now = pose
        for time in np.linspace(0, duration, 51)[1:]:
            then = mpm.Pose(pose.position + move(time), pose.quaternion)
            solver.set_collider_motion(0, now, then)
            solver.advance(duration / 50)
            now = then
        y = turn.inv().apply(solver.positions() - now.position)
        return int(((depth(y) < -0.6 * CELL) & (y[:, 2] < 0.0)).sum())


@pytest.mark.long
def test_an_edge_with_a_node_on_its_diagonal_is_tight() -> None:
    """Where the node is also a point of the lattice of distances, the edge had no normal, and lost grains."""
    assert count_outside("box", mpm.Pose(np.array([0.06, 0.06, 0.09]), UPRIGHT), lambda _: np.zeros(3)) == 0


@pytest.mark.slow
@pytest.mark.parametrize("angle", [0.0, 45.0, 30.0])
def test_boxes_are_tight_in_all_places(angle: float) -> None:
    quaternion = np.roll(Rotation.from_euler("z", angle, degrees=True).as_quat(), 1)
    rng = np.random.default_rng(0)
    for shift in (*PLACES, *rng.uniform(0, 1, (10, 3))):
        pose = mpm.Pose(np.array([0.06, 0.06, 0.09]) + CELL * shift, quaternion)
        assert count_outside("box", pose, lambda _: np.zeros(3)) == 0, shift


@pytest.mark.slow
@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("speed", [0.1, 0.5, 1.0, "shaken"])
def test_moving_shells_are_tight(name: str, speed: float | str) -> None:
    """Driven off within 50 ms, or shaken up and down by 15 mm at 5 Hz."""
    def move(time: float) -> np.ndarray:
        if isinstance(speed, str):
            return np.array([0.0, 0.0, 0.0075 * np.sin(2 * np.pi * 5.0 * time)])
        return np.array([speed * (time - 0.025 if time > 0.05 else time**2 / 0.1), 0.0, 0.0])

    assert count_outside(name, mpm.Pose(np.array([0.06, 0.06, 0.09]), UPRIGHT), move) == 0
