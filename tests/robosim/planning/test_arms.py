"""All rehearsals can be planned, with any arm and its hand or without; what cannot be is refused by name."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bundled import plan_of, read_bundled, rehearsal

from robosim.base.errors import ConfigError, UnreachableWaypoint
from robosim.base.resources import folder, part_names
from robosim.config.materials import load_material
from robosim.config.rehearsal import RehearsalConfig
from robosim.config.table import Placement
from robosim.planning.clearance import LEAST, RobotClearance
from robosim.planning.plan import plan_motion
from robosim.planning.waypoint_path import WaypointPath
from robosim.robot.model import Arm
from robosim.scene.build import assemble_rehearsal, compile_rehearsal
from robosim.scene.field import check_field

WEAK = {"model": str(folder("models") / "robots" / "iiwa14" / "iiwa14.xml"), "flange": "flange",
        "limits": {"velocity": [1.5] * 7, "torque": [300.0] * 6 + [0.02]}}


def change(waypoint: str = "", given: dict[str, Any] | None = None, **keys: Any) -> RehearsalConfig:
    """Return the spoon's rehearsal with other keys of one waypoint, and of the file."""
    waypoints = read_bundled("rehearsals", "spoon")["waypoints"]
    changed = [one | (given or {} if one["name"] == waypoint else {}) for one in waypoints]
    return rehearsal("spoon", **({"waypoints": changed} if given else {}), **keys)


@pytest.mark.parametrize("name", ["spoon", "scoop", "bottle", "pick_bottle", "shovel", "dose_spoon", "dose_bottle"])
def test_every_script_can_be_planned(name: str) -> None:
    """Within the arm's limits and joint ranges; the field accepts every bundled granular material."""
    assert plan_of(name).solution.margin > 0.01
    for material in ("salt", "sugar", "flour", "sand", "paper"):
        check_field(rehearsal(name), load_material(material).make_law())


@pytest.mark.parametrize("name, changes, message", [
    ("bottle", {"pile": {"centre": [0.7, 0, 0.01], "half": [0.01] * 3}}, "2 kinds of places hold material"),
    ("shovel", {"pile": None}, "0 kinds of places hold material"),
    ("shovel", {"area": None}, "0 kinds of places take material"),
    ("spoon", {"containers": {"bucket": {"position": [0.7, 0, 0]}}}, "model 'bucket'; valid: source, target, tray"),
    ("bottle", {"trajectory": "recorded", "recorded": []}, "needs `recorded`"),
    ("bottle", {"weigh_at": "lifted"}, "needs a dwell"),
    ("pick_bottle", {"grasp": "weld"}, "pick with grasp: weld, trajectory: script; accepted: friction, script"),
    ("pick_bottle", {"gripper": "none"}, "pick with gripper: none; accepted: a gripper"),
])
def test_invalid_rehearsals_are_refused(name: str, changes: dict, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        rehearsal(name, **changes)


TURNS = {"gen3": 20.0, "panda": -40.0, "ur5e": 0.0}
"""Turns in the hand that the planner would find after trying others."""


@pytest.mark.long
@pytest.mark.parametrize("robot", part_names("robots"))
def test_one_word_of_the_file_changes_the_arm(robot: str) -> None:
    """The tool passes the same poses; the hand is the arm's own."""
    plan = plan_motion(change(robot=robot, grip_turn_deg=TURNS.get(robot)))
    assert plan.arm.assembly.robot.name == robot and plan.arm.assembly.hand is not None
    assert plan.clearance.surroundings.distance > LEAST and plan.clearance.itself.distance > 0.01
    for name, time in plan.path.times.items():
        reached = plan.arm.tool_pose(plan.motion.state(time).q)
        assert np.linalg.norm(reached.position - plan.path.pose(time).position) < 1e-3, name
    limits = plan.arm.limits(plan.config.limits)
    for time in np.arange(0.0, plan.motion.duration, 0.01):
        state = plan.motion.state(time)
        assert (np.abs(state.qd) <= limits.velocity + 1e-9).all()
        assert (np.abs(state.qdd) <= limits.acceleration + 1e-9).all()
        assert (state.q >= plan.arm.lower).all() and (state.q <= plan.arm.upper).all()


@pytest.mark.parametrize("robot", ["iiwa14", "xarm7"])
def test_a_tool_is_bolted_to_the_flange(robot: str) -> None:
    plan = plan_motion(change(robot=robot, gripper="none"))
    assert plan.arm.assembly.gripper_name == "none" and plan.arm.model.nv == len(plan.arm.joints)


@pytest.mark.long
def test_an_arm_hangs_from_above() -> None:
    base = {"position": [0.3, -0.1, 1.2], "rotation_deg": [180, 0, 0]}
    plan = plan_motion(change(base=base, grip_turn_deg=0.0))
    assert plan.clearance.surroundings.distance > 0.01 and plan.solution.margin > 0.1


@pytest.mark.long
@pytest.mark.parametrize(("keys", "message"), [
    ({"grasp": "friction"}, "grasp: friction with gripper: none; accepted: grasp: weld, or a gripper"),
    ({"robot": WEAK}, r"joint A7 would need a torque of [\d.]+ N m; accepted: up to 0.02 N m; a lighter tool")])
def test_a_robot_that_cannot_hold_the_tool_is_refused(keys: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        plan_motion(change(gripper="none", **keys))


@pytest.mark.parametrize(("waypoint", "keys", "parts"), [
    ("over", {"position": [-0.02, 0, -0.03]}, "spoon and (table|a container)"),
    ("back", {"frame": "world", "position": [0.72, 0.0, 0.01], "rotation_deg": [0, 20, 90]}, "spoon and table"),
    ("across", {"frame": "source", "position": [0.14, 0, 0.03]}, "spoon and a container"),
    ("home", {"frame": "world", "position": [0.72, 0.02, -0.01], "rotation_deg": [0, 0, 90]}, "hand_f1_2 and source"),
])
def test_a_waypoint_that_collides_is_refused_with_the_pair_and_the_depth(waypoint: str, keys: dict, parts: str) -> None:
    with pytest.raises(ConfigError, match=rf"near waypoint '\w+' \(t = [\d.]+ s\) {parts} overlap by [\d.]+ mm; "
                                          rf"accepted: 0.5 mm or more"):
        plan_motion(change(waypoint, keys, grip_turn_deg=0.0))


def test_clearances_are_those_of_the_places() -> None:
    """Raising the arm by a height raises its smallest distance from the table by that much; in itself nothing changes.

    A posture folded into itself is found, with the bodies that overlap."""
    config = rehearsal("shovel", grip_turn_deg=0.0)
    plan = plan_motion(config)
    q, rise = plan.solution.q[0], 0.01
    raised = config.model_copy(update={"base": Placement(position=(0.0, 0.0, rise))})
    first, second = (RobotClearance(compile_rehearsal(c), plan.arm) for c in (config, raised))
    # the last one with an arm that stands where the configuration says
    low, high = first.measure(q), RobotClearance(compile_rehearsal(raised), Arm(assemble_rehearsal(raised))).measure(q)
    assert high[0].distance - low[0].distance == pytest.approx(rise, abs=1e-6) and "table" in low[0].parts
    assert high[1].distance == pytest.approx(low[1].distance, abs=1e-9)
    folded = np.array([0.0, 2.0, 0.0, -2.09, 0.0, 2.09, 0.0])
    assert first.measure(folded)[1].distance < first.measure(plan.arm.home)[1].distance
    assert second.measure(q)[1].distance == pytest.approx(low[1].distance, abs=1e-9)


@pytest.mark.slow
def test_a_long_path_is_no_jump() -> None:
    """A carry of two minutes, in which joints move slowly between two coarse samples."""
    config = change("across", {"speed": 0.0035}, grip_turn_deg=0.0)
    plan = plan_motion(config)
    assert plan.path.duration > 120.0 and plan.solution.errors.max() < 1e-6


def test_a_slower_script_passes_the_same_places() -> None:
    config = rehearsal("spoon")
    path, slow = WaypointPath(config), WaypointPath(config)
    slow.slow_down(np.array([0.0, 1.0]), np.array([1.0, 2.0]))
    moving = path.duration - sum(end - begin for begin, end in path.rests.values())
    resting = slow.duration - sum(end - begin for begin, end in slow.rests.values())
    assert resting == pytest.approx(2.0 * moving, rel=1e-6)
    between = np.linspace(0.0, path.times["above"], 20)
    for time in between:
        np.testing.assert_allclose(slow.pose(2.0 * time).position, path.pose(time).position, atol=1e-9)


@pytest.mark.long
@pytest.mark.parametrize("trajectory, torque", [("script", 9.0), ("recorded", 20.0)])
def test_a_motion_is_slower_for_weak_motors(trajectory: str, torque: float) -> None:
    """A turntable's motor turns the arm as slowly as its torque demands; a script no slower than its file allows."""
    robot = WEAK | {"limits": {"velocity": [1.5] * 7, "torque": [torque] + [300.0] * 6}}
    strong, weak = (rehearsal("shovel", trajectory=trajectory, gripper="none", grip_turn_deg=0.0, robot=one,
                              max_time_scale=4.0) for one in (robot | {"limits": {"velocity": [1.5] * 7}}, robot))
    plans = [plan_motion(one) for one in (strong, weak)]
    used = [max(abs(one.arm.inverse_dynamics(*one.motion.state(time))[0]) for time in
                np.arange(0.0, one.motion.duration, 0.01)) for one in plans]
    assert used[0] > 1.1 * torque > torque >= used[1]
    assert plans[0].path.duration < plans[1].path.duration < 4.0 * plans[0].path.duration
    if trajectory == "script":
        with pytest.raises(ConfigError, match=r"joint A1 .* or allow the whole motion .*= 1, needed: 1\.\d+"):
            plan_motion(weak.model_copy(update={"max_time_scale": 1.0}))


def test_obstacles_are_kept_clear_of() -> None:
    """A pillar in the way of the carry is refused by its name; beside the way it is the closest thing."""
    pillar = {"name": "pillar", "position": [0.72, 0.0, 0.15], "half": [0.02, 0.02, 0.15], "round": True}
    with pytest.raises(ConfigError, match=r"near waypoint '\w+' \(t = [\d.]+ s\) .*pillar overlap by [\d.]+ mm"):
        plan_motion(change(obstacles=[pillar], grip_turn_deg=0.0))
    beside = pillar | {"position": [0.2, 0.45, 0.15]}
    plan = plan_motion(change(obstacles=[beside], grip_turn_deg=0.0))
    assert plan.clearance.surroundings.distance > LEAST


@pytest.mark.long
def test_a_work_cell_of_ones_own_is_planned_around(tmp_path: Path) -> None:
    """A lower shelf over the table, at which the elbow would strike, in place of the bundled table."""
    shelf = '<body name="shelf"><geom type="box" size="0.4 0.5 0.01" pos="0.7 0 0.45"/></body>'
    for name, bodies in (("shelf", shelf), ("bench", "")):
        (tmp_path / f"{name}.xml").write_text(
            '<mujoco><worldbody><body name="bench"><geom type="box" size="1 1 0.01" pos="0.4 0 -0.011"/></body>'
            f'{bodies}</worldbody></mujoco>')
    with pytest.raises((ConfigError, UnreachableWaypoint), match="shelf overlap by"):
        plan_motion(change(workcell=str(tmp_path / "shelf.xml"), grip_turn_deg=0.0))
    plan = plan_motion(change(workcell=str(tmp_path / "bench.xml"), grip_turn_deg=0.0))
    assert "bench" in plan.clearance.surroundings.parts
    with pytest.raises(ConfigError, match=r"missing.xml: no such file"):
        plan_motion(change(workcell="missing.xml"))
