"""The stage of a rehearsal in which a controller doses: balance, controller, tool pose, joints, step by step."""

from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from robosim.base.errors import ConfigError, RobotDiverged
from robosim.config.bounds import SAMPLES_PER_PERIOD
from robosim.config.rehearsal import RehearsalConfig
from robosim.config.table import validate
from robosim.dosing.command import DoseCommand, DoseController, DoseSight, accepted_error
from robosim.dosing.controllers import make_controller
from robosim.dosing.numbers import SECTIONS, DosingNumbers, check_tool, load_dosing
from robosim.instruments.balance import Balance
from robosim.planning.lip_motion import LipMotion, make_lip_motion
from robosim.robot.inverse_kinematics import step_towards
from robosim.robot.joint_control import JointSmoother
from robosim.robot.model import Arm
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


class DosingStage:
    """Drives the arm by a dosing controller while the planned motion rests at a waypoint.

    q: the arm's posture there (n,) [rad]. dt: time between two joint commands [s]. controller: None for the configured
    one. weigh: mass [kg] on the balance, tare included. Every `control_dt` the controller sees the balance and the
    commanded tool; every dt its command moves the tool about its lip, inverse kinematics find the joints, and Ruckig
    keeps them within the limits of speed, acceleration and jerk. At the end the arm returns to the posture.
    latency: time [s] by which the joints' commands arrive late, to the nearest dt.
    """

    def __init__(self, config: RehearsalConfig, arm: Arm, q: np.ndarray, weigh: Callable[[], float], seed: int = 0,
                 controller: DoseController | None = None, latency: float = 0.0) -> None:
        assert config.dose is not None
        self._config, self._dose, self._arm, self._weigh = config, config.dose, arm, weigh
        self._controller = controller or make_dose_controller(config)
        self.motion: LipMotion = make_lip_motion(config)
        self.target = 1e-3 * config.dose.target_g
        """[kg]"""
        self._dt = config.host_dt
        self._smoother = JointSmoother(arm.step_limits(), self._dt, arm)
        self._rest, self._q = q.copy(), q.copy()
        self._sent: deque[JointState] = deque(maxlen=round(latency / self._dt) + 1)
        self._every = round(config.dose.control_dt / self._dt)
        self._count, balance = 0, config.dose.balance
        self._command = DoseCommand(0.0, np.zeros(3), 0.0, 0.0, False)
        self._balance = Balance(balance.lag, balance.readability, balance.repeatability)
        self._memory, self._rng = Balance.start(0.0, 0.0), np.random.default_rng(seed)
        self.samples: list[DoseSample] = []
        """One for each control step, and those in which the balance settles."""
        self.tare = 0.0
        """Mass on the balance as it began [kg]."""
        self.begin: float | None = None
        """Simulated time [s] at which it began; None before."""
        self.done: float | None = None
        """Simulated time [s] at which the controller had finished and the tool was level; None before."""
        self.end: float | None = None
        """Simulated time [s] at which the planned motion goes on; None before."""
        self.is_late = False
        """Whether the time limit ended it."""

    @property
    def is_running(self) -> bool:
        """Whether it has begun and is not over."""
        return self.begin is not None and self.end is None

    @property
    def duration(self) -> float:
        """Time [s] by which it delays the planned motion; 0 until it is over."""
        return 0.0 if self.begin is None or self.end is None else self.end - self.begin

    def stack(self, name: str) -> np.ndarray:
        """Stack the values of one field of `DoseSample` over all samples (n,)."""
        return np.array([getattr(sample, name) for sample in self.samples])

    def start(self, time: float, load: float) -> None:
        """Begin at a time [s] with a load [kg] in the tool, and tare the balance.

        Raises ConfigError for a target above the load.
        """
        check_target(self._config, load, f"holds it at waypoint {self._config.dose_at!r}")
        self.begin = time
        self.tare = self._weigh()
        self._memory = Balance.start(time, self.tare)
        self._smoother.restart(self._q)
        self._controller.start(self.target, accepted_error(self.target))

    def step(self, time: float) -> JointState:
        """Return the joints' command that arrives for the step from a time [s] on; over once `end` is set.

        Raises RobotDiverged where the arm cannot come back.
        """
        self._sent.append(self._next(time))
        return self._sent[0]

    def _next(self, time: float) -> JointState:
        """Return the joints' command that is sent."""
        assert self.begin is not None
        if self._count % self._every == 0:
            self._control(time)
        self._count += 1
        if self.done is not None:
            return self._return(time)
        target = self.motion.advance(self._command, self._dt)
        q = step_towards(self._arm, target, self._q, self._rest)
        qd, self._q = (q - self._q) / self._dt, q
        return self._smoother.step(q, qd)

    def _control(self, time: float) -> None:
        """Read the balance, and ask the controller unless it has finished."""
        assert self.begin is not None
        mass, motion = self._weigh(), self.motion
        shown = self._balance.read(self._memory, time, mass, self._rng, self.tare)
        self.samples.append(DoseSample(time, shown, mass - self.tare, motion.tilt, motion.amplitude))
        if self.done is not None:
            return
        sight = DoseSight(time - self.begin, shown, self.target, motion.tilt, motion.lip, motion.goal)
        self._command = self._controller.command(sight)
        self.is_late = self.is_late or sight.time > self._dose.time_limit
        if self.is_late:
            self._command = DoseCommand(-BACK_RATE, np.zeros(3), 0.0, 0.0, motion.tilt == 0.0)
        if self._command.done:
            self.done = time

    def _return(self, time: float) -> JointState:
        """Go back to the posture of the waypoint, and wait there until the balance has settled."""
        assert self.done is not None
        state = self._smoother.step(self._rest, np.zeros_like(self._rest))
        since = time - self.done
        is_back = max(np.abs(state.q - self._rest).max(), np.abs(state.qd).max()) < AT_REST
        if is_back and since >= self._dose.settle:
            self.end = time + self._dt
        elif since > self._dose.settle + MOST_RETURN:
            raise RobotDiverged(time, [f"the arm is not back at waypoint {self._config.dose_at!r} after the dose"])
        return state


def make_dose_controller(config: RehearsalConfig) -> DoseController:
    """Make the controller of a rehearsal's dose.

    Raises ConfigError, UnknownName for its file and numbers, also those of another tool, and a vibration that steps of
    `host_dt` do not resolve.
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
    return make_controller(dose.controller, numbers, numbers.curve, dose.control_dt)


def check_target(config: RehearsalConfig, load: float, where: str) -> None:
    """Raise ConfigError for a target above a load [kg]; where: which load that is."""
    assert config.dose is not None
    if 1e-3 * config.dose.target_g > load:
        raise ConfigError(f"dose.target_g = {config.dose.target_g:g} g; the {config.tool_name} {where} with "
                          f"{1e3 * load:.2f} g of {config.material}; accepted: up to that")
