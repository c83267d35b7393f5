"""Shapes of tools and containers: closed solids, volumes by their dimensions, masses and files of the models."""

import mujoco
import numpy as np
import pytest

from robosim.scene.models import load_spec
from robosim.shapes import TOOLS
from robosim.shapes.lofts import loft, revolve, sweep
from robosim.shapes.sheet_tools import BACK, TROUGH_DEPTH, TROUGH_LENGTH, TROUGH_WIDTH
from robosim.shapes.tool import WALL
from robosim.shapes.vessels import (
    BODY,
    BOWL,
    NECK,
    NECK_RADIUS,
    RADIUS,
    make_bottle,
    make_container_shell,
    make_profile,
)

DENSITIES = {"handle": 1200.0, "bottle": 950.0, "shaker": 950.0}
"""[kg/m^3]; everything else is steel."""


def test_builders_give_closed_meshes_of_the_right_volume() -> None:
    angle = np.linspace(-np.pi / 2, np.pi / 2, 41)
    ball = revolve(np.stack([np.cos(angle), np.sin(angle)], axis=1), 80)
    tube = sweep(np.linspace([0.0, 0.0, 0.0], [1.0, 0.0, 1.0], 9), np.full(9, 0.1), segments=80)
    box = loft([[[0, 0, z], [1, 0, z], [1, 1, z], [0, 1, z]] for z in (0.0, 2.0)])
    for mesh, volume in ((ball, 4 / 3 * np.pi), (tube, np.pi * 0.01 * np.sqrt(2.0)), (box, 2.0)):
        assert mesh.is_watertight and mesh.is_winding_consistent
        assert mesh.volume == pytest.approx(volume, rel=0.01)


@pytest.mark.parametrize("tool", TOOLS)
@pytest.mark.parametrize("wall", [0.0015, 0.004, 0.008])
def test_solids_are_closed(tool: str, wall: float) -> None:
    for mesh in TOOLS[tool].solid(wall):
        assert mesh.is_watertight and mesh.is_winding_consistent and mesh.volume > 0 and mesh.body_count == 1


def test_cavities_have_the_volume_of_their_dimensions() -> None:
    for wall in (0.001, 0.004, 0.012):
        bowl = TOOLS["spoon"].head(wall)
        assert bowl.convex_hull.volume - bowl.volume == pytest.approx(2 / 3 * np.pi * np.prod(BOWL), rel=0.01)
    bottle = make_bottle()
    inside = np.pi * (RADIUS**2 * BODY + NECK_RADIUS**2 * NECK)
    outline = make_profile(0.0)
    rings = np.pi / 3 * np.diff(outline[:, 1]) * (outline[:-1, 0] ** 2 + outline[:-1, 0] * outline[1:, 0]
                                                  + outline[1:, 0] ** 2)
    assert rings.sum() > inside  # plus the shoulder
    solid = bottle.volume + rings.sum()
    outer = make_profile(WALL)
    hull = np.pi / 3 * np.diff(outer[:, 1]) * (outer[:-1, 0] ** 2 + outer[:-1, 0] * outer[1:, 0] + outer[1:, 0] ** 2)
    assert solid == pytest.approx(hull.sum(), rel=0.01)
    box = make_container_shell((0.2, 0.15, 0.08))
    assert box.is_watertight and box.body_count == 1


def test_capacities_are_those_up_to_the_rim() -> None:
    """Half an ellipsoid; half an elliptic cylinder whose back is half an ellipsoid; and a region without a face."""
    assert TOOLS["spoon"].capacity == pytest.approx(2 / 3 * np.pi * np.prod(BOWL), rel=0.01)
    trough = 0.25 * np.pi * TROUGH_WIDTH * TROUGH_DEPTH * (TROUGH_LENGTH - BACK / 3)
    assert TOOLS["scoop"].capacity == pytest.approx(trough, rel=0.01)
    assert TOOLS["shovel"].capacity == pytest.approx(0.06 * 0.08 * 0.05)


@pytest.mark.parametrize("tool", TOOLS)
def test_the_model_has_the_mass_of_its_meshes(tool: str) -> None:
    """Mass, centre and inertia in the MJCF are those of the meshes with the materials' densities."""
    model = load_spec("tools", tool, f"{tool}.xml").compile()
    parts = []
    for name, mesh in TOOLS[tool].visuals().items():
        mesh.density = DENSITIES.get(name, 7900.0)
        parts.append((mesh.mass, mesh.center_mass, mesh.moment_inertia))
    mass = sum(p[0] for p in parts)
    centre = sum(p[0] * p[1] for p in parts) / mass
    inertia = sum(i + m * ((c - centre) @ (c - centre) * np.eye(3) - np.outer(c - centre, c - centre))
                  for m, c, i in parts)
    body = model.body(tool)
    assert body.mass[0] == pytest.approx(mass, rel=0.005)
    assert body.ipos == pytest.approx(centre, abs=2e-4)
    axes = np.empty(9)
    mujoco.mju_quat2Mat(axes, body.iquat)
    R = axes.reshape(3, 3)
    assert R @ np.diag(body.inertia) @ R.T == pytest.approx(inertia, abs=0.01 * np.abs(inertia).max())


@pytest.mark.parametrize("tool", TOOLS)
def test_the_mesh_files_are_up_to_date(tool: str) -> None:
    model = load_spec("tools", tool, f"{tool}.xml").compile()
    heads = [mesh for name, mesh in TOOLS[tool].visuals().items() if name != "handle"]
    volume = sum(mesh.volume for mesh in TOOLS[tool].visuals().values())
    assert len(heads) == 1
    stored = sum(_volume(model, k) for k in range(model.nmesh))
    assert stored == pytest.approx(volume, rel=1e-4)


def _volume(model: mujoco.MjModel, k: int) -> float:
    """Volume [m^3] of a compiled mesh, by the divergence theorem."""
    begin, faces = model.mesh_vertadr[k], model.mesh_face[model.mesh_faceadr[k] :][: model.mesh_facenum[k]]
    a, b, c = (model.mesh_vert[begin + faces[:, i]].astype(float) for i in range(3))
    return float(np.sum(np.cross(a, b) * c) / 6)
