"""The base of all configuration tables, and the types that they share."""

from typing import Annotated, ClassVar

from pydantic import BaseModel, ConfigDict, Field, PositiveFloat

Vector3 = tuple[float, float, float]
Vector7 = Annotated[tuple[PositiveFloat, ...], Field(min_length=7, max_length=7)]
"""A value for each joint of the arm."""


class Table(BaseModel):
    """A table of a configuration file: frozen, typed, checked once, before any work."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True)

    RENAMED: ClassVar[dict[str, str]] = {}
    """Key of an earlier version -> the key that replaces it; errors name it."""


class Quantity(Table):
    """A number with its unit and its source."""

    value: float
    """The number itself, in this unit."""
    unit: str
    """The unit that the material's law takes: kg/m^3, Pa, Pa s, deg or 1."""
    source: str
    """Literature, or "assumed: ..." with the reason."""
