"""Run time of the field over a scene's motion: grains awake, active blocks, and what each costs."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.optimize import nnls

import mpm

SAMPLED = 10
"""Advances from one count of grains and blocks to the next."""
LEAST_CALLS = 10
"""Advances of a stretch of the motion that is reported on its own."""


class FieldProfile:
    """Records the time of every advance; from time to time it counts what was computed."""

    def __init__(self, solver: mpm.Solver) -> None:
        self._solver, self._steps = solver, solver.steps
        self._rows: list[tuple[float, float, int, int, int]] = []
        """After each advance: simulated time [s], processor time [s], substeps, grains awake, active blocks."""
        self._counted: tuple[int, int] = 0, 0

    def record(self, seconds: float) -> None:
        """Add a row after an advance that took so much processor time [s]."""
        solver = self._solver
        if len(self._rows) % SAMPLED == 0:
            self._counted = int(np.count_nonzero(solver.awake)), int(solver.fields.grid.count.to_numpy())
        self._rows.append((solver.time, seconds, solver.steps - self._steps, *self._counted))
        self._steps = solver.steps

    def summarize(self, begins: Mapping[str, float]) -> list[dict[str, Any]]:
        """Return a row for each stretch of the motion, and last one with the costs that fit all of them best.
        begins: stretch -> simulated time [s] of its begin, in order. ns: a grain awake and substep, for all that the
        field does. The fit is run time a substep = a + b grains + c blocks, by least squares, none below 0."""
        times, seconds, substeps, awake, blocks = np.array(self._rows).T
        edges, rows = [*begins.values(), np.inf], []
        for name, begin, end in zip(begins, edges, edges[1:]):
            chosen = (times > begin) & (times <= end)
            if np.count_nonzero(chosen) >= LEAST_CALLS:
                n = substeps[chosen].sum()
                grains = float((awake * substeps)[chosen].sum())
                rows.append({"stretch": name, "begin_s": begin, "awake": grains / n,
                             "blocks": float((blocks * substeps)[chosen].sum() / n), "substeps": n / chosen.sum(),
                             "ms": 1e3 * seconds[chosen].mean(), "ns": 1e9 * seconds[chosen].sum() / max(grains, 1.0)})
        ones = np.ones_like(times)
        fit, _ = nnls(np.column_stack([ones, awake, blocks]) * substeps[:, None], seconds)
        return [*rows, {"substep_us": 1e6 * fit[0], "grain_ns": 1e9 * fit[1], "block_ns": 1e9 * fit[2]}]


def format_profile(rows: list[dict[str, Any]]) -> list[str]:
    """Format the rows of `FieldProfile.summarize` as lines for a terminal."""
    *stretches, fit = rows
    head = f"  {'from':>7} {'stretch':12} {'awake':>7} {'blocks':>7} {'substeps':>9} {'ms':>7} {'ns':>6}"
    return [
        "field, an advance (ns: a grain awake and substep):", head,
        *(f"  {row['begin_s']:5.2f} s {row['stretch']:12.12} {row['awake']:7.0f} {row['blocks']:7.0f} "
          f"{row['substeps']:9.1f} {row['ms']:7.3f} {row['ns']:6.0f}" for row in stretches),
        f"  least squares: {fit['grain_ns']:.0f} ns a grain + {1e-3 * fit['block_ns']:.2f} us a block + "
        f"{fit['substep_us']:.1f} us a substep"]
