"""Measured data and laws of others, which cases compare with: files of configs/references."""

from functools import cache
from typing import Any

from robosim.base.errors import ConfigError
from robosim.base.input_files import check_form
from robosim.base.resources import folder
from robosim.config.table import read

FORMS: dict[str, Any] = {
    "resistive_force_2d": {"terms": [str], "media": {str: [float]}, "bulk_density": {str: float}},
    "resistive_force_3d": {"f1": [float], "f2": [float], "f3": [float],
                           "doubtful": [{"function": str, "term": int, "value": float}], "scale": [float]},
    "impact": {"prefactor": float, "exponents": {"density": float, "diameter": float, "drop": float}},
    "round_plates": {"density": float, "repose_deg": float, "rows": [[float]]},
    "drum_of_beads": {"radius": float, "turns_per_minute": float, "fill": float, "grain_diameter": float,
                      "grain_density": float, "slope_deg": float, "rows": [[float]]},
    "drum_of_powder": {"radius": float, "width": float, "fill": float, "density": float, "rows": [[float]]},
    "lifted_columns": {"radius": float, "height": float,
                       "fluids": {str: {"density": float, "viscosity": float, "gravity": float}},
                       "water": [[float]], "glycerol": [[float]]},
    "slot_of_beads": {"slot": float, "silo": float, "depth": float, "mass": float, "grain_diameter": float,
                      "grain_density": float, "contact_friction": float, "rows": [[float]]},
    "gate": {"length": float, "height": float, "lift_speed": float, "rows": [[float]]},
    "lifted_can": {"slopes_deg": {str: float}},
}
"""What each file has besides source and uncertainty."""


@cache
def read_reference(name: str) -> dict[str, Any]:
    """Read a file of configs/references. Raises ConfigError for one that holds anything else than it should."""
    path = folder("configs") / "references" / f"{name}.yaml"
    content: Any = read(path)
    try:
        check_form(content, {"source": str, "uncertainty": float, "uncertainty_note": str, **FORMS[name]})
    except ValueError as error:
        raise ConfigError(f"{path}: {error}") from None
    return content


def stated(name: str) -> str:
    """Return the source of a file, and the file, as a case states it."""
    return f"{read_reference(name)['source']}; configs/references/{name}.yaml"
