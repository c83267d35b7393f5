"""Figures of a dose, and the bound of its error."""

import numpy as np

from robosim.dosing.command import accepted_error
from robosim.rehearsal.dosing.stage import DosingStage


def accepted_range(target_g: float) -> tuple[float, float]:
    """Return the errors [kg] that are accepted for a target [g]: 2 % of it, or 0.3 g where that is more."""
    error = accepted_error(1e-3 * target_g)
    return -error, error


def dose_figures(stage: DosingStage, mass: float, grain_mass: float) -> dict[str, object]:
    """Return the figures of a dose.

    mass: in the cup at the end of the rehearsal, less the tare [kg]. grain_mass: of a material point [kg], below which
    no error means anything.
    """
    shown, masses, tilts = (stage.stack(name) for name in ("shown", "mass", "tilt"))
    seconds = None if stage.begin is None or stage.done is None else stage.done - stage.begin
    return {
        "dose_target_kg": stage.target, "dose_kg": mass, "dose_error_kg": mass - stage.target,
        "dose_relative_error_ratio": (mass - stage.target) / stage.target,
        "dose_overshoot_kg": max(float(max(masses.max(initial=0.0), mass)) - stage.target, 0.0),
        "dose_shown_kg": float(shown[-1]) if len(shown) else None, "dose_grain_mass_kg": grain_mass,
        "dosing_time_s": seconds, "dosing_largest_tilt_deg": float(np.degrees(tilts.max(initial=0.0))),
        "dosing_timed_out": stage.is_late,
    }
