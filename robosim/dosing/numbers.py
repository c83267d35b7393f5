"""Numbers of the dosing controllers, files of configs/dosing."""

from typing import Annotated

from pydantic import Field

from robosim.base.errors import ConfigError
from robosim.base.resources import config_path
from robosim.config.bounds import Name, Text
from robosim.config.table import Table, load
from robosim.dosing.pour_curve import PourCurve

# A wrist turns by up to 180 deg/s; below 0.1 deg/s a dose takes minutes.
TiltRate = Annotated[float, Field(ge=0.1, le=180.0)]
TiltAngle = Annotated[float, Field(ge=0.0, le=90.0)]
Seconds = Annotated[float, Field(ge=0.01, le=60.0)]
Gain = Annotated[float, Field(ge=0.0, le=20.0)]
PartOfWhole = Annotated[float, Field(ge=0.0, le=1.0)]

SECTIONS = ("motion", "vibration", "open_loop", "pi", "shaker")
"""Sections of a file that are numbers, not a curve."""
PI_RATES = ("search_deg", "fastest_deg")
"""Numbers of the controller pi that are at most `motion.fast_deg`."""


class MotionNumbers(Table):
    """How the tool moves with every controller."""

    duration: float = Field(default=20.0, ge=1.0, le=600.0)
    """Time [s] after which the dose is over, whatever it is."""
    fast_deg: TiltRate = 60.0
    """Tilt rate [deg/s] up to the tilt at which the controller begins, and back to level at the end."""
    acceleration_deg: float = Field(default=400.0, ge=1.0, le=1e4)
    """Largest change of the tilt rate [deg/s^2]."""
    approach_time: Seconds = 0.3
    """Time constant [s] with which the lip goes to the goal."""
    approach_speed: float = Field(default=0.1, ge=1e-3, le=2.0)
    """Largest speed of the lip [m/s]."""
    near: float = Field(default=0.01, ge=1e-4, le=0.2)
    """Distance of lip and goal in the horizontal plane [m] from which on the tool is tilted."""


class VibrationNumbers(Table):
    """The vibration at a command of 1."""

    amplitude: float = Field(ge=0.0, le=0.01)
    """Amplitude [m] of the strongest vibration that controllers command."""
    frequency: float = Field(ge=1.0, le=500.0)
    """Its frequency [Hz]."""


class OpenLoopNumbers(Table):
    """Tilt to the angle at which the pour curve gives the target, wait, tilt back; the balance is not read."""

    before_deg: TiltAngle = 10.0
    """Angle [deg] before the tilt at which pouring begins, from which on the tilt is slow."""
    search_deg: TiltRate = 8.0
    """Slow tilt rate [deg/s]."""
    share: float = Field(default=1.0, ge=0.1, le=3.0)
    """Mass that is aimed at, as a share of the target: what the material gives more or less than the curve."""
    hold: Seconds = 0.5
    """Time [s] at the last tilt."""


class PiNumbers(Table):
    """PI control of the flow by the vibration, with the pour curve as feed-forward of the tilt; then single pulses."""

    before_deg: TiltAngle = 15.0
    """Angle [deg] before the tilt at which pouring begins, from which on it shakes."""
    search_deg: TiltRate = 2.0
    """Tilt rate [deg/s] until something flows, and with the strongest vibration."""
    middle: float = Field(default=0.5, ge=0.0, le=0.99)
    """Vibration above which it tilts on, as a share of the largest."""
    fastest_deg: TiltRate = 10.0
    """Largest tilt rate [deg/s] while it pours."""
    time: Seconds = 3.0
    """Time constant [s]: the wanted flow is the missing mass divided by it."""
    least: Gain = 1.0
    """Least wanted flow, in accepted errors per second."""
    proportional: Gain = 0.05
    """Share of the strongest vibration per relative error of the flow."""
    integral: Gain = 0.2
    """Rate [1/s] of that share per relative error of the flow."""
    first: float = Field(default=0.7, ge=0.1, le=1.0)
    """Share of the target at which the flow stops."""
    left: float = Field(default=2e-3, ge=0.0, le=1.0)
    """Mass [kg] before the target at which it stops at least: what begins to flow comes in a gush."""
    delay: float = Field(default=0.3, ge=0.0, le=5.0)
    """Time [s] that the flow still arrives after a stop."""
    lag: float = Field(default=0.2, ge=0.0, le=10.0)
    """Time constant [s] of the balance's filter, as its maker states it or a dropped weight shows it."""
    window: Seconds = 0.2
    """Time [s] over which the flow is measured."""
    stop_deg: TiltAngle = 10.0
    """Angle [deg] that the tool tilts back at a stop."""
    resume_deg: TiltAngle = 2.0
    """Angle [deg] before the tilt of a stop at which it shakes again."""
    settle: Seconds = 0.6
    """Time [s] that the tool waits after a stop."""
    resume: PartOfWhole = 0.7
    """Vibration of the first pulse, as a share of that at the stop."""
    weakest: PartOfWhole = 0.1
    """Vibration of a pulse at least, as a share of the largest."""
    pulse: Seconds = 0.12
    """Time [s] of a pulse."""
    pause: Seconds = 0.4
    """Time [s] from its end to the next."""
    next: float = Field(default=0.4, ge=0.05, le=1.0)
    """Share of the missing mass that a pulse is to bring."""
    close: PartOfWhole = 0.8
    """Share of the accepted error below which a missing mass ends the dose."""


class ShakerNumbers(Table):
    """Hold a tilt at which nothing flows by itself, and shake until the balance shows enough."""

    before_deg: TiltAngle = 8.0
    """Angle [deg] before the tilt at which pouring begins, at which it shakes first."""
    search_deg: TiltRate = 4.0
    """Tilt rate [deg/s] while it shakes and too little flows."""
    amplitude: PartOfWhole = 1.0
    """Vibration while it shakes, as a share of the largest."""
    time: Seconds = 3.0
    """Time constant [s]: it tilts on while less flows than the missing mass divided by it."""
    ahead: float = Field(default=0.1, ge=0.0, le=1.0)
    """Share of the target by which the first stop comes before it."""
    pulse: Seconds = 0.3
    """Longest time [s] that it shakes at once after the first stop."""
    settle: Seconds = 0.8
    """Time [s] that it waits after it has shaken."""
    margin: PartOfWhole = 0.5
    """Share of the accepted error below which a missing mass ends the dose."""


class DosingNumbers(Table):
    """A file of configs/dosing: a task's pour curve, and what each controller works with on it."""

    task: Name
    """Name of the task, such as DoseSpoon."""
    tool: Name
    """Name of the tool that the curve was measured with, such as spoon; the numbers are used with no other."""
    source: Text = "chosen by hand"
    """Command that found the controllers' numbers, or who chose them."""
    curve: PourCurve
    """Pour curve of the task's tool with its load."""
    motion: MotionNumbers = MotionNumbers()
    """How the tool moves with every controller."""
    vibration: VibrationNumbers
    """The strongest vibration."""
    open_loop: OpenLoopNumbers = OpenLoopNumbers()
    """Numbers of the controller open_loop."""
    pi: PiNumbers = PiNumbers()
    """Numbers of the controller pi."""
    shaker: ShakerNumbers = ShakerNumbers()
    """Numbers of the controller shaker."""

    def check(self) -> None:
        for name in PI_RATES:
            if getattr(self.pi, name) > self.motion.fast_deg:
                raise ValueError(f"pi.{name} = {getattr(self.pi, name)} with motion.fast_deg = {self.motion.fast_deg} "
                                 f"deg/s; accepted: up to it")


def load_dosing(name: str) -> DosingNumbers:
    """Load a file of configs/dosing by name, or one's own by path.
    Raises ConfigError for a file that cannot be used, UnknownName for a name that does not exist."""
    return load(config_path("dosing", name, "dosing numbers"), DosingNumbers)


def check_tool(numbers: DosingNumbers, tool: str, where: str) -> None:
    """Raise ConfigError for numbers of another tool; where: the key or command that names them."""
    if numbers.tool != tool:
        raise ConfigError(f"{where}: numbers of {numbers.task} for the tool {numbers.tool!r}; the tool is {tool!r}; "
                          f"accepted: numbers for it, of robosim tune --curve --set dose.controllers=null")
