"""Shapes of tools and containers: closed solids, the volumes that their dimensions give, one frame for all uses."""

import mujoco
import numpy as np
import pytest

from robosim.scene import load_spec
from robosim.shapes import TOOLS, tool_shape
from robosim.shapes.bottle import BODY, NECK, NECK_RADIUS, RADIUS
from robosim.shapes.container import container_shell
from robosim.shapes.spoon import BOWL

DENSITIES = {"handle": 1200.0, "bottle": 950.0}
"""[kg/m^3]; everything else is steel."""


@pytest.mark.parametrize("tool", TOOLS)
@pytest.mark.parametrize("wall", [0.0015, 0.004, 0.008])
def test_solids_are_closed(tool: str, wall: float) -> None:
    for mesh in tool_shape(tool).solid(wall):
        assert mesh.is_watertight and mesh.is_winding_consistent and mesh.volume > 0 and mesh.body_count == 1


def test_cavities_are_what_their_dimensions_give() -> None:
    for wall in (0.001, 0.004, 0.012):
        bowl = tool_shape("spoon").head(wall)
        assert bowl.convex_hull.volume - bowl.volume == pytest.approx(2 / 3 * np.pi * np.prod(BOWL), rel=0.01)
    bottle = tool_shape("bottle").head()
    inside = np.pi * (RADIUS**2 * BODY + NECK_RADIUS**2 * NECK)
    profile = tool_shape("bottle").profile(0.0)
    rings = np.pi / 3 * np.diff(profile[:, 1]) * (profile[:-1, 0] ** 2 + profile[:-1, 0] * profile[1:, 0]
                                                  + profile[1:, 0] ** 2)
    assert rings.sum() > inside  # the shoulder comes on top
    solid = bottle.volume + rings.sum()
    outer = tool_shape("bottle").profile(tool_shape("bottle").WALL)
    hull = np.pi / 3 * np.diff(outer[:, 1]) * (outer[:-1, 0] ** 2 + outer[:-1, 0] * outer[1:, 0] + outer[1:, 0] ** 2)
    assert solid == pytest.approx(hull.sum(), rel=0.01)
    box = container_shell((0.2, 0.15, 0.08))
    assert box.is_watertight and box.body_count == 1


@pytest.mark.parametrize("tool", TOOLS)
def test_model_weighs_what_its_meshes_weigh(tool: str) -> None:
    """Mass, centre and inertia in the MJCF are those of the meshes with the densities that it names."""
    model = load_spec("tools", tool, f"{tool}.xml").compile()
    parts = []
    for name, mesh in tool_shape(tool).visuals().items():
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
def test_meshes_on_disk_are_the_shapes(tool: str) -> None:
    model = load_spec("tools", tool, f"{tool}.xml").compile()
    heads = [mesh for name, mesh in tool_shape(tool).visuals().items() if name != "handle"]
    volume = sum(mesh.volume for mesh in tool_shape(tool).visuals().values())
    assert len(heads) == 1
    stored = sum(_volume(model, k) for k in range(model.nmesh))
    assert stored == pytest.approx(volume, rel=1e-4)


def _volume(model: mujoco.MjModel, k: int) -> float:
    """Volume [m^3] of a compiled mesh, by the divergence theorem."""
    begin, faces = model.mesh_vertadr[k], model.mesh_face[model.mesh_faceadr[k] :][: model.mesh_facenum[k]]
    a, b, c = (model.mesh_vert[begin + faces[:, i]].astype(float) for i in range(3))
    return float(np.sum(np.cross(a, b) * c) / 6)
