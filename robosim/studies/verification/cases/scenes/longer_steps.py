"""Rehearsals whose grains advance by longer or shorter times at once, against the same on finer cells."""

from typing import Any

from robosim.config.rehearsal import load_rehearsal
from robosim.studies.benchmarks.scene_run import run_rehearsal
from robosim.studies.verification.cases.case import Cost, Record, case, grid, make_record
from robosim.studies.verification.cases.expectations import Within

FINER = 0.75
"""Cells of the reference, in those of the run."""


@case(
    source="the same rehearsal with cells of three quarters, which advances by 1 ms",
    sweep=[*grid(scene=("spoon", "scoop"), step=(1e-3, 2e-3)), {"scene": "spoon", "step": 5e-4}],
    quick=[{"step": 2e-3, "coarser": 2.0}],
    # mass that the tool lifts, of which 0.5 ms leave 8 % less; and as the wrist weighs it
    expectations=(*(Within("mass", 0.05, {"coarser": 1.0, "step": step}) for step in (1e-3, 2e-3)),
                  Within("mass", 0.15), Within("weighed", 0.03)),
    main_error="mass", resolution="step")
def longer_steps(*, scene: str = "spoon", step: float = 1e-3, coarser: float = 1.0) -> Record:
    """Rehearsals whose grains and arm advance by longer times: fewer transfers and less to couple, for less run time.

    scene: a rehearsal of configs/rehearsals. step: its host_dt [s], of which the grains' substep is a part: a third of
    1 ms and a sixth of 2 ms in the spoon, half of 0.5 ms. coarser: factor on the scene's own cells. The error "mass" is
    relative, of what the tool lifts; that at the start differs from seed to seed by 1 %."""
    own = load_rehearsal(scene).host_dt

    def run(step: float, coarser: float) -> dict[str, Any]:
        return run_rehearsal(scene, {"host_dt": step / own, "cell": coarser})

    finer, result = run(1e-3, FINER * coarser), run(step, coarser)
    mass, weighed = (result["readings"][name] for name in ("scooped_mass_kg", "wrist_payload_kg"))
    cost = Cost(result["grains"], round(result["simulated_s"] / result["dt_s"]), result["seconds"])
    errors = {"mass": mass / finer["readings"]["scooped_mass_kg"] - 1.0, "weighed": weighed / mass - 1.0}
    return make_record([cost], errors, seconds_finer=finer["seconds"], simulated=result["simulated_s"],
                       delivered=result["readings"]["delivered"])
