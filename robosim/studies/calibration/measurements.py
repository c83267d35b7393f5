"""The file of measurements: which experiments were made, their data and geometry, and which numbers are sought."""

from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

from pydantic import Field

from mpm.files import quote
from robosim.base.errors import ConfigError, UnknownName
from robosim.config.bounds import FilePath, Friction, Length, Name, RangeEnd, Speed, Text
from robosim.config.materials import MaterialConfig, load_material, number_names, overridden
from robosim.config.settings import Setting, with_settings
from robosim.config.table import Table, read, validate

WALL_FRICTION = "wall_friction"
"""Number that may be sought besides those of the law: friction coefficient of the material on floors and walls."""
MAX_SOUGHT, MAX_EXPERIMENTS = 5, 12
"""Numbers that are sought at a time: each doubles the runs that their emulator needs, and few data tell more."""

# Noise is a standard deviation: below it a reading would be exact, and a single one would outweigh all others.
HeightNoise = Annotated[float, Field(ge=1e-6, le=0.1)]
AngleNoise = Annotated[float, Field(ge=1e-3, le=30.0)]
StressNoise = Annotated[float, Field(ge=1e-3, le=1e6)]
MassNoise = Annotated[float, Field(ge=1e-7, le=10.0)]
Mass = Annotated[float, Field(ge=1e-6, le=1000.0)]
Stress = Annotated[float, Field(ge=0.0, le=1e6)]
TiltAngle = Annotated[float, Field(gt=0.0, lt=90.0)]
CupVolume = Annotated[float, Field(ge=1e-7, le=1.0)]  # 0.1 ml to a cubic metre
Pixel = Annotated[float, Field(ge=-1e5, le=1e5)]  # maps have up to 4 million pixels
Cells = Annotated[int, Field(ge=4, le=32)]


class Experiment(Table):
    """What every experiment has."""

    held_out: bool = False
    """Whether it is kept from the fit, and predicted afterwards as a check."""
    READS: ClassVar[str] = "masses"
    """Key of what an experiment with a closed form read, in SI units and degrees."""


class HeapExperiment(Experiment):
    """A heap that a round column left: its height map, or a profile through its axis."""

    kind: Literal["heap"]
    """A heap."""
    data: FilePath
    """Height map (.npy, .png) or profile (.csv with columns r and z), relative to this file."""
    unit: Literal["m", "cm", "mm"]
    """Of the heights, and of a profile's r."""
    scale: Length | None = None
    """Edge of a pixel [m]; required for height maps."""
    height_per_level: Annotated[float, Field(gt=0.0, le=100.0)] | None = None
    """Height of a grey level of a .png, in `unit`; required there."""
    centre: tuple[Pixel, Pixel] | None = None
    """Axis of the column in the map, row and column [pixels]; of a profile, (r, 0) in `unit`. Default: the heap's
    centroid; of a profile, r = 0."""
    noise: HeightNoise
    """Standard deviation of a height [m]."""
    model_error: Annotated[float, Field(ge=0.0, le=0.1)] | None = None
    """Standard deviation of the simulation's own error [m]. Default: a quarter of a cell."""
    radius: Length
    """Of the column [m]."""
    height: Length
    """Of the column before its release [m]."""
    floor_friction: Friction | None = None
    """Friction coefficient of floor and cylinder. Default: `wall_friction`, which is then sought."""
    lift_speed: Speed | None = None
    """Of the cylinder that is lifted [m/s]. Default: it is removed at once."""
    cells: Cells = 8
    """Cells of the grid on the column's radius."""


class PourExperiment(Experiment):
    """Mass that leaves a box over time while it is tilted about its lip."""

    kind: Literal["pour"]
    """A box that is tilted."""
    data: FilePath
    """Mass over time (.csv with columns t [s] and m), relative to this file."""
    unit: Literal["kg", "g"]
    """Of the masses."""
    noise: MassNoise
    """Standard deviation of a mass [kg]."""
    model_error: Annotated[float, Field(ge=0.0, le=10.0)] | None = None
    """Standard deviation of the simulation's own error [kg]. Default: a hundredth of the mass in the box."""
    length: Length
    """Of the box inside, from its back to its lip [m]."""
    depth: Length
    """Of the box, from its floor to its lip [m]."""
    width: Length
    """Of the box inside, along the lip [m]."""
    fill_height: Length
    """Of the material before the box is tilted [m]."""
    tilt_speed: Annotated[float, Field(ge=1.0, le=360.0)]
    """[deg/s]"""
    end_angle: Annotated[float, Field(ge=1.0, le=150.0)]
    """At which the box stops [deg]."""
    wall_friction: Friction | None = None
    """Friction coefficient of the box. Default: `wall_friction`, which is then sought."""
    cells: Cells = 10
    """Cells of the grid on the fill's height."""


class TiltExperiment(Experiment):
    """Angles at which a layer on a tilted tray begins to slide: within itself, or on its tray."""

    READS = "angles"
    kind: Literal["tilt"]
    """A tilted tray."""
    angles: Annotated[list[TiltAngle], Field(min_length=1, max_length=200)]
    """[deg]"""
    noise: AngleNoise
    """Standard deviation of an angle [deg]."""
    depth: Length
    """Of the layer [m]."""
    slides_on: Literal["itself", "wall"] = "itself"
    """A rough tray, on which the layer fails within itself, or the wall's surface."""


class ShearExperiment(Experiment):
    """Shear stresses of a shear cell in steady flow, at normal stresses."""

    READS = "shear_stress"
    kind: Literal["shear"]
    """A shear cell."""
    normal_stress: Annotated[list[Stress], Field(min_length=1, max_length=200)]
    """[Pa]"""
    shear_stress: Annotated[list[Stress], Field(min_length=1, max_length=200)]
    """[Pa], one for each normal stress."""
    noise: StressNoise
    """Standard deviation of a shear stress [Pa]."""

    def check(self) -> None:
        if len(self.normal_stress) != len(self.shear_stress):
            raise ValueError(f"{len(self.normal_stress)} values of normal_stress, {len(self.shear_stress)} of "
                             f"shear_stress; accepted: one for each")


class CupExperiment(Experiment):
    """Masses of a cup that is filled loosely and struck off."""

    kind: Literal["cup"]
    """A cup."""
    masses: Annotated[list[Mass], Field(min_length=1, max_length=200)]
    """Without the cup [kg]."""
    noise: MassNoise
    """Standard deviation of a mass, filling included [kg]."""
    volume: CupVolume
    """Of the cup [m^3]."""


class ScoopExperiment(Experiment):
    """Masses of a round scoop heaped as high as it stands."""

    kind: Literal["scoop"]
    """A heaped scoop."""
    masses: Annotated[list[Mass], Field(min_length=1, max_length=200)]
    """Without the scoop [kg]."""
    noise: MassNoise
    """Standard deviation of a mass, filling included [kg]."""
    model_error: Annotated[float, Field(ge=0.0, le=10.0)] | None = None
    """Standard deviation of the closed form's own error [kg], common to all masses. Default: a fifth of the mass above
    the rim with the card's numbers (assumed)."""
    volume: CupVolume
    """Of the scoop up to its rim [m^3]."""
    rim_radius: Length
    """Of the round rim, held level [m]."""


EXPERIMENTS: dict[str, type[Experiment]] = {"heap": HeapExperiment, "pour": PourExperiment, "tilt": TiltExperiment,
                                            "shear": ShearExperiment, "cup": CupExperiment, "scoop": ScoopExperiment}
"""Kind -> table of its keys."""


class MeasurementsConfig(Table):
    """Measurements of a material, and the numbers sought."""

    description: Text
    """What was measured, where and when; the card's description."""
    material: FilePath
    """Name or path of the card that all numbers not sought come from, and the law."""
    sought: Annotated[dict[Name, tuple[RangeEnd, RangeEnd]], Field(min_length=1, max_length=MAX_SOUGHT)]
    """Number -> least and largest value that it can have; angles as `friction_angle_deg`. `wall_friction` may be sought
    too."""
    experiments: Annotated[dict[Name, dict[str, Any]], Field(min_length=1, max_length=MAX_EXPERIMENTS)]
    """Name -> an experiment: its `kind` (heap, pour, tilt, shear, cup, scoop), its data and geometry; see `robosim keys
    experiment.KIND`."""

    candidates: Annotated[dict[Name, dict[str, Any]], Field(max_length=MAX_EXPERIMENTS)] | None = None
    """Name -> a heap or a pour that could be made: as an experiment, without `data`. The page says how much each would
    narrow the numbers."""


class Measurements(NamedTuple):
    """A file of measurements, checked: the card, and the experiments by name, also those that could be made."""

    config: MeasurementsConfig
    card: MaterialConfig
    experiments: dict[str, Experiment]
    candidates: dict[str, Experiment]

    def changed_card(self, numbers: dict[str, float]) -> MaterialConfig:
        """Return the card with numbers of its law replaced."""
        return overridden(self.card, {name: value for name, value in numbers.items() if name != WALL_FRICTION})


def load_measurements(path: Path, settings: tuple[Setting, ...] = ()) -> Measurements:
    """Read a file of measurements; raises ConfigError with file, key, value and what is accepted."""
    data = read(path)
    if not isinstance(data, dict):
        raise ConfigError(f"{path}: holds {type(data).__name__}; accepted: a table of "
                          f"{', '.join(MeasurementsConfig.model_fields)}")
    config = validate(with_settings(data, settings), path, MeasurementsConfig)
    name = config.material
    card = load_material(str((path.parent / name).resolve()) if name.endswith((".yaml", ".yml")) else name)
    check_sought(path, config, card)
    experiments = {name: read_experiment(path, name, table) for name, table in config.experiments.items()}
    candidates = {name: read_candidate(path, name, table) for name, table in (config.candidates or {}).items()}
    check_friction(path, config, experiments | candidates)
    if all(one.held_out for one in experiments.values()):
        raise ConfigError(f"{path}: experiments: all are held out; accepted: at least one that the fit may use")
    return Measurements(config, card, experiments, candidates)


def read_candidate(path: Path, name: str, table: dict[str, Any]) -> Experiment:
    """Validate the table of an experiment that could be made."""
    if table.get("kind") not in ("heap", "pour") or "data" in table:
        raise ConfigError(f"{path}: candidates.{name}: kind = {quote(table.get('kind'))}"
                          f"{' with data' if 'data' in table else ''}; accepted: heap or pour, without data")
    return read_experiment(path, name, {"unit": "m" if table["kind"] == "heap" else "kg", **table, "data": "none"},
                           "candidates")


def read_experiment(path: Path, name: str, table: dict[str, Any], key: str = "experiments") -> Experiment:
    """Validate an experiment's table, with its file's path made absolute."""
    kind, data = table.get("kind"), table.get("data")
    if not isinstance(kind, str) or kind not in EXPERIMENTS:
        raise ConfigError(f"{path}: {key}.{name}.kind = {quote(kind)}; accepted: {', '.join(EXPERIMENTS)}")
    located = {**table, "data": str((path.parent / data).resolve())} if isinstance(data, str) else table
    return validate(located, Path(f"{path}: {key}.{name}"), EXPERIMENTS[kind])


def check_sought(path: Path, config: MeasurementsConfig, card: MaterialConfig) -> None:
    """Raise ConfigError for a number that the law does not have, and for a range that is empty or not accepted."""
    known = list(number_names(card))
    if WALL_FRICTION in type(card).model_fields:
        known += [WALL_FRICTION] if WALL_FRICTION not in known else []
    elif WALL_FRICTION in config.sought:
        raise ConfigError(f"{path}: sought.{WALL_FRICTION}: a card of material {quote(config.material)} has no "
                          f"{WALL_FRICTION}; accepted: {', '.join(known)}; a heap takes floor_friction, a pour "
                          f"wall_friction")
    for name, (least, most) in config.sought.items():
        if name not in known:
            raise UnknownName(f"number in {path}: sought", name, known)
        is_wall = name == WALL_FRICTION
        if not least < most or (is_wall and not 0.0 <= least < most <= 10.0):
            raise ConfigError(f"{path}: sought.{name} = [{least:g}, {most:g}]; accepted: "
                              + ("within 0 to 10" if least < most else "the least value, then a larger one"))
        for value in () if is_wall else (least, most):
            overridden(card, {name: value}, f"{path}: sought:")


def check_friction(path: Path, config: MeasurementsConfig, experiments: dict[str, Experiment]) -> None:
    """Raise ConfigError where an experiment needs the wall's friction and none is given or sought."""
    for name, one in experiments.items():
        key = {"heap": "floor_friction", "pour": "wall_friction"}.get(getattr(one, "kind", ""), "")
        on_wall = isinstance(one, TiltExperiment) and one.slides_on == "wall"
        if WALL_FRICTION not in config.sought and (on_wall or (key and getattr(one, key) is None)):
            raise ConfigError(f"{path}: experiments.{name}: needs the friction of the wall; accepted: "
                              + (f"{key}: VALUE, or " if key else "") + "wall_friction among `sought`")
