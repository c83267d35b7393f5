"""Initial positions of the grains, and the checks of what can be filled."""

import numpy as np
import pytest

import mpm
from robosim.base.errors import ConfigError
from robosim.base.resources import folder
from robosim.config.materials import Law, load_material
from robosim.config.rehearsal import load_rehearsal
from robosim.config.scene import ContainerConfig
from robosim.envs import TASKS
from robosim.scene.field import build_field, build_tool_lattice, check_field
from robosim.scene.grains import container_region, fill, is_in_container, leave_out_buried
from robosim.scene.models import read_inner_size
from robosim.shapes import tool_shape
from robosim.shapes.containers import CONTAINER_CORNER, make_container_shell
from robosim.tasks.task import load_task

PLACE = mpm.Pose(np.array([0.7, 0.1, 0.25]), np.array([1.0, 0.0, 0.0, 0.0]))
"""Of the tool."""


def test_material_fills_the_configured_region():
    """In the bottle up to the fill height and not in its wall; on the table as large as the pile."""
    bottle = load_rehearsal("bottle")
    sdf = build_tool_lattice(bottle)
    positions, volume = fill(bottle, sdf, PLACE)
    local, region = positions - PLACE.position, tool_shape("bottle").interior
    assert region.holds(local).all() and (sdf.distance(local) > 0).all()
    height = local[:, 2].max() - (region.centre[2] - region.half[2])
    assert height == pytest.approx(bottle.tool_fill_height, abs=0.005)
    # a body of 3 cm radius, filled to about 5 cm above its floor
    assert volume * len(positions) == pytest.approx(np.pi * 0.03**2 * 0.052, rel=0.15)
    shovel = load_rehearsal("shovel")
    positions, volume = fill(shovel, sdf, PLACE)
    assert volume * len(positions) == pytest.approx(0.05 * 0.05 * 0.015, rel=1e-9)
    assert (np.abs(positions - shovel.pile.centre) <= np.array(shovel.pile.half) + 1e-12).all()
    with pytest.raises(ConfigError, match="tool_fill_height = 0.2 m; accepted: up to"):
        check_field(load_rehearsal("bottle", {"tool_fill_height": 0.2}), mpm.Elastic(E=1e5, nu=0.2, density=1000.0))


def salt() -> Law:
    return load_material("salt").make_law()


@pytest.mark.long
@pytest.mark.parametrize("name", ["spoon", "scoop", "bottle", "shovel", *TASKS])
def test_nothing_begins_with_grains_in_a_solid(name: str) -> None:
    """A warning, which is an error here, counts grains more than a quarter of their size inside a wall."""
    task = load_task(name) if name in TASKS else None
    config, place = (load_rehearsal(name), PLACE) if task is None else (task, task.start.pose)
    with build_field(config, salt(), place) as solver:
        assert len(solver.positions()) > 100 if task is None else len(solver.positions()) == task.grains.count


@pytest.mark.parametrize("name", sorted(path.stem for path in (folder("models") / "containers").glob("*.xml")))
def test_the_region_that_is_shown_holds_the_grains_that_count_however_the_container_is_turned(name: str) -> None:
    container, size = ContainerConfig(position=(0.7, -0.2, 0.006), yaw_deg=35.0), np.array(read_inner_size(name))
    region, pose = container_region(name, container)
    points = np.random.default_rng(0).uniform(-1.0, 1.0, (20_000, 3)) * size + [0.7, -0.2, size[2] / 2]
    counted = is_in_container(points, name, container)
    assert 1000 < counted.sum() < 19_000
    assert np.array_equal(region.holds(pose.inverse().apply(points)), counted)


@pytest.mark.long
def test_a_container_is_filled_up_to_its_rounded_edges() -> None:
    """All grains lie in the container's own mesh, and few of the places in its box are left out."""
    config = load_rehearsal("spoon")
    (source,) = config.sources
    container, size = config.containers[source], read_inner_size(source)
    wall = mpm.Sdf.from_mesh(make_container_shell(size), spacing=1e-3)
    positions, volume = fill(config, build_tool_lattice(config), mpm.Pose.identity())
    depth = wall.distance(container.pose.inverse().apply(positions))
    assert depth.min() > -0.25 * np.cbrt(volume)
    edges = 4.0 * (1.0 - np.pi / 4.0) * CONTAINER_CORNER**2 * container.fill_height
    held = size[0] * size[1] * container.fill_height - edges
    assert volume * len(positions) == pytest.approx(held, rel=1e-3)


def test_grains_in_a_wall_are_left_out() -> None:
    """Those about a quarter of their distance deep, and no other."""
    heights = np.array([-2e-3, -0.6e-3, -0.4e-3, 0.0, 1e-3])
    points = np.column_stack([np.zeros((5, 2)), 0.01 + heights])
    kept = leave_out_buried(points, mpm.Sdf.box((0.1, 0.1, 0.01)), 2e-3)
    assert np.array_equal(kept, points[2:])
