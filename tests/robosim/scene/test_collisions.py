"""Collision monitoring: who touches whom is counted, and how deep a container is in the tool."""

import mujoco
import numpy as np
import pytest

import mpm
from robosim.config.rehearsal import load_rehearsal
from robosim.scene import container_clearance
from robosim.scene.build import compile_rehearsal
from robosim.scene.collisions import ContactCounter
from robosim.scene.compiled import Scene
from robosim.scene.models import assemble


def test_container_points_in_the_tool_are_counted_with_their_depth(monkeypatch: pytest.MonkeyPatch) -> None:
    """A ball in the spoon's place 1 mm in the source's floor is counted, one above it is not.

    A rehearsal without `tool_container` monitors neither contacts nor points."""
    monkeypatch.setattr(container_clearance, "build_real_tool_sdf", lambda tool: mpm.Sdf.sphere(0.03))
    config = load_rehearsal("spoon")
    scene = compile_rehearsal(config)
    data = mujoco.MjData(scene.model)
    mujoco.mj_forward(scene.model, data)
    surface = container_clearance.ContainerSurface(config)
    floor = config.containers["source"].pose
    for height, is_counted in ((0.0301, False), (0.029, True)):
        pose = mpm.Pose(floor.position + [0.0, 0.0, height], np.array([1.0, 0.0, 0.0, 0.0]))
        surface.record_penetrations(pose)
        assert (surface.penetrations > 0) == is_counted
    assert surface.depth == pytest.approx(0.001, abs=1e-4)
    unmonitored = config.model_copy(update={"tool_container": []})
    other = compile_rehearsal(unmonitored)
    assert other.model.nexclude == scene.model.nexclude + 2
    assert container_clearance.monitor_containers(unmonitored) is None


ROBOT = """
<mujoco>
  <worldbody>
    <geom type="plane" size="5 5 1" pos="0 0 -1"/>
    <body name="table"><geom type="box" size="1 1 0.01"/></body>
    <body name="bowl" pos="0.5 0 0.03"><geom type="box" size="0.05 0.05 0.02"/></body>
    <body name="base"><geom type="sphere" size="0.02"/>
      <body name="upper" pos="-0.3 0 0.5"><joint/><geom type="sphere" size="0.03"/>
        <body name="lower"><joint/><geom type="sphere" size="0.01" pos="{ahead} {side} {lower}"/>
          <body name="palm" pos="0.3 0 0"><joint/>
            <body name="finger"><joint/><geom type="sphere" size="0.01" pos="{finger} {reach} 0"/></body>
            <body name="spoon"><geom type="sphere" size="0.01" pos="{x} 0 {spoon}"/></body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
"""The base stands on the table; the palm's frame is 0.5 m above it. Neighbours in the chain make no contacts."""
FREE = {"ahead": 0.5, "side": 0.0, "lower": -0.2, "finger": 0.3, "reach": 0.5, "x": 0.3, "spoon": -0.2}


@pytest.mark.parametrize(("places", "container", "surroundings", "itself"), [
    ({}, 0, 0, 0), ({"lower": -0.481}, 0, 1, 0), ({"spoon": -0.481}, 0, 1, 0), ({"x": 0.5, "spoon": -0.441}, 1, 0, 0),
    ({"lower": -0.481, "x": 0.5, "spoon": -0.441}, 1, 1, 0), ({"x": -0.3, "spoon": 0.0}, 0, 0, 1),
    ({"side": 0.5, "lower": 0.0, "finger": 0.185}, 0, 0, 1), ({"x": 0.3, "spoon": -1.491}, 0, 1, 0),
    ({"finger": 0.35, "reach": 0.0, "x": 0.35, "spoon": 0.005}, 0, 0, 0), ({"ahead": 0.3, "lower": -0.485}, 0, 1, 1),
])
def test_contacts_are_counted_by_the_bodies_that_touch(places: dict[str, float], container: int, surroundings: int,
                                                       itself: int) -> None:
    """The base stands on the table, which is not counted; of other links, and of the tool, table and floor are.

    Contacts of tool and container, and of the robot with itself, are counts of their own; the hand may touch the tool.
    """
    model = mujoco.MjModel.from_xml_string(ROBOT.format(**(FREE | places)))
    data, none = mujoco.MjData(model), np.zeros(0, int)
    base, palm, spoon = (model.body(name).id for name in ("base", "palm", "spoon"))
    contacts = ContactCounter(Scene(model, assemble("spoon"), none, none, none, base, palm, spoon), data, {"bowl"})
    mujoco.mj_forward(model, data)
    for steps in (1, 2):
        contacts.count()
        assert contacts.tool_container_contacts == steps * container
        assert contacts.robot_surroundings_contacts == steps * surroundings
        assert contacts.robot_self_contacts == steps * itself
    contacts.restart()
    assert contacts.tool_container_contacts == contacts.robot_surroundings_contacts == 0
    assert contacts.robot_self_contacts == 0
