"""The driver of a rehearsal in which a controller doses: balance, controller, tool pose, joints, step by step."""

from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from robosim.base.errors import ConfigError, RobotDiverged
from robosim.cell.drivers import MotionDriver
from robosim.config.bounds import SAMPLES_PER_PERIOD
from robosim.config.rehearsal import RehearsalConfig
from robosim.config.table import validate
from robosim.dosing.balance import Balance
from robosim.dosing.command import DoseCommand, DoseController, DoseSight, accepted_error
from robosim.dosing.controllers import make_controller
from robosim.dosing.numbers import SECTIONS, DosingNumbers, check_tool, load_dosing
from robosim.planning.lip_motion import make_lip_motion
from robosim.planning.plan import Plan
from robosim.robot.inverse_kinematics import step_towards
from robosim.robot.joint_control import JointSmoother
from robosim.robot.timing import JointState

BACK_RATE = np.radians(30.0)
"""Tilt rate [rad/s] with which the tool is levelled after the time limit."""
AT_REST, MOST_RETURN = 1e-4, 5.0
"""Joint displacement [rad] up to which the arm is back at the waypoint, and time [s] that it may take for that."""


class DoseSample(NamedTuple):
    """What a dose is like at one moment of control."""

    time: float
    """Simulated time [s]."""
    shown: float
    """What the balance shows [kg]."""
    mass: float
    """Mass on the balance less the tare [kg]."""
    tilt: float
    """Commanded tilt [rad]."""
    amplitude: float
    """Amplitude of the vibration [m]."""


class DosingDriver(MotionDriver):
    """Commands a planned motion that rests at a waypoint while a dosing controller drives the arm.

    masses: returns the masses [kg] on the balance, tare included, and in the tool. controller: None for the configured
    one. latency: time [s] by which the joints' commands arrive late, to the nearest step. Every `control_dt` the
    controller sees the balance and the commanded tool; every step its command moves the tool about its lip, inverse
    kinematics find the joints, and Ruckig keeps them within the limits of speed, acceleration and jerk. At the end the
    arm returns to the posture of the waypoint."""

    def __init__(self, plan: Plan, masses: Callable[[], tuple[float, float]], seed: int = 0,
                 controller: DoseController | None = None, latency: float = 0.0) -> None:
        config, arm = self._config, self._arm = plan.config, plan.arm
        self._masses = masses
        assert config.dose is not None
        super().__init__(plan.motion, config.grasp_time, latency)
        self._dose, self._dt = config.dose, config.host_dt
        self._controller = controller or make_dose_controller(config)
        self.tool = make_lip_motion(config)
        self.target = 1e-3 * config.dose.target_g
        """[kg]"""
        rest = plan.path.rests[config.dose_at][1]
        self.due = rest + config.grasp_time
        """Simulated time [s] from which on it doses."""
        self._smoother = JointSmoother(arm.step_limits(), self._dt, arm)
        self._rest = self._q = plan.motion.state(rest).q
        self._sent: deque[JointState] = deque(maxlen=round(latency / self._dt) + 1)
        self._steps_to_control = 0
        self._command = DoseCommand(0.0, np.zeros(3), 0.0, 0.0, False)
        self._balance, self._rng = Balance(**config.dose.balance.model_dump()), np.random.default_rng(seed)
        self.samples: list[DoseSample] = []
        """One for each control step, and those in which the balance settles."""
        self.tare = 0.0
        """Mass on the balance as it began [kg]."""
        self.begin: float | None = None
        """Simulated time [s] at which the dose began; None before."""
        self.done: float | None = None
        """Simulated time [s] at which the controller had finished and the tool was level; None before."""
        self.end: float | None = None
        """Simulated time [s] at which the planned motion goes on; None before."""
        self.is_late = False
        """Whether the time limit ended it."""

    def stack(self, name: str) -> np.ndarray:
        """Stack the values of one field of `DoseSample` over all samples (n,)."""
        return np.array([getattr(sample, name) for sample in self.samples])

    def motion_time(self, time: float) -> float:
        """Return the time [s] of the motion at a simulated time [s]; it rests while the dose runs."""
        if self.begin is not None and self.begin <= time and (self.end is None or time < self.end):
            return self.begin - self._start
        return time - self._start - (0.0 if self.begin is None or time < self.begin else self.delay)

    def is_dosing_at(self, time: float) -> bool:
        return self.begin is not None and self.begin <= time <= (self.end or np.inf)

    def expected_duration(self, time: float) -> float:
        """Return the simulated time [s] of the run, if the dose ended at a time, where it runs then."""
        return self.duration + (time - self.begin if self.is_open_ended and self.begin else 0.0)

    def command(self, time: float) -> JointState:
        """Return the command of the dose while it runs, else that of the motion.
        Raises ConfigError for a target above the load, RobotDiverged where the arm cannot come back."""
        if self.begin is None and time >= self.due:
            self._begin_dose(time)
        if not self.is_open_ended:
            return super().command(time)
        self._sent.append(self._next(time))
        return self._sent[0]

    def _begin_dose(self, time: float) -> None:
        self.tare, load = self._masses()
        check_target(self._config, load, f"holds it at waypoint {self._config.dose_at!r}")
        self.begin, self.is_open_ended = time, True
        self._memory = Balance.start(time, self.tare)
        self._smoother.restart(self._q)
        self._controller.start(self.target, accepted_error(self.target))

    def _next(self, time: float) -> JointState:
        if self._steps_to_control == 0:
            self._control(time)
            self._steps_to_control = round(self._dose.control_dt / self._dt)
        self._steps_to_control -= 1
        if self.done is not None:
            return self._return(time, time - self.done)
        target = self.tool.advance(self._command, self._dt)
        q = step_towards(self._arm, target, self._q, self._rest)
        qd, self._q = (q - self._q) / self._dt, q
        return self._smoother.step(q, qd)

    def _control(self, time: float) -> None:
        """Read the balance, and ask the controller unless it has finished."""
        assert self.begin is not None
        mass, tool = self._masses()[0], self.tool
        shown = self._balance.read(self._memory, time, mass, self._rng, self.tare)
        self.samples.append(DoseSample(time, shown, mass - self.tare, tool.tilt, tool.vibration.amplitude))
        if self.done is not None:
            return
        sight = DoseSight(time - self.begin, shown, self.target, tool.tilt, tool.lip, tool.goal)
        self._command = self._controller.command(sight)
        self.is_late = self.is_late or sight.time > self._dose.time_limit
        if self.is_late:
            self._command = DoseCommand(-BACK_RATE, np.zeros(3), 0.0, 0.0, tool.tilt == 0.0)
        if self._command.done:
            self.done = time

    def _return(self, time: float, since: float) -> JointState:
        """Go back to the posture of the waypoint, and wait there until the balance has settled."""
        state = self._smoother.step(self._rest, np.zeros_like(self._rest))
        is_back = max(np.abs(state.q - self._rest).max(), np.abs(state.qd).max()) < AT_REST
        if is_back and since >= self._dose.settle:
            assert self.begin is not None
            self.end, self.is_open_ended = time + self._dt, False
            self.delay = self.end - self.begin
        elif since > self._dose.settle + MOST_RETURN:
            raise RobotDiverged(time, [f"the arm is not back at waypoint {self._config.dose_at!r} after the dose"])
        return state


def make_dose_controller(config: RehearsalConfig) -> DoseController:
    """Make the controller of a rehearsal's dose.
    Raises ConfigError, UnknownName for its file and numbers, another tool, and a vibration above what `host_dt` allows.
    """
    dose = config.dose
    assert dose is not None
    steps = dose.control_dt / config.host_dt
    if abs(steps - round(steps)) > 1e-6:
        raise ConfigError(f"dose.control_dt = {dose.control_dt} s is {steps:.4f} steps of host_dt = {config.host_dt} "
                          f"s; accepted: a whole number")
    numbers = load_dosing(dose.controllers)
    if unknown := set(dose.numbers) - set(SECTIONS):
        raise ConfigError(f"dose.numbers: sections {', '.join(sorted(unknown))}; accepted: {', '.join(SECTIONS)}")
    if dose.numbers:
        given = numbers.model_dump(mode="json")
        for section, values in dose.numbers.items():
            given[section] = {**given[section], **values}
        numbers = validate(given, Path("dose.numbers"), DosingNumbers)
    check_tool(numbers, config.tool_name, "dose.controllers")
    highest = 1.0 / (SAMPLES_PER_PERIOD * config.host_dt)
    if numbers.vibration.frequency > highest * (1.0 + 1e-9):
        raise ConfigError(f"dose.controllers: vibration.frequency = {numbers.vibration.frequency:g} Hz with host_dt = "
                          f"{config.host_dt} s; accepted: up to {highest:g} Hz, {SAMPLES_PER_PERIOD} steps in a period")
    return make_controller(dose.controller, numbers, dose.control_dt)


def check_target(config: RehearsalConfig, load: float, where: str) -> None:
    """Raise ConfigError for a target above a load [kg]; where: which load that is."""
    assert config.dose is not None
    if 1e-3 * config.dose.target_g > load:
        raise ConfigError(f"dose.target_g = {config.dose.target_g:g} g; the {config.tool_name} {where} with "
                          f"{1e3 * load:.2f} g of {config.material}; accepted: up to that")
