"""Where the material is at the end of a rehearsal, and the load weighed at the wrist."""

import numpy as np

from robosim.rehearsal.run import RehearsalRun
from robosim.scene.grains import is_in_container

GRAVITY = 9.81
SETTLING_TIME = 0.1
"""Time [s] for the arm to come to rest before the load is weighed."""


def compute_ratio(value: float, reference: float) -> float | None:
    """Return value / reference; None where the reference is zero."""
    return float(value / reference) if reference > 0 else None


def compute_fractions(run: RehearsalRun, positions: np.ndarray) -> dict[str, float | None]:
    """Compute where the material is as fractions of the scooped mass; positions [m] (n, 3): of the grains at the end.
    delivered, returned and retained count the grains that were in the tool when it was weighed or, in a recorded motion
    of its own, held most; all grains where neither is asked. spilled counts every grain outside containers, area and
    tool, also those spilled while scooping.
    """
    mass, config = run.solver.masses(), run.config
    scooped = np.full(len(mass), config.weigh_at is None) if run.scooped is None else run.scooped
    inside = {name: is_in_container(positions, name, one) for name, one in config.containers.items()}
    delivered, returned = (np.logical_or.reduce([np.zeros(len(mass), bool), *(inside[name] for name in names)])
                           for names in (config.sinks, config.sources))
    if config.area:
        delivered = config.area.region.holds(positions)
    retained = run.is_held(positions)
    if config.pile is None:  # grains in a tool above area or container are not delivered yet; a shovel's are
        delivered &= ~retained
    retained &= ~delivered & ~returned
    spilled = ~(delivered | returned | retained)
    scooped_mass = mass[scooped].sum()
    regions = {"delivered_fraction": delivered, "returned_fraction": returned, "retained_fraction": retained}
    return {name: compute_ratio(mass[scooped & region].sum(), scooped_mass) for name, region in regions.items()} | {
        "spilled_fraction": compute_ratio(mass[spilled].sum(), scooped_mass)}


def compute_scooped_mass(run: RehearsalRun) -> float:
    """Compute the mass [kg] in the tool while it was weighed, or that of `RehearsalRun.scooped`. The whole mass where
    neither is there."""
    waypoint = run.config.weigh_at
    if waypoint is None:
        masses = run.solver.masses()
        return float(masses.sum() if run.scooped is None else masses[run.scooped].sum())
    begin, end = find_weighing_interval(run, waypoint)
    times = run.readings.stack_grains("time")
    selected = (times >= begin) & (times < end)
    return float(run.readings.stack_grains("mass_in_tool")[selected].mean()) if selected.any() else 0.0


def find_weighing_interval(run: RehearsalRun, waypoint: str) -> tuple[float, float]:
    """Find the first and last time [s] at which the load is at rest at a waypoint."""
    begin, end = run.plan.path.rests[waypoint]
    return begin + run.config.grasp_time + SETTLING_TIME, end + run.config.grasp_time


def weigh_at_wrist(run: RehearsalRun) -> float | None:
    """Weigh the load [kg] by the wrist's force, less hand and tool; None where nothing is weighed."""
    if run.config.weigh_at is None:
        return None
    begin, end = find_weighing_interval(run, run.config.weigh_at)
    times = run.readings.stack_steps("time")
    resting = (times >= begin) & (times < end)
    if not resting.any():
        return None
    # the sensor measures the child on the parent; at rest only the magnitude along gravity matters
    return float(abs(run.readings.stack_steps("wrist")[resting, 2].mean()) / GRAVITY - run.cell.scene.wrist_mass())
