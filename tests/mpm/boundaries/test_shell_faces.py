"""Nodes that a shell's face holds: fewer of them displace less of a fluid."""

import numpy as np
import pytest
import trimesh
from field_parts import at

import mpm
from mpm.backend import ti
from mpm.geometry.shell import SHELL_FACE

CELL, SIDE = 0.01, 0.12


def impulse_of_flow(face_cells: float) -> np.ndarray:
    """Let water flow past a closed shell for a substep; return its impulse [N s] (3,) on the shell."""
    positions = mpm.sample_box((0, 0, 0), (SIDE,) * 3, CELL / 2)
    positions = positions[np.linalg.norm(positions - SIDE / 2, axis=1) > 0.03]
    ball = mpm.Shell.from_mesh(trimesh.creation.icosphere(3, 0.0295), 1e-3, face_cells=face_cells)
    water = mpm.NewtonianFluid(bulk_modulus=1e4, density=1000.0)
    with mpm.Solver(grid=mpm.Grid((0, 0, 0), (SIDE, SIDE, SIDE), CELL), gravity=(0, 0, 0), precision="f64",
                    bodies=[mpm.Body(water, positions, volume=(CELL / 2) ** 3)],
                    colliders=[mpm.Collider(ball, friction=0.0, pose=at(*[SIDE / 2] * 3))]) as solver:
        state = solver.state()
        state["v"][:, 0] = 0.01
        solver.load(state)
        before = solver.momentum().linear
        solver.advance(0.5 * solver.dt)
        change = solver.momentum().linear - before
        assert np.allclose(change, solver.ledger[:3, :3].sum(0), rtol=0, atol=1e-9 * np.linalg.norm(before))
        return solver.collider_impulse(0).force


@pytest.mark.long
def test_a_face_holds_the_nodes_in_front_of_it() -> None:
    """A face of half a cell stops less water than one of a whole cell; what the shell receives, the water has lost."""
    whole, half = impulse_of_flow(SHELL_FACE), impulse_of_flow(0.51)
    assert 0 < half[0] < 0.9 * whole[0]
    assert np.abs(half[1:]).max() < 0.05 * half[0]  # the mesh is not quite symmetric


def test_an_inner_edge_has_a_normal_on_its_diagonal() -> None:
    """Also at points of the lattice, where the distance does not grow towards the middle along x or y alone."""
    tube = trimesh.creation.box((0.06, 0.06, 0.06))
    tube = trimesh.Trimesh(tube.vertices, tube.faces[np.abs(tube.triangles_center[:, 2]) < 0.029])
    shell = mpm.Shell.from_mesh(tube, 1e-3).bake(CELL)

    @ti.kernel
    def normal_at(x: float, y: float) -> ti.types.vector(3, ti.f32):
        return shell.at(ti.Vector([x, y, 0.0]))[0]

    lattice = shell.lower[0] + shell.spacing * np.arange(shell.shape[0])
    inside = lattice[(np.abs(lattice) > 0.005) & (np.abs(lattice) < 0.028)]
    for place in (*inside, *inside[:-1] + 1e-5, *inside[1:] - 1e-5):
        for sign in (1.0, -1.0):
            expected = np.array([np.sign(place), sign * np.sign(place), 0.0]) / np.sqrt(2.0)
            assert abs(np.array(normal_at(place, sign * place)) @ expected) > 0.7, place  # that of a wall, or the mean


@pytest.mark.parametrize("face_cells", [0.3, 1.5, float("nan")])
def test_faces_out_of_range(face_cells: float) -> None:
    """Below half a cell a fluid is not held; beyond the usual face, what wakes grains would not see it."""
    with pytest.raises(mpm.InvalidValue, match=r"face_cells = .*; accepted: 0\.5 to 1\.01"):
        mpm.Shell.from_mesh(trimesh.creation.icosphere(1, 0.03), 1e-3, face_cells=face_cells)
