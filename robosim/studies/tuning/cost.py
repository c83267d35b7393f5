"""What an episode of a dosing task costs a search, and the figures of a set of episodes."""

from collections.abc import Sequence
from typing import Any

import numpy as np

WORST = 5.0
"""Largest cost of an error: a dose that is five times out of bounds is as bad as none."""
TIME_WEIGHT = 0.5
"""Cost of a dose that takes all of the time."""


def episode_cost(row: dict[str, Any], duration: float) -> float:
    """Return the cost of an episode: error and spilled mass in accepted errors, and a part for its time.

    row: of `robosim.studies.tuning.trial`. duration: longest time of a dose [s].
    """
    if row["diverged"]:
        return 2.0 * WORST + TIME_WEIGHT
    accepted = row["accepted_error"]
    error, spilled = (min(abs(row[name]) / accepted, WORST) if accepted > 0.0 else WORST * (row[name] != 0.0)
                      for name in ("dose_error", "spilled"))
    return error + spilled + TIME_WEIGHT * min(1.0, row["seconds"] / duration)


def summarize_doses(rows: Sequence[dict[str, Any]], duration: float) -> dict[str, float]:
    """Return cost, success rate, mean and standard deviation of the error [g], mean time [s] and spilled mass [g]."""
    errors = np.array([row["dose_error"] for row in rows]) * 1e3
    return {"cost": float(np.mean([episode_cost(row, duration) for row in rows])),
            "success_rate": float(np.mean([row["is_success"] for row in rows])),
            "error_g": float(errors.mean()), "error_g_std": float(errors.std()),
            "error_g_abs": float(np.abs(errors).mean()),
            "seconds": float(np.mean([row["seconds"] for row in rows])),
            "spilled_g": 1e3 * float(np.mean([row["spilled"] for row in rows]))}
