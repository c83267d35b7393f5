"""Dosing without a field: reward, success, vibration, and what is refused."""

import itertools
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bundled import read_bundled
from scipy.spatial.transform import Rotation

import mpm
from robosim.base.errors import ConfigError
from robosim.config.materials import load_material
from robosim.config.table import validate
from robosim.envs import DOSING, TASKS
from robosim.envs.carrier import Carrier
from robosim.envs.episode import EnvOptions, Episode
from robosim.envs.world import World
from robosim.randomization.randomization import Randomization
from robosim.randomization.ranges import choose_ranges
from robosim.scene.grains import grain_volume
from robosim.tasks.actions import ActionScaling
from robosim.tasks.draw import STANDARD
from robosim.tasks.handover import Load, task_with_load
from robosim.tasks.objective import build_objective
from robosim.tasks.outcome import REST, Dose, build_reward, load_mass
from robosim.tasks.task import TaskConfig, load_task

GRAIN = 1e-4
"""Mass of a material point [kg] in these tests."""


def task_with(**changes: Any) -> TaskConfig:
    """DoseSpoon with other keys; "dose__target_g" is that of a section."""
    data = read_bundled("tasks", "DoseSpoon")
    for name, value in changes.items():
        *sections, key = name.split("__")
        table = reduce(dict.__getitem__, sections, data)
        table[key] = value
        if value is None:
            del table[key]
    return validate(data, Path("task.yaml"), TaskConfig)


def counts(poured: int, spilled: int, held: int) -> mpm.Counts:
    return mpm.Counts(0.0, 0, 0, poured, poured + spilled, held, 0, 0, 1.0)


def pose_at(task: TaskConfig, tilt_deg: float) -> mpm.Pose:
    """The tool pitched by an angle from the level."""
    level = task.start.pitch_deg if task.dose.level_pitch_deg is None else task.dose.level_pitch_deg
    return task.start.model_copy(update={"pitch_deg": level + tilt_deg}).pose


@pytest.fixture
def dose() -> Dose:
    """Of 320 grains of 0.1 g, with a target of 10 g."""
    made = Dose(load_task("DoseSpoon"))
    made.restart(0.01, GRAIN)
    return made


def test_other_tasks_have_no_key_of_dosing() -> None:
    """What was learned on them, and their settled starts, are found by all their keys."""
    for table in (load_task(name).model_dump() for name in TASKS):
        assert not {"dose", "receiver"} & table.keys() and "vibration" not in table["action"]
        assert {"reward", "success", "target", "bounds"} <= table.keys()


@pytest.mark.parametrize("name", DOSING)
def test_a_dosing_task_is_read_again_and_draws_every_bundled_material(name: str) -> None:
    """Also the lightest one with the lowest fill: the preset wide is accepted."""
    task = load_task(name)
    assert TaskConfig.model_validate_json(task.model_dump_json()) == task
    assert task.with_tool(task.tool) == task and list(task.reward) == ["error", "time", "spill"]
    assert randomized(task, "wide", task.material).ranges["target_mass"] == pytest.approx(
        np.array(task.dose.target_g) * 1e-3 if task.dose else ())


def randomized(task: TaskConfig, ranges: Any = None, material: str = "salt") -> Randomization:
    """The numbers that episodes of a task draw."""
    return Randomization(task, load_material(material), choose_ranges(ranges, task))


def test_target_and_bounds_are_those_of_the_receiver() -> None:
    """The target is the inside up to the rim, and what is above the rim has not arrived."""
    task = load_task("DoseSpoon")
    points = np.array([[0.78, 0.0, 0.011], [0.78, 0.044, 0.069], [0.78, 0.0, 0.071], [0.78, 0.05, 0.03],
                       [0.9, 0.3, 0.2]])
    assert task.target.region.holds(points).tolist() == [True, True, False, False, False]
    assert task.bounds.region.holds(points).tolist() == [False, False, True, False, True]


def test_terms_add_up_to_what_the_end_is_worth(dose: Dose) -> None:
    """error: the share of the target that is right at last, whatever happened before."""
    reward = build_reward(dose.task)
    for poured, spilled in ((0, 0), (40, 2), (130, 1), (130, 5)):
        now = counts(poured, spilled, 320 - poured - spilled)
        terms = reward.step(dose.step(now, pose_at(dose.task, 30.0), 0.0, False))
    assert reward.score["error"] == pytest.approx(10.0 * (1.0 - 0.3))
    assert reward.score["spill"] == pytest.approx(-5.0 * 5 * GRAIN / 0.01)
    assert reward.score["time"] == pytest.approx(-4.0 / 10_000)
    assert reward.tcs == pytest.approx(sum(reward.score.values())) and set(terms) == set(reward.terms)
    before = reward.tcs
    reward.diverge(9996)
    assert reward.score == pytest.approx({"error": -10.0, "time": -1.0, "spill": -5.0}) and reward.tcs < before


def test_readings_have_all_mass(dose: Dose) -> None:
    for poured in (120, 110):
        dose.step(counts(poured, 3, 190), pose_at(dose.task, 30.0), 0.0, False)
    values = dose.readings(counts(110, 3, 190))
    assert sum(values[name] for name in ("poured", "spilled", "held", "elsewhere")) == pytest.approx(320 * GRAIN)
    assert values["poured"] == pytest.approx(0.011) and values["elsewhere"] == pytest.approx(17 * GRAIN)
    assert values["dose_error"] == pytest.approx(0.001) and values["dose_error_percent"] == pytest.approx(10.0)
    assert values["overshoot"] == pytest.approx(0.002) and values["seconds"] == pytest.approx(0.004)


@pytest.mark.parametrize(("target", "least", "most"), [(0.01, 97, 103), (0.03, 294, 306)], ids=["0.3 g", "2 %"])
def test_success_is_the_larger_of_two_tolerances(dose: Dose, target: float, least: int, most: int) -> None:
    for poured, is_right in ((least - 1, False), (least, True), (most, True), (most + 1, False)):
        dose.restart(target + 1e-9 * (1 if poured * GRAIN > target else -1), GRAIN)
        assert dose.is_success(counts(poured, 0, 320 - poured), {}) is is_right


def test_an_episode_ends_when_the_tool_is_level_again(dose: Dose) -> None:
    """Neither before it was tilted, nor where it is level on its way, nor before what falls has fallen."""
    steps = round(REST / 0.002)

    def hold(tilt_deg: float, n: int) -> bool:
        for _ in range(n):
            assert not dose.is_over
            dose.step(counts(0, 0, 320), pose_at(dose.task, tilt_deg), 0.0, False)
        return dose.is_over

    assert not hold(0.0, 2 * steps) and not hold(4.0, 10) and not hold(0.0, 2 * steps)
    assert not hold(6.0, 1) and not hold(0.0, steps - 1) and not hold(2.5, 1) and not hold(1.9, steps - 1)
    stored = dose.state()
    assert hold(0.0, 1)
    dose.load(stored)
    assert not dose.is_over and hold(1.0, 1)


def test_a_scoop_is_over_only_outside_its_container() -> None:
    """It starts with its open side down, 110 deg from level, and passes the level in the tray."""
    task = load_task("ScoopTo")
    dose, level = Dose(task), pose_at(task, 0.0)
    dose.restart(0.03, GRAIN)
    inside = counts(0, 0, 300)._replace(clearance=0.01)
    for _ in range(400):
        dose.step(inside, level, 0.0, False)
    assert not dose.is_over
    for _ in range(250):
        dose.step(inside._replace(clearance=0.03), level, 0.0, False)
    assert dose.is_over and dose.readings(inside)["poured"] == pytest.approx(0.03)
    assert dose.is_success(inside, {})


@pytest.mark.parametrize(("name", "start"), [("DoseSpoon", 0.0), ("ScoopTo", 110.0)])
def test_a_tilt_is_from_the_level_about_any_axis(name: str, start: float) -> None:
    """Pitch, roll, or both; the yaw does not count."""
    dose = Dose(load_task(name))
    assert np.degrees(dose.tilt(dose.task.start.pose)) == pytest.approx(start, abs=1e-5)
    for yaw, pitch, roll in itertools.product((0.0, 90.0, 200.0), (0.0, -1.5, 40.0), (0.0, 3.0, -90.0)):
        R = Rotation.from_euler("ZYX", (yaw, pitch, roll), degrees=True)
        tilt = np.arccos(np.cos(np.radians(pitch)) * np.cos(np.radians(roll)))
        pose = mpm.Pose(np.zeros(3), R.as_quat(scalar_first=True))
        assert dose.tilt(pose) == pytest.approx(tilt, abs=1e-7)


def test_a_tool_on_its_side_is_not_level() -> None:
    """Rolled by 90 deg it has no pitch; it pours, and the episode goes on until it is upright again."""
    task = load_task("DoseSpoon")
    episode, start = Episode(task, "truncate"), task.start.pose
    side = Rotation.from_euler("ZYX", (task.start.yaw_deg, 0.0, 90.0), degrees=True).as_quat(scalar_first=True)
    episode.restart(start, counts(0, 0, 320), STANDARD._replace(target_mass=0.01, grain_mass=GRAIN))
    steps = round(REST / task.step_dt)
    episode.begin_action(4 * steps)
    for _ in range(2 * steps):
        episode.add_step(counts(0, 0, 320), start._replace(quaternion=side))
    assert not episode.outcome.is_over
    assert abs(episode.tool_rotation()) < 1e-6
    for _ in range(steps + 1):
        episode.add_step(counts(0, 0, 320), start)
    assert episode.outcome.is_over


# vibration ----------------------------------------------------------------------------------------------------------
def test_a_tool_that_is_not_shaken_moves_to_the_bit_as_one_that_cannot() -> None:
    rng = np.random.default_rng(0)
    still = Carrier(task_with(action__vibration=None))
    can = Carrier(load_task("DoseSpoon"))
    for _ in range(50):
        linear, angular = rng.uniform(-0.2, 0.2, 3), rng.uniform(-2.0, 2.0, 3)
        one, other = still.command(linear, angular), can.command(linear, angular, np.array([0.0, 40.0]))
        assert np.array_equal(one.position, other.position) and np.array_equal(one.quaternion, other.quaternion)


def test_a_vibration_is_a_sine_along_the_tool_and_dies_away() -> None:
    """Its amplitude follows in 50 ms; the commanded pose stays without it, and ends untouched."""
    carrier, rest, amplitude, frequency = Carrier(load_task("DoseSpoon")), np.zeros(3), 5e-4, 31.0
    home = carrier.commanded
    offsets = np.array([carrier.command(rest, rest, np.array([amplitude, frequency])).position - home.position
                        for _ in range(500)])
    assert np.array_equal(carrier.commanded.position, home.position)
    assert np.abs(offsets[:, 1:]).max() < 1e-12  # the tool's y is the world's -x
    time = 0.002 * np.arange(1, 501)
    envelope = amplitude * (1.0 - np.exp(-time / 0.05))
    assert -offsets[:, 0] == pytest.approx(envelope * np.sin(2.0 * np.pi * frequency * time), abs=1e-9)
    state = carrier.state()
    poses = [carrier.command(rest, rest, np.array([0.0, frequency])) for _ in range(300)]
    assert np.abs(poses[0].position - home.position).max() > 1e-5 and np.array_equal(poses[-1].position, home.position)
    carrier.load(state)
    assert np.array_equal(carrier.command(rest, rest, np.array([0.0, frequency])).position, poses[0].position)


def test_an_action_of_eight_numbers() -> None:
    actions = ActionScaling(load_task("DoseSpoon"))
    linear, angular, vibration = actions.velocities(np.array([1, 0, 0, 0, -1, 0, -1, 1], np.float32))
    assert linear[0] == 0.2 and angular[1] == -2.0 and vibration.tolist() == [0.0, 60.0]
    assert actions.velocities(np.array([0] * 6 + [1, -1], np.float32))[2].tolist() == [1e-3, 20.0]
    with pytest.raises(ConfigError, match=r"action\[6\] \(amplitude\) = 2.0"):
        actions.velocities(np.array([0] * 6 + [2, 0], np.float32))
    with pytest.raises(ConfigError, match=r"shape \(6,\); accepted: \(8,\)"):
        actions.velocities(np.zeros(6, np.float32))


# refusals -----------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(("changes", "message"), [
    ({"dose__target_g": [15, 2]}, r"target_g = \(15.0, 2.0\) g; accepted: the lowest and then the highest mass"),
    ({"dose__target_g": []}, r"dose.target_g.0: Field required"), ({"dose__target_g": [0.5, 2]}, r"within 1 to 60 g"),
    ({"dose__target_g": [5, float("nan")]}, r"dose.target_g.1"), ({"tool_wall": "shells"}, r"tool_wall"),
    ({"reward": {"errors": 1}}, r"reward: unknown term 'errors'; valid: error, time, spill, distance, lost, "),
    ({"reward": {"error": -1}}, r"task.yaml: reward.error: Input should be greater"),
    ({"reward": {"error": {"weight": -1}}}, r"reward.error.weight: Input should be greater"),
    ({"reward": 3}, r"reward: 3; accepted: a table of error, time"),
    ({"action__vibration__frequency": [20, 100]}, r"accepted: up to 62.5 Hz, 8 steps in a period"),
    ({"action__vibration__frequency": [60, 20]}, r"the lowest and then the highest"),
    ({"action__vibration__amplitude": 0.0}, r"action.vibration.amplitude"),
    ({"containers__receiver__radius": None, "containers__receiver__height": None,
      "containers__receiver__mesh": "cup.stl"}, r"containers.receiver: empty; accepted: an upright container"),
    ({"containers__receiver__tilt_deg": [10, 0]}, r"containers.receiver: empty; accepted: an upright container"),
    ({"containers": {}, "target": {"centre": [0, 0, 0], "half": [1, 1, 1]},
      "bounds": {"centre": [0, 0, 0], "half": [1, 1, 1]}}, r"dose without containers; accepted: an empty one"),
    ({"target": {"centre": [0, 0, 0], "half": [1, 1, 1]}}, r"receiver with target; accepted: neither"),
    ({"success": {"delivered": 0.5}}, r"dose with success; accepted: dose.tolerance_percent"),
    ({"grains": {"count": 320, "observe_every": 2}}, r"grains.observe_every = 2")])
def test_what_does_not_fit_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        task_with(**changes)


def test_more_than_the_tool_holds_is_refused_with_both_masses() -> None:
    """42.1 g of salt, 19.4 g of flour; with the lowest fill and the lightest material of an episode."""
    task = task_with(dose__target_g=[5, 45])
    with pytest.raises(ConfigError, match=r"target mass of up to 45 g: the spoon holds 42.1 g of 1217 kg/m\^3"):
        randomized(task)
    lighter = task_with(dose__target_g=[5, 20])
    randomized(lighter)
    with pytest.raises(ConfigError, match=r"up to 20 g: the spoon holds 19.4 g of 560"):
        randomized(lighter, {"material": ("salt", "flour")})
    with pytest.raises(ConfigError, match=r"up to 40 g: the spoon holds 33.6 g"):
        randomized(lighter, {"fill": (0.8, 1.0), "target_mass": (0.01, 0.04)})


def test_more_than_an_empty_tool_has_room_for_is_refused_with_both_masses() -> None:
    """The scoop's trough, an elliptic half-cylinder with a rounded back, holds 113 ml: 63.5 g of flour."""
    task = load_task("ScoopTo")
    assert load_mass(task, 560.0, 1.0)[0] == pytest.approx(0.0635, abs=1e-4)
    randomized(task, {"target_mass": (0.06, 0.06)}, "flour")
    with pytest.raises(ConfigError, match=r"up to 60 g: the scoop has room for 56.7 g of 500 kg/m\^3; accepted"):
        randomized(task, {"density": (500.0, 560.0)}, "flour")
    few = task.model_copy(update={"grains": task.grains.model_copy(update={"count": 64})})
    assert load_mass(few, 560.0, 1e-6)[0] == pytest.approx(64 * 560e-6)  # less than that is there


def test_a_load_that_was_handed_over_is_weighed_with_its_own_grains() -> None:
    """130 grains of ScoopTo, which are larger than those of DoseScoop: 34.3 g, not 17.1 g."""
    task, volume = load_task("DoseScoop"), grain_volume(load_task("ScoopTo"))
    load = Load("ScoopTo", task.tool, load_material("salt"), volume, np.zeros((130, 3)), None, {})
    own = task_with_load("DoseScoop", task, load)
    accepted = {"target_mass": (0.005, 0.025)}
    Randomization(own, load.material, accepted, volume=volume)
    with pytest.raises(ConfigError, match=r"the scoop holds 17.1 g"):
        Randomization(own, load.material, accepted)
    with pytest.raises(ConfigError, match=r"up to 40 g: the scoop holds 34.3 g of 1217"):
        World("DoseScoop", task, EnvOptions(load=load, randomize={"target_mass": (0.005, 0.04)}))


@pytest.mark.parametrize(("pair", "message"), [
    ((0.01, 0.005), r"accepted: \(lowest, highest\)"), ((0.01,), r"accepted: \(lowest, highest\)"),
    ((0.01, 0.07), r"accepted: 0.001 to 0.06")])
def test_ranges_of_the_target_mass(pair: Any, message: str) -> None:
    with pytest.raises(ConfigError, match=f"target_mass.*{message}"):
        randomized(load_task("DoseSpoon"), {"target_mass": pair})


def test_only_a_dosing_task_draws_a_mass_and_none_has_a_gradient() -> None:
    with pytest.raises(ConfigError, match="target_mass"):
        randomized(load_task("SpoonPour"), {"target_mass": (0.01, 0.02)})
    with pytest.raises(ConfigError, match="task with reward.distance"):
        build_objective(load_task("DoseSpoon"))
