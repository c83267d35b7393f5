"""A plain model of a tool that pours onto a balance, for tests of dosing controllers."""

from collections import deque
from collections.abc import Sequence

import numpy as np

from robosim.dosing.command import DoseCommand, DoseController, DoseSight, accepted_error
from robosim.dosing.pour_curve import PourCurve

SALT = PourCurve(material="salt", load=0.08, rate_deg=2.0, source="made up for tests",
                 tilts_deg=(20.0, 30.0, 40.0, 50.0, 60.0, 75.0), masses=(0.0, 0.002, 0.02, 0.045, 0.068, 0.08))
VIBRATION = {"amplitude": 5e-4, "frequency": 50.0}


class Plant:
    """A load that comes off in slabs, each at a tilt of its own; it slides, falls, and a balance shows it late.

    Shaken, slabs come off earlier, with a flow that grows with amplitude and tilt: as measured with powders.
    curve: of the material in the tool, which the controller need not know. slab: mean mass [kg]. slide: its time
    constant [s]. shaken_deg: angle before its own tilt from which vibration moves it.
    shaken_flow: largest flow [kg/s]."""

    fall, lag, readability, dt = 0.15, 0.2, 1e-5, 0.02

    def __init__(self, curve: PourCurve, seed: int = 0, slab: float = 2e-4, slide: float = 0.2,
                 shaken_deg: float = 25.0, shaken_flow: float = 8e-3) -> None:
        rng = np.random.default_rng(seed)
        masses: list[float] = []
        while sum(masses) < curve.most:
            masses.append(float(slab * rng.uniform(0.5, 1.5)))
        self.slabs = np.array(masses)
        self.tilts = np.array([curve.tilt(m) for m in np.cumsum(self.slabs) - self.slabs])
        self.off = np.zeros(len(self.slabs), bool)
        self.slide, self.shaken, self.load = slide, np.radians(shaken_deg), curve.load
        self.shaken_flow, self.moved = shaken_flow, 0.0
        self.sliding, self.landed, self.shown, self.time, self.tilt = 0.0, 0.0, 0.0, 0.0, 0.0
        self.falling: deque[tuple[float, float]] = deque()
        self.lip, self.goal = np.array([0.02, -0.03, 0.25]), np.array([0.0, 0.0, 0.25])

    @property
    def poured(self) -> float:
        """Mass [kg] that has left the tool or slides."""
        return float(self.slabs[self.off].sum())

    def sight(self, target: float) -> DoseSight:
        shown = self.readability * round(self.shown / self.readability)
        return DoseSight(self.time, shown, target, self.tilt, self.lip, self.goal)

    def advance(self, command: DoseCommand) -> None:
        self.tilt += command.tilt_rate * self.dt
        self.lip = self.lip + command.velocity * self.dt
        loose = ~self.off & (self.tilts < self.tilt)
        rest = np.flatnonzero(~self.off & ~loose)
        if len(rest):
            near = max(0.0, 1.0 - (self.tilts[rest[0]] - self.tilt) / self.shaken)
            self.moved += self.shaken_flow * near * command.amplitude / VIBRATION["amplitude"] * self.dt
            if self.moved >= self.slabs[rest[0]]:
                loose[rest[0]], self.moved = True, 0.0
        self.sliding += self.slabs[loose].sum()
        self.off |= loose
        leaves = self.sliding * (1.0 - np.exp(-self.dt / self.slide))
        self.sliding -= leaves
        self.time += self.dt
        self.falling.append((self.time + self.fall, leaves))
        while self.falling and self.falling[0][0] <= self.time:
            self.landed += self.falling.popleft()[1]
        self.shown += (self.landed - self.shown) * (1.0 - np.exp(-self.dt / self.lag))


class Dose:
    """A dose of a controller on a plant, command by command."""

    def __init__(self, controller: DoseController, plant: Plant, target: float, accepted: float | None = None) -> None:
        controller.start(target, accepted_error(target) if accepted is None else accepted)
        self.commands: list[DoseCommand] = []
        while plant.time < 22.0 and not (self.commands and self.commands[-1].done):
            command = controller.command(plant.sight(target))
            self.commands.append(command)
            plant.advance(command)
        self.error, self.seconds, self.tilt = plant.poured - target, plant.time, plant.tilt

    @property
    def rates(self) -> np.ndarray:
        """Tilt rates [rad/s], one a command."""
        return np.array([command.tilt_rate for command in self.commands])


def shifted(curve: PourCurve, shift_deg: float, stretch: float = 1.0) -> PourCurve:
    """Return the curve of a material that begins to pour later, and over more tilt."""
    first = curve.tilts_deg[0]
    tilts: Sequence[float] = [first + shift_deg + stretch * (tilt - first) for tilt in curve.tilts_deg]
    return PourCurve.model_validate(curve.model_dump() | {"tilts_deg": tilts, "material": "flour"})
