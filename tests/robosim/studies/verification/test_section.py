"""The picture of a case's scene shows what a plane cuts, in its place, and no more."""

import base64
import io

import numpy as np
import pytest
import trimesh
from PIL import Image

import mpm
from robosim.studies.verification.cases.section import BODIES, LONGEST, SOLID, draw_section

CELL, SIDE = 0.01, 0.16


def shares_of(colour: tuple[int, int, int], colliders: list[mpm.Collider], thick: float = SIDE) -> np.ndarray:
    """Return columns from the left and rows from the bottom (n, 2) of a colour's pixels, of a bed below colliders."""
    sand = mpm.DruckerPrager(E=1e5, nu=0.3, density=1500.0, friction_angle_deg=30.0)
    grains = mpm.sample_box((0, 0, 0), (SIDE, thick, 0.04), CELL / 2)
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (SIDE, thick, SIDE), CELL), colliders=colliders,
                        bodies=[mpm.Body(sand, grains, volume=(CELL / 2) ** 3)])
    picture = Image.open(io.BytesIO(base64.b64decode(draw_section(solver)))).convert("RGB")
    solver.close()
    pixels = np.asarray(picture).astype(int)
    assert max(pixels.shape) == LONGEST
    row, column = np.nonzero(np.abs(pixels - colour).max(-1) < 12)
    return np.stack([column, len(pixels) - row], 1)


def at(x: float, y: float, z: float) -> mpm.Pose:
    return mpm.Pose(np.array([x, y, z]), np.array([1.0, 0.0, 0.0, 0.0]))


def test_a_solid_has_its_size_and_place() -> None:
    scale = LONGEST / SIDE
    solid = shares_of(SOLID, [mpm.Collider(mpm.Sdf.sphere(0.03), pose=at(0.05, 0.08, 0.1))])
    assert len(solid) == pytest.approx(np.pi * (0.03 * scale) ** 2, rel=0.03)
    assert solid.mean(0) == pytest.approx([0.05 * scale, 0.1 * scale], abs=1.5)


def test_a_shell_is_a_line_of_its_thickness() -> None:
    ball = mpm.Shell.from_mesh(trimesh.creation.icosphere(subdivisions=4, radius=0.04), 0.004)
    line = shares_of(SOLID, [mpm.Collider(ball, pose=at(0.08, 0.08, 0.1))])
    assert len(line) == pytest.approx(2 * np.pi * 0.04 * 0.004 * (LONGEST / SIDE) ** 2, rel=0.15)


@pytest.mark.parametrize("thick", [SIDE, 2 * CELL])
def test_grains_fill_the_lower_quarter(thick: float) -> None:
    grains = shares_of(BODIES[0], [mpm.Collider(mpm.Sdf.sphere(0.005), pose=at(0.05, thick / 2, 0.1))], thick)
    assert grains[:, 1].max() == pytest.approx(0.25 * LONGEST, abs=0.02 * LONGEST)
    assert 0.4 < len(grains) / (0.25 * LONGEST**2) < 1.0


def test_what_the_plane_misses_is_not_drawn() -> None:
    """The plane goes through the first collider; the second does not reach it."""
    balls = [mpm.Collider(mpm.Sdf.sphere(0.01), pose=at(0.05, y, 0.1)) for y in (0.12, 0.06)]
    assert len(shares_of(SOLID, balls)) == pytest.approx(np.pi * (0.01 * LONGEST / SIDE) ** 2, rel=0.05)
    assert len(shares_of(SOLID, balls[:1])) == len(shares_of(SOLID, balls))
