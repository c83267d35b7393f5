"""Configuration of a hand: where its model is, and the commands that open and close it."""

from typing import Annotated

from pydantic import Field, model_validator

from robosim.config.bounds import FilePath, Length, Name, Text
from robosim.config.table import Table

Command = Annotated[float, Field(ge=-1e4, le=1e4)]
"""Of an actuator, in its own unit."""
Commands = Annotated[dict[Name, Command], Field(min_length=1, max_length=32)]


class GripperConfig(Table):
    """A hand. Actuators without a command keep zero."""

    description: Text = ""
    model: FilePath
    """MJCF or URDF; a path is relative to the file that it stands in."""
    grip: Name
    """Site in the middle of a closed grasp: z along the handle towards the tool's head, y along the approach."""
    open: Commands
    """Actuator -> command with which the hand is open."""
    closed: Commands
    """Actuator -> command that presses on a handle."""
    squeeze: Annotated[float, Field(gt=0.0, le=1.0)] | None = None
    """Largest command beyond the fingers' present place, as a share of the way from open to closed; for actuators
    whose limits allow too much force. null: the actuators' limits are the bound."""
    opening: Length | None = None
    """Between open fingers [m]; a thicker tool is refused."""

    @model_validator(mode="after")
    def _check_commands(self) -> "GripperConfig":
        if set(self.open) != set(self.closed):
            raise ValueError(f"open has commands for {', '.join(sorted(self.open))}, closed for "
                             f"{', '.join(sorted(self.closed))}; accepted: the same actuators")
        return self
