"""The dose on the arm: a plain plant pours by the tool's tilt, and the arm carries the commands out within limits."""

import numpy as np
import pytest
from bundled import plan_of, rehearsal

from robosim.base.errors import ConfigError, UnknownName, UnreachableWaypoint
from robosim.dosing.command import DoseCommand, DoseSight, accepted_error
from robosim.dosing.pour_curve import PourCurve
from robosim.planning.clearance import Clearances
from robosim.planning.plan import Plan
from robosim.rehearsal.dosing_driver import DosingDriver
from robosim.rehearsal.metrics import dose_figures
from robosim.rehearsal.session import check_config
from robosim.robot.timing import JointState

SALT = PourCurve(material="salt", load=0.05, rate_deg=2.0, source="made up for tests",
                 tilts_deg=(20.0, 40.0, 60.0, 80.0), masses=(0.0, 0.015, 0.035, 0.05))
TARE = 0.012


@pytest.fixture(scope="module")
def plan() -> Plan:
    return plan_of("dose_spoon")


class Stage:
    """A driver with a plant in place of the grains: what the largest tilt so far has poured, without any delay."""

    def __init__(self, plan: Plan, controller: object = None, most: float = 60.0, *settings: str,
                 latency: float = 0.0) -> None:
        config = plan.config.model_copy(update={"dose": rehearsal("dose_spoon", *settings).dose})
        self.q = plan.motion.state(plan.path.rests["over"][1]).q
        self.driver = driver = DosingDriver(
            plan._replace(config=config), lambda: (self.weigh(), SALT.load), latency=latency,
            controller=controller)  # pyright: ignore[reportArgumentType]
        self.largest, self.time = 0.0, driver.due
        self.states: list[JointState] = []
        self.commanded, self.reached, self.amplitudes = [], [], []
        while driver.end is None and self.time < driver.due + most:
            self.states.append(driver.command(self.time))
            self.largest = max(self.largest, driver.tool.tilt)
            if driver.done is None and len(self.states) % 20 == 0:
                self.commanded.append(driver.tool.pose().apply(driver.tool._local[None])[0])
                pose = plan.arm.tool_pose(self.states[-1].q)
                self.reached.append(pose.apply(driver.tool._local[None])[0])
                self.amplitudes.append(driver.tool.vibration.amplitude)
            self.time += config.host_dt

    def weigh(self) -> float:
        """Mass on the balance [kg], with that of the cup's own content before the dose."""
        return TARE + SALT.mass(getattr(self, "largest", 0.0))


@pytest.fixture(scope="module")
def dosed(plan: Plan) -> Stage:
    return Stage(plan)


@pytest.mark.long
def test_pi_doses_on_the_arm(dosed: Stage) -> None:
    """Within the accepted error, shown as it is after the tare."""
    stage = dosed.driver
    error = dosed.weigh() - TARE - stage.target
    assert stage.end is not None and not stage.is_late
    assert abs(error) <= accepted_error(stage.target)
    figures = dose_figures(stage, dosed.weigh() - TARE, 1e-4)
    assert figures["dose_error_kg"] == pytest.approx(error)
    assert figures["dose_shown_kg"] == pytest.approx(stage.target + error, abs=5e-5)
    assert figures["dose_overshoot_kg"] == pytest.approx(max(error, 0.0))


@pytest.mark.long
def test_the_motion_is_one_that_the_arm_can_make(plan: Plan, dosed: Stage) -> None:
    """Speeds, accelerations and jerks within the limits, also by differences; it begins and ends at rest at the
    waypoint. The lip stays where it is commanded, and swings about this place while it vibrates."""
    limits, dt = plan.arm.step_limits(), plan.config.host_dt
    q, qd, qdd = (np.array([getattr(state, name) for state in dosed.states]) for name in JointState._fields)
    assert np.all(np.abs(qd) <= limits.velocity * (1.0 + 1e-9))
    assert np.all(np.abs(qdd) <= limits.acceleration * (1.0 + 1e-9))
    assert np.all(np.abs(np.diff(qdd, axis=0)) / dt <= limits.jerk * (1.0 + 1e-6))
    assert np.abs(np.diff(q, axis=0) / dt - 0.5 * (qd[1:] + qd[:-1])).max() < 1e-3
    for end in (0, -1):
        assert q[end] == pytest.approx(dosed.q, abs=2e-4)
        assert np.abs(qd[end]).max() < 2e-3
    away, is_still = np.array(dosed.commanded) - dosed.reached, np.array(dosed.amplitudes) < 1e-5
    assert is_still.sum() > 100 and np.abs(away[is_still]).max() < 2e-4
    second = np.ones(50) / 50  # places are 20 ms apart
    assert max(np.abs(np.convolve(along, second, "valid")).max() for along in away.T) < 2e-4


class Restless:
    """Tilts and shakes for ever."""

    def __init__(self) -> None:
        self.sights: list[DoseSight] = []

    def start(self, target: float, accepted: float) -> None:
        self.target, self.accepted = target, accepted

    def command(self, sight: DoseSight) -> DoseCommand:
        self.sights.append(sight)
        return DoseCommand(np.radians(20.0), np.zeros(3), 2e-4, 15.0, False)


@pytest.mark.long
def test_a_controller_that_never_ends_is_stopped(plan: Plan) -> None:
    """At the time limit the tool is tilted back; before, no tilt is beyond the checked range."""
    controller = Restless()
    run = Stage(plan, controller, 60.0, "dose.time_limit=6", "dose.settle=0.5")
    tilts = np.array([sample.tilt for sample in run.driver.samples])
    assert run.driver.is_late and run.driver.end is not None
    assert tilts.max() == pytest.approx(np.radians(100.0)) and run.driver.tool.tilt == 0.0
    assert dose_figures(run.driver, 0.05, 1e-4)["dosing_timed_out"] is True
    times = np.array([sight.time for sight in controller.sights])
    assert np.diff(times) == pytest.approx(0.02, abs=1e-9) and times[0] == 0.0
    assert controller.sights[0].shown == pytest.approx(0.0, abs=5e-5)  # tared


def test_commands_arrive_late_by_the_latency(plan: Plan) -> None:
    settings = ("dose.time_limit=1", "dose.settle=0.2")
    prompt, late = (Stage(plan, Restless(), 20.0, *settings, latency=latency).states for latency in (0.0, 0.0052))
    assert len(late) == len(prompt)
    np.testing.assert_array_equal([state.q for state in late[5:]], [state.q for state in prompt[:-5]])
    assert all(np.array_equal(state.q, prompt[0].q) for state in late[:5])
    assert np.abs(np.diff([state.q for state in prompt], axis=0)).max() > 1e-4


def test_a_target_above_the_load_is_refused_with_both_masses(plan: Plan) -> None:
    for start in (lambda setting: check_config(rehearsal("dose_spoon", setting)),
                  lambda setting: Stage(plan, None, 60.0, setting)):
        with pytest.raises(ConfigError, match=r"dose.target_g = 60 g; the spoon .* with \d+\.\d\d g of salt"):
            start("dose.target_g=60")


def test_a_tilt_out_of_reach_is_refused_before_the_run(plan: Plan) -> None:
    """By its angle; so is one at which the spoon touches the cup."""
    q = plan.motion.state(plan.path.rests["over"][1]).q
    Clearances(plan.config, plan.arm).check_dose(q)
    far = plan.config.model_copy(update={"dose": rehearsal("dose_spoon", "dose.largest_tilt_deg=180").dose})
    with pytest.raises((UnreachableWaypoint, ConfigError), match=r"over \(dose, tilt \d+ deg\)"):
        Clearances(far, plan.arm).check_dose(q)
    low = plan.config.model_copy(update={"waypoints": tuple(
        w.model_copy(update={"position": (*w.position[:2], 0.122)}) if w.name == "over" else w
        for w in plan.config.waypoints)})
    with pytest.raises(ConfigError, match=r"over \(dose, tilt .* deg\).*(overlap|apart)"):
        Clearances(low, plan.arm).check_dose(q)


@pytest.mark.parametrize(("setting", "message"), [
    ("dose.at=nowhere", "dose.at: unknown waypoint 'nowhere'; valid: across, over, back"),
    ("dose.at=0", "greater than or equal to 1"),
    ("dose.at=across", "dose.at: waypoint 'across'; accepted: one with stop: true"),
    ("dose.target_g=61", "less than or equal to 60"),
    ("dose.cup=mug", "dose.cup = mug; accepted: one of the empty containers cup"),
    ("dose.controller=pid", "'open_loop', 'pi' or 'shaker'"),
    ("tool_wall=0.003", "dose with tool_wall: 0.003, .*; accepted: shell"),
    ("dose.balance.lag=-1", "greater than or equal to 0"),
    # of the controller
    ("dose.controllers=DoseFork", "dosing numbers 'DoseFork'"),
    ("dose.numbers={pi: {serch_deg: 3}}", "dose.numbers: .*pi.serch_deg"),
    ("dose.numbers={pi: {search_deg: 300}}", "dose.numbers: .*pi.search_deg"),
    ("dose.numbers={task: {a: 1}, curve: {load: 1}}",
     "dose.numbers: sections curve, task; accepted: motion, vibration, open_loop, pi, shaker"),
    ("dose.numbers={vibration: {frequency: 126}}",
     "vibration.frequency = 126 Hz with host_dt = 0.001 s; accepted: up to 125 Hz, 8 steps in a period"),
    ("dose.controllers=DoseScoop", "numbers of DoseScoop for the tool 'scoop'; the tool is 'spoon'"),
    ("dose.control_dt=0.0015", "dose.control_dt = 0.0015 s is 1.5000 steps of host_dt"),
    ("servo={bandwidth: 500}", "host_dt = 0.001 s: the servo of joint .* [(]bandwidth 500 Hz, .* needs steps below"),
    # of the place
    ("waypoints.2.rotation_deg=[0, 5, 90]", "the tool leans by 5.0 deg at waypoint 'over'"),
    ("waypoints.2.position=[0.72, 0.1, 0.165]", "mm aside of the middle of the cup 'cup'"),
    ("containers.cup.tilt_deg=[3, 0]", "the cup 'cup' by [(]3.0, 0.0[)] deg"),
])
def test_wrong_doses_are_refused(setting: str, message: str) -> None:
    """Before a run: by the schema, or by what is checked of the configuration."""
    with pytest.raises((ConfigError, UnknownName), match=message):
        check_config(rehearsal("dose_spoon", setting))
