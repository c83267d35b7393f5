"""Collision monitoring: who touches whom is counted, and how deep a container is in the tool."""

import mujoco
import numpy as np
import pytest

import mpm
from robosim.config.rehearsal import load_rehearsal
from robosim.scene import container_clearance
from robosim.scene.build import build_rehearsal_spec, compile_scene
from robosim.scene.collisions import CollisionMonitor, ContactCounter
from robosim.scene.frames import container_pose
from robosim.scene.models import compile_spec


def test_container_points_in_the_tool_are_counted_with_their_depth(monkeypatch: pytest.MonkeyPatch) -> None:
    """A ball in the spoon's place 1 mm in the source's floor is counted, one above it is not.

    A rehearsal without `tool_container` monitors neither contacts nor points.
    """
    monkeypatch.setattr(container_clearance, "build_real_tool_sdf", lambda tool: mpm.Sdf.sphere(0.03))
    config = load_rehearsal("spoon")
    scene = compile_scene(build_rehearsal_spec(config), config.tool)
    data = mujoco.MjData(scene.model)
    mujoco.mj_forward(scene.model, data)
    surface = container_clearance.ContainerSurface(config)
    floor = container_pose(config.containers["source"])
    for height, is_counted in ((0.0301, False), (0.029, True)):
        pose = mpm.Pose(floor.position + [0.0, 0.0, height], np.array([1.0, 0.0, 0.0, 0.0]))
        surface.record_penetrations(pose)
        assert (surface.penetrations > 0) == is_counted
    assert surface.depth == pytest.approx(0.001, abs=1e-4)
    unmonitored = config.model_copy(update={"tool_container": []})
    model = compile_spec(build_rehearsal_spec(unmonitored))
    assert model.nexclude == scene.model.nexclude + 2
    assert CollisionMonitor(model, mujoco.MjData(model), unmonitored).tool_container_depth == 0.0


SPHERES = """
<mujoco>
  <worldbody>
    <body name="table"><geom type="box" size="1 1 0.01"/></body>
    <body name="bowl" pos="0.5 0 0.03"><geom type="box" size="0.05 0.05 0.02"/></body>
    <body name="link0"><geom type="sphere" size="0.02"/></body>
    <body name="link6" pos="0 0 {link}"><freejoint/><geom type="sphere" size="0.01"/></body>
    <body name="spoon" pos="{x} 0 {spoon}"><freejoint/><geom type="sphere" size="0.01"/></body>
  </worldbody>
</mujoco>
"""


@pytest.mark.parametrize(("link", "x", "spoon", "container", "surroundings"), [
    (0.2, 0.3, 0.2, 0, 0), (0.019, 0.3, 0.2, 0, 1), (0.2, 0.3, 0.019, 0, 1), (0.2, 0.5, 0.059, 1, 0),
    (0.019, 0.5, 0.059, 1, 1),
])
def test_contacts_are_counted_by_the_bodies_that_touch(link: float, x: float, spoon: float, container: int,
                                                       surroundings: int) -> None:
    """The arm's base stands on the table and is not counted; other links and the tool are.

    Contact of tool and container is a count of its own.
    """
    model = mujoco.MjModel.from_xml_string(SPHERES.format(link=link, x=x, spoon=spoon))
    data = mujoco.MjData(model)
    contacts = ContactCounter(model, data, "spoon", {"bowl"})
    mujoco.mj_forward(model, data)
    for steps in (1, 2):
        contacts.count()
        assert contacts.tool_container_contacts == steps * container
        assert contacts.robot_surroundings_contacts == steps * surroundings
    contacts.restart()
    assert contacts.tool_container_contacts == contacts.robot_surroundings_contacts == 0
