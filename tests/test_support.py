"""The README's table of supported combinations: each cell is what the code does."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh

import mpm
from mpm.scene import features
from mpm.scene.scene import Numerics, Scene

README = (Path(__file__).resolve().parents[1] / "README.md").read_text()
PLACE = mpm.Pose(np.array([0.1, 0.1, 0.15]), np.array([1.0, 0.0, 0.0, 0.0]))
BALL = mpm.Sdf.sphere(0.02)
SPHERE_MESH = trimesh.creation.icosphere(2, 0.02)
SPHERE, CORNER = mpm.Shell.from_mesh(SPHERE_MESH, 1e-3), SPHERE_MESH.vertices[0]
HOLE = mpm.Orifice(CORNER[None], CORNER / np.linalg.norm(CORNER), diameter=3e-3, grain_diameter=3e-4)
SIDES = ("periodic", "friction", "friction")
SCENES = {
    "granular, clay, elastic, fluid materials": {},
    "walls, static colliders": {"colliders": [mpm.Collider(BALL, pose=PLACE, static=True)]},
    "colliders with a prescribed motion": {"colliders": [mpm.Collider(BALL, pose=PLACE)]},
    "thin shells": {"colliders": [mpm.Collider(SPHERE, pose=PLACE)]},
    "small holes in thin shells": {"colliders": [mpm.Collider(SPHERE, pose=PLACE, orifices=[HOLE])]},
    "colliders that grains move (coupling with MuJoCo)": {"colliders": [mpm.Collider(BALL, pose=PLACE, mobile=True)]},
    "periodic sides": {"walls": mpm.Walls(lower=SIDES, upper=SIDES)},
    "acceleration per particle": {"body_acceleration": np.zeros((27, 3))},
    "sleeping particles": {"sleep": True},
}
"""Row of the table -> what its scene has besides a block."""


def cells() -> dict[str, dict[str, str]]:
    """The table: row -> column -> cell."""
    rows = [[cell.strip() for cell in line.strip("|").split("|")]
            for line in re.findall(r"^\|.*\|$", README.split("## Supported combinations")[1].split("##")[0], re.M)]
    return {row[0]: dict(zip(rows[0][1:], row[1:], strict=True)) for row in rows[2:]}


def make(row: str) -> mpm.Solver:
    block = mpm.sample_box((0.05, 0.05, 0.0), (0.08, 0.08, 0.03), 0.01)
    body = mpm.Body(mpm.Elastic(E=1e5, nu=0.2, density=1000.0), block, volume=1e-6)
    return mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.2, 0.2, 0.2), 0.02), bodies=[body], **SCENES[row])


def accepts(call: Callable[[], object]) -> bool:
    """Whether a call is accepted; a refusal is an InvalidValue."""
    try:
        call()
    except mpm.InvalidValue:
        return False
    return True


def test_every_row_is_checked() -> None:
    assert list(cells()) == list(SCENES)


@pytest.mark.slow
@pytest.mark.parametrize("row", SCENES)
def test_a_cell_is_what_the_code_does(row: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """On a GPU what is refused raises before anything is allocated."""
    solver, column = make(row), cells()[row]
    assert accepts(lambda: mpm.Rollout(solver, 2)) == (column["gradients"] in ("yes", "one"))
    assert accepts(lambda: mpm.Batch(solver, 2)) == (column["batch"] == "yes")
    scene = Scene(solver.grid, solver.bodies, SCENES[row].get("colliders", []), SCENES[row].get("walls", mpm.Walls()))
    numerics = Numerics(precision="f32", integrator="auto", sleep=SCENES[row].get("sleep", False))

    def derive() -> features.Features:
        return features.features_of(scene, numerics, body_acceleration="body_acceleration" in SCENES[row])

    monkeypatch.setattr(features, "is_concurrent", lambda: True)
    assert not derive().serial
    monkeypatch.setattr(features, "is_shared", lambda: True)
    assert accepts(derive) == (column["CUDA, Vulkan"] != "refused")
