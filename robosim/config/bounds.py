"""Numbers and texts of configuration files with the bounds that they are accepted in, and the reason of each."""

from typing import Annotated, Any, Literal, NamedTuple

import pydantic
from pydantic import Field

# Positions are in single precision: at 100 m from the origin it resolves 8 micrometres, a fiftieth of a grain of salt.
FarCoordinate = Annotated[float, Field(ge=-100.0, le=100.0)]
"""[m] of a region, which may hold all of a scene, and of recordings of users' own scenes."""
# No arm reaches further; lengths in millimetres are mostly outside.
Coordinate = Annotated[float, Field(ge=-10.0, le=10.0)]
HalfSize = Annotated[float, Field(ge=0.0, le=100.0)]
"""Half an edge [m]; zero for a region without thickness."""
# More than a turn is the same pose.
Angle = Annotated[float, Field(ge=-360.0, le=360.0)]
"""[deg]"""
# A grain of powder has 0.1 mm; a cell, wall or tolerance below it is no part of a continuum of grains. Vessels of more
# than 10 m are outside every arm's reach.
Length = Annotated[float, Field(ge=1e-4, le=10.0)]
Height = Annotated[float, Field(ge=0.0, le=10.0)]
# A hundredth of the data sheet's repeatability (0.1 mm) can be neither commanded nor measured.
Tolerance = Annotated[float, Field(ge=1e-6, le=0.1)]
# Industrial arms reach 10 m/s and 20 rad/s at the flange. At 0.1 mm/s a metre takes three hours: another unit is meant.
Speed = Annotated[float, Field(ge=1e-4, le=20.0)]
AngularSpeed = Annotated[float, Field(ge=1e-3, le=100.0)]
# Up to 100 g; below 1 mm/s^2 a movement of 0.1 m/s takes minutes to begin.
Acceleration = Annotated[float, Field(ge=1e-3, le=1000.0)]
AngularAcceleration = Annotated[float, Field(ge=1e-3, le=1e4)]
# Ten minutes are longer than any task of the arm, and are 600 000 steps of 1 ms.
Duration = Annotated[float, Field(ge=0.0, le=600.0)]
# Fingers close within a minute, and not in less than a step of 1 ms.
GraspTime = Annotated[float, Field(ge=1e-3, le=60.0)]
# A sound wave passes a cell of 0.1 mm in 0.1 us at 1000 m/s; larger steps than 0.1 s are longer than a grain's fall.
TimeStep = Annotated[float, Field(ge=1e-7, le=0.1)]
# Dry pairs have up to 1.5 (rubber); at 10 nothing slides any more.
Friction = Annotated[float, Field(ge=0.0, le=10.0)]
# From one grain a cell, below which neighbours share no node, to four along each edge: errors do not fall beyond.
GrainsPerCell = Annotated[float, Field(ge=1.0, le=64.0)]
# Returns are summed in single precision, which has seven digits.
Weight = Annotated[float, Field(ge=-1e6, le=1e6)]
PositiveWeight = Annotated[float, Field(ge=1e-6, le=1e6)]
# Per-joint limits and gains: a hobby servo has 0.1 N m/rad, the largest industrial arms 1e6; Ruckig takes up to 1e6.
JOINT_RANGE = 1e-3, 1e6
JointValue = Annotated[float, Field(ge=JOINT_RANGE[0], le=JOINT_RANGE[1])]
# A thousandth of a joint's speed, or of the grains, is the least that anybody means.
Share = Annotated[float, Field(ge=1e-3, le=1.0)]
# Ends of a range of any number of a task; each has a domain of its own, such as moduli of up to 1e12 Pa.
RangeEnd = Annotated[float, Field(ge=-1e13, le=1e13)]
# Masses on a robot's tool.
Mass = Annotated[float, Field(ge=0.0, le=1000.0)]
LEAST_DOSE, LARGEST_DOSE = 1.0, 60.0
"""Masses [g] that are dosed."""
Axis = Literal["x", "y", "z"]
"""Of a tool's frame; x of the bundled tools points to the tip."""
# Colours are shares of full intensity.
Intensity = Annotated[float, Field(ge=0.0, le=1.0)]
# Names stand in tables and messages, texts on a page; Linux takes paths of up to 4096 characters.
Name = Annotated[str, Field(max_length=100)]
Text = Annotated[str, Field(max_length=2000)]
FilePath = Annotated[str, Field(max_length=4096)]

MAX_GRAINS = 4_000_000
"""Grains of a scene: with 250 bytes each, 1 GB; a hundred times the bundled scenes."""
MAX_NODES = 100_000_000
"""Nodes of a scene's grid: with 16 bytes each, 1.6 GB; a hundred times the bundled scenes."""
MAX_ENTRIES = 200
"""Waypoints of a path, or entries of another list that a person writes."""
MAX_STEPS = 300_000
"""Steps of a run of which each is recorded: with 2.5 kB each, 0.75 GB; 5 minutes at 1 ms."""
MAX_SUBSTEPS = 10_000
"""Substeps of a step; at 1 ms each, 10 s of computing for a step. A softer material allows longer ones."""
Count = Annotated[int, Field(ge=1, le=MAX_GRAINS)]


class Within(NamedTuple):
    """Bounds and unit of a `Quantity`: `E: Annotated[Quantity, Within(1e2, 1e12, "Pa")]`."""

    least: float
    most: float
    unit: str

    def check(self, value: float) -> None:
        """Raise ValueError for a value outside the bounds."""
        if not self.least <= value <= self.most:
            raise ValueError(f"value = {value:g}; accepted: {self.least:g} to {self.most:g}")

    def _checked(self, quantity: Any) -> Any:
        self.check(quantity.value)
        if quantity.unit != self.unit:
            raise ValueError(f"unit {quantity.unit!r}; accepted: {self.unit!r}")
        return quantity

    def __get_pydantic_core_schema__(self, source: Any, handler: pydantic.GetCoreSchemaHandler) -> Any:
        return pydantic.AfterValidator(self._checked).__get_pydantic_core_schema__(source, handler)

    def __get_pydantic_json_schema__(self, schema: Any, handler: pydantic.GetJsonSchemaHandler) -> dict[str, Any]:
        return {**handler(schema), "minimum": self.least, "maximum": self.most}

SAMPLES_PER_PERIOD = 8
"""Fewest steps in a period of a vibration: the tool moves in straight lines between them."""
