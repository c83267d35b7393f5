"""Materials: configurations with unit and source of every number, and the laws that they stand for."""

from typing import Annotated, Any, ClassVar, Literal

import mpm
from mpm.materials.material import Material as Law
from robosim.base.errors import ConfigError, UnknownName
from robosim.base.resources import config_path
from robosim.config.bounds import Intensity, Text, Within
from robosim.config.laws import MATERIAL_CLASSES
from robosim.config.table import Quantity, Table, load, read

__all__ = ["Law", "MaterialConfig", "grain_diameter_of", "load_material", "overridden"]


class MaterialConfig(Table):
    """Base of all materials: numbers with unit and source, and the law that they are of."""

    description: Text
    """What it is."""
    density: Annotated[Quantity, Within(1.0, 25_000.0, "kg/m^3")]  # aerogel to osmium
    """Bulk density [kg/m^3]."""
    colour: tuple[Intensity, Intensity, Intensity, Intensity] = (0.95, 0.95, 0.93, 1.0)
    """Red, green, blue and opacity, 0 to 1."""

    LAW: ClassVar[str]
    """Name of the law in `mpm`."""

    def make_law(self) -> Law:
        """Return the law of the material."""
        return getattr(mpm, self.LAW)(**self.law_numbers())

    def law_numbers(self) -> dict[str, Any]:
        """Return the arguments of the law that are numbers, angles with their unit (`friction_angle_deg`)."""
        return {name: getattr(self, key).value for name, key in number_names(self).items()}

    @classmethod
    def numbers(cls) -> list[str]:
        """Names of the material's numbers."""
        return [name for name, field in cls.model_fields.items() if field.annotation is Quantity]

    def values(self) -> dict[str, float | bool]:
        """Key of each number and switch of the law -> its value."""
        switches = [name for name, field in type(self).model_fields.items() if field.annotation is bool]
        return {name: getattr(self, name).value for name in self.numbers()} | {n: getattr(self, n) for n in switches}


class GranularConfig(MaterialConfig):
    """Grains: Drucker-Prager."""

    LAW = "DruckerPrager"
    law: Literal["granular"]
    """Drucker-Prager."""
    E: Annotated[Quantity, Within(1e2, 1e12, "Pa")]  # a heap of 1 cm weighs 1e2 Pa; diamond has 1.1e12 Pa
    """Young's modulus [Pa]."""
    nu: Annotated[Quantity, Within(0.0, 0.49, "1")]  # the wave speed grows without bound towards 0.5
    """Poisson's ratio."""
    friction_angle: Annotated[Quantity, Within(0.0, 89.0, "deg")]  # the cone of 90 deg is no cone any more
    """Internal friction angle [deg]."""
    cohesion: Annotated[Quantity, Within(0.0, 1e9, "Pa")]  # concrete has 1e7 Pa
    """Cohesion [Pa]."""
    tensile_strength: Annotated[Quantity, Within(0.0, 1e9, "Pa")] | None = None  # as the cohesion
    """Largest mean tension [Pa] that is carried, at most cohesion / tan(friction_angle); null: none."""
    grain_diameter: Annotated[Quantity, Within(1e-7, 0.1, "m")] | None = None  # the finest powder to coarse gravel
    """Diameter of a grain [m], by which small holes let grains pass; null: tools with such holes refuse it."""
    wall_friction: Annotated[Quantity, Within(0.0, 10.0, "1")] | None = None  # dry pairs have up to 1.5 (rubber)
    """Friction coefficient on a wall, which the source names; for information: scenes say that of each wall."""
    repose_angle: Annotated[Quantity, Within(0.0, 90.0, "deg")] | None = None
    """Slope of a poured heap [deg]; for information: in a simulation it follows from the other numbers."""

    def law_numbers(self) -> dict[str, Any]:
        """Return the arguments of the law."""
        given = {} if self.tensile_strength is None else {"tensile_strength": self.tensile_strength.value}
        return super().law_numbers() | given


class MuIConfig(GranularConfig):
    """Grains whose friction grows with the rate of shear: the mu(I) rheology."""

    LAW = "MuIRheology"
    law: Literal["mu_i"]  # type: ignore[assignment]  # the base's law is another one
    """mu(I) rheology."""
    limit_angle: Annotated[Quantity, Within(0.0, 89.0, "deg")]  # as the friction angle
    """Friction angle at infinite rate [deg], not below `friction_angle`."""
    grain_diameter: Annotated[Quantity, Within(1e-7, 0.1, "m")]  # type: ignore[assignment]  # as of granular materials
    """Diameter of a grain [m]."""
    grain_density: Annotated[Quantity, Within(1.0, 25_000.0, "kg/m^3")]  # aerogel to osmium
    """Density of a grain itself [kg/m^3]."""
    inertial_number: Annotated[Quantity, Within(1e-3, 1e3, "1")]  # published ones are 0.1 to 1
    """Inertial number at which friction is half way."""

    def check(self) -> None:
        """Raise ValueError where the limit angle is below the friction angle, or that is not above 0."""
        low, high = self.friction_angle.value, self.limit_angle.value
        if not 0.0 < low <= high:
            raise ValueError(f"friction_angle = {low:g} deg, limit_angle = {high:g} deg; accepted: 0 < friction_angle "
                             f"<= limit_angle")


class FluidConfig(MaterialConfig):
    """A Newtonian fluid."""

    LAW = "NewtonianFluid"
    law: Literal["fluid"]
    """Newtonian fluid."""
    bulk_modulus: Annotated[Quantity, Within(1e2, 1e12, "Pa")]  # 1 cm of water on 1e2 Pa; diamond has 4e11 Pa
    """Bulk modulus [Pa]."""
    viscosity: Annotated[Quantity, Within(0.0, 1e6, "Pa s")]  # glass at its working point has 1e3, pitch 1e8 Pa s
    """Dynamic viscosity [Pa s]."""
    tension: bool = True
    """Whether expanded fluid pulls; false: it has no pressure where its volume is larger than at first."""
    volume_rate: Literal["particle", "cell"] = "particle"
    """Rate of volume that a particle follows: its own, or the mean of its cell."""

    def law_numbers(self) -> dict[str, Any]:
        """Return the arguments of the law."""
        return super().law_numbers() | {"tension": self.tension, "volume_rate": self.volume_rate}


class ClayConfig(MaterialConfig):
    """Clay: von Mises."""

    LAW = "VonMises"
    law: Literal["clay"]
    """von Mises."""
    E: Annotated[Quantity, Within(1e2, 1e12, "Pa")]  # a heap of 1 cm weighs 1e2 Pa; diamond has 1.1e12 Pa
    """Young's modulus [Pa]."""
    nu: Annotated[Quantity, Within(0.0, 0.49, "1")]  # the wave speed grows without bound towards 0.5
    """Poisson's ratio."""
    yield_stress: Annotated[Quantity, Within(1e-3, 1e11, "Pa")]  # diamond has 1e11 Pa
    """Yield stress of von Mises [Pa]."""


KINDS: dict[str, type[MaterialConfig]] = {law: globals()[name] for law, name in MATERIAL_CLASSES.items()}
"""Key `law` of a file -> class."""


def load_material(name: str) -> MaterialConfig:
    """Load a material by name (configs/materials) or by path."""
    path = config_path("materials", name, "material")
    data = read(path)
    law = data.get("law") if isinstance(data, dict) else None
    if law not in KINDS:
        raise ConfigError(f"{path}: law = {law!r}; accepted: {', '.join(KINDS)}")
    return load(path, KINDS[law])


def number_names(config: MaterialConfig) -> dict[str, str]:
    """Return the keys of a material's numbers by their names, in which angles have their unit: `friction_angle_deg`."""
    return {f"{name}_deg" if getattr(config, name).unit == "deg" else name: name for name in config.numbers()}


def overridden(config: MaterialConfig, numbers: dict[str, float],
               what: str = "number of this material") -> MaterialConfig:
    """Return a material with some numbers changed; angles are named with their unit, `friction_angle_deg`."""
    known = number_names(config)
    changed = {}
    for name, value in numbers.items():
        if name not in known:
            raise UnknownName(what, name, known)
        for bounds in (one for one in type(config).model_fields[known[name]].metadata if isinstance(one, Within)):
            try:
                bounds.check(float(value))
            except ValueError as error:
                raise ConfigError(f"{what} {name}: {error}") from None
        quantity = getattr(config, known[name])
        changed[known[name]] = quantity.model_copy(update={"value": float(value), "source": "given by the user"})
    result = config.model_copy(update=changed)
    try:
        result.check()
    except ValueError as error:
        raise ConfigError(f"{what}: {error}") from None
    return result


def grain_diameter_of(config: MaterialConfig) -> float | None:
    """Return the diameter [m] of grains that small holes let pass by Beverloo's law.
    None for a material without that number, and for one with cohesion: its grains arch over a hole."""
    if not isinstance(config, GranularConfig) or config.grain_diameter is None or config.cohesion.value > 0.0:
        return None
    return config.grain_diameter.value
