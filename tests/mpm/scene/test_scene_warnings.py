"""Scenes that are accepted but cannot work well are reported, with the value and the remedy; others are not."""

from collections.abc import Callable

import numpy as np
import pytest
import trimesh
from field_parts import at, sand

import mpm
from mpm.scene.scene import Scene
from mpm.scene.warnings import warn_of_scene

CELL = 0.01
GRID = mpm.Grid((0, 0, 0), (0.2, 0.2, 0.2), CELL)
SAND = sand()
SHELF = mpm.Sdf.box((0.05, 0.05, 0.005))


def block(spacing: float = 0.005, volume: float | np.ndarray | None = None, edge: float = 0.05,
          rng: np.random.Generator | None = None) -> mpm.Body:
    positions = mpm.sample_box((0.05,) * 3, (0.05 + edge,) * 3, spacing, rng)
    return mpm.Body(SAND, positions, volume=spacing**3 if volume is None else volume)


def high(z: float) -> mpm.Pose:
    return at(0.1, 0.1, z)


def ball(pose: mpm.Pose, static: bool = False) -> mpm.Collider:
    return mpm.Collider(mpm.Sdf.sphere(0.02), pose=pose, static=static)


def check(body: mpm.Body, *colliders: mpm.Collider) -> None:
    """Check a scene as the constructor of a solver does, without its fields and kernels."""
    warn_of_scene(Scene(GRID, [body], list(colliders)))


SUSPICIOUS: dict[str, tuple[Callable[[], object], type[Warning], str]] = {
    "coarse": (lambda: check(block(0.0125)), mpm.CoarseGrains, "grains of 12.5 mm, and the grid cells of 10 mm"),
    "volume of a cell": (lambda: check(block(volume=CELL**3)), mpm.VolumeMismatch,
                         "fit a spacing of 10 mm, but they are 5 mm apart; give about volume = 1.2e-07"),
    "volume of a cell, jittered": (lambda: check(block(volume=CELL**3, rng=np.random.default_rng(0))),
                                   mpm.VolumeMismatch, "fit a spacing of 10 mm"),
    "the whole volume": (lambda: check(block(volume=0.05**3)), mpm.CoarseGrains, "grains of 50 mm"),
    "too small": (lambda: check(block(volume=1e-9)), mpm.VolumeMismatch, "spacing of 1 mm, but they are 5 mm apart"),
    "in a ball": (lambda: check(block(), ball(high(0.1))), mpm.GrainsInSolid,
                  r"of 1000 grains of body 0 lie inside collider 0, up to 1\d mm deep: they are pushed out"),
    "in a post": (lambda: check(block(), ball(high(0.1), static=True)),
                  mpm.GrainsInSolid, "they stay there for good"),
    "in a mesh": (lambda: check(block(), mpm.Collider(mpm.Sdf.from_mesh(trimesh.creation.icosphere(2, 0.02)),
                                                      pose=high(0.1))), mpm.GrainsInSolid, "inside collider 0"),
    "a thin shelf": (lambda: check(block(), mpm.Collider(SHELF, pose=high(0.03), static=True)), mpm.ThinSolid,
                     "collider 0 is static and 10 mm thin, 1.0 cells: .* give static = False, or make it an mpm.Shell"),
    "a thin wall of a mesh": (
        lambda: check(block(), mpm.Collider(mpm.Sdf.from_mesh(trimesh.creation.annulus(0.085, 0.09, 0.1), spacing=2e-3),
                                            pose=high(0.1), static=True)),
        mpm.ThinSolid, r"static and (5|4\.\d) mm thin"),
    "a thin part of a union": (
        lambda: check(block(), mpm.Collider(mpm.Sdf.union([(mpm.Sdf.sphere(0.02), high(-0.05)), (SHELF, high(-0.08))]),
                                            static=True)), mpm.ThinSolid, "10 mm thin"),
}


@pytest.mark.parametrize(("make", "kind", "words"), SUSPICIOUS.values(), ids=SUSPICIOUS)
def test_it_is_reported(make: Callable[[], object], kind: type[Warning], words: str) -> None:
    with pytest.raises(kind, match=words):  # pytest turns the first warning into an error
        make()


FINE: dict[str, Callable[[], object]] = {
    "a lattice": lambda: check(block()),
    "jittered": lambda: check(block(rng=np.random.default_rng(1))),
    "one layer": lambda: check(mpm.Body(SAND, mpm.sample_box((0, 0, 0), (0.1, 0.005, 0.1), 0.005), volume=0.005**3)),
    "a row": lambda: check(mpm.Body(SAND, mpm.sample_box((0, 0, 0), (0.1, 0.005, 0.005), 0.005), volume=0.005**3)),
    "at random": lambda: check(mpm.Body(SAND, np.random.default_rng(2).uniform(0.05, 0.1, (1000, 3)),
                                        volume=0.05**3 / 1000)),
    "two sizes": lambda: check(mpm.Body(
        SAND, np.concatenate([mpm.sample_box((0.0,) * 3, (0.05,) * 3, 0.005),
                              mpm.sample_box((0.1,) * 3, (0.12,) * 3, 0.0025)]),
        volume=np.repeat([0.005**3, 0.0025**3], [1000, 512]))),
    "one grain": lambda: check(mpm.Body(SAND, np.array([[0.1, 0.1, 0.1]]), volume=1e-9)),
    "far apart": lambda: check(mpm.Body(
        SAND, np.concatenate([mpm.sample_box((x,) * 3, (x + 0.05,) * 3, 0.005) for x in (0.0, 0.1)]), volume=0.005**3)),
    "touching a ball": lambda: check(block(), ball(high(0.12))),
    "a thick shelf": lambda: check(block(), mpm.Collider(mpm.Sdf.box((0.05, 0.05, 0.01)), pose=high(0.03),
                                                         static=True)),
    "a thin shelf that may move": lambda: check(block(), mpm.Collider(SHELF, pose=high(0.03))),
    "a plane": lambda: check(block(), mpm.Collider(mpm.Sdf.plane(), pose=high(0.05), static=True)),
}


@pytest.mark.parametrize("make", FINE.values(), ids=FINE)
def test_it_is_not_reported(make: Callable[[], object]) -> None:
    make()


def test_the_solver_and_its_new_colliders_are_checked() -> None:
    """The warning points at the caller's line."""
    thin = mpm.Collider(SHELF, pose=high(0.03), static=True)
    with pytest.warns(mpm.ThinSolid) as caught:
        solver = mpm.Solver(grid=GRID, bodies=[block()], colliders=[thin])
    assert caught[0].filename == __file__
    with pytest.warns(mpm.GrainsInSolid) as caught:
        solver.set_colliders([mpm.Collider(mpm.Sdf.sphere(0.03), pose=high(0.1))])
    assert caught[0].filename == __file__
