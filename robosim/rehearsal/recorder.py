"""The recording of a rehearsal: what the viewer plays, and its page shows."""

from pathlib import Path

import numpy as np

from robosim.base.provenance import commit
from robosim.config.rehearsal import RehearsalConfig
from robosim.episode.sheet import LOAD
from robosim.recordings.frames import GrainState
from robosim.recordings.header import CurveEntry, RegionEntry, WaypointEntry, find_placed, floats, region_entry
from robosim.recordings.scene_recorder import FRAME_RATE, SceneRecorder
from robosim.rehearsal.mass_balance import GRAVITY
from robosim.rehearsal.readings import Steps
from robosim.rehearsal.run import DOSE, RehearsalRun
from robosim.scene.grains import container_region, grain_volume_of, is_in_tool
from robosim.shapes import tool_shape

FORCES = ("Fx", "Fy", "Fz")
PATH_POINTS = 500
"""Points of the commanded path."""
CURVES = [
    CurveEntry(name=LOAD, unit="g", chart="mass"),
    CurveEntry(name="outside of tool and places", unit="g", chart="mass"),
    *(CurveEntry(name=name, unit="N", chart="force of the grains on the tool") for name in FORCES),
    *(CurveEntry(name=f"wrist {name}", unit="N", chart="wrist force, without hand and tool") for name in FORCES),
    CurveEntry(name="tool's distance from its command", unit="mm", chart="tracking"),
    CurveEntry(name="largest joint torque", unit="% of its limit", chart="joints"),
    CurveEntry(name="largest joint speed", unit="% of its limit", chart="joints"),
    CurveEntry(name="awake", unit="%", chart="grains that are computed"),
]
"""What every frame has a value of, in this order."""
DOSE_CURVES = [CurveEntry(name=name, unit="g", chart="dose") for name in ("in the cup", "the balance shows", "target")]
"""The same of a rehearsal with a dose, after those; none before it has begun."""


def make_recorder(run: RehearsalRun, path: Path, frame_rate: float = FRAME_RATE) -> SceneRecorder:
    """Open the recording of a run."""
    config, motion_path = run.config, run.plan.path
    times = np.linspace(0.0, motion_path.duration, PATH_POINTS)
    commanded = np.array([motion_path.pose(t).position for t in times])
    return SceneRecorder(
        path, run.cell.model, run.cell.data, run.solver, kind="rehearsal",
        title=f"{config.description}: {config.material}",
        caption=config.material, curves=CURVES + (DOSE_CURVES if run.dosing else []), frame_rate=frame_rate,
        grain_volume=grain_volume_of(run.solver), colour=run.material.colour, tool=config.tool_name,
        hand=run.cell.model.body(run.cell.scene.wrist).name, paths={"commanded": commanded},
        regions=list(counting_regions(config)), waypoints=list_waypoints(run, run.passages()), commit=commit())


def finish_recording(run: RehearsalRun, recorder: SceneRecorder) -> None:
    """Add the waypoints after a dose, if it came to its end, and close the recording. May be called twice."""
    try:
        dosing = run.dosing
        if dosing is not None and dosing.delay > 0.0 and not recorder.writer.is_closed:
            late = [(time, name) for time, name in run.passages() if time > dosing.due]
            recorder.writer.add_waypoints(list_waypoints(run, late))
    finally:
        recorder.close()


def list_waypoints(run: RehearsalRun, passages: list[tuple[float, str]]) -> list[WaypointEntry]:
    """Return the entries of waypoints at times [s]."""
    path, places = run.plan.path, {DOSE: run.config.dose_at}
    return [WaypointEntry(name=name, time=time, position=floats(path.pose(path.times[places.get(name, name)]).position))
            for time, name in passages]


def counting_regions(config: RehearsalConfig) -> list[RegionEntry]:
    """Return where grains may be at the end: containers, the area, and the tool; and the pile of the start."""
    entries = [region_entry(name, *container_region(name, container)) for name, container in config.containers.items()]
    if config.area is not None:
        entries.append(region_entry("area", config.area.region, is_marked=True))
    if config.pile is not None:
        entries.append(region_entry("pile", config.pile.region))
    return [*entries, region_entry(config.tool_name, tool_shape(config.tool).interior, body=config.tool_name)]


class RunReadings:
    """The values of `CURVES` of a run, as they are at its last step."""

    def __init__(self, run: RehearsalRun) -> None:
        self._run, self._regions = run, counting_regions(run.config)
        self._limits = run.plan.arm.velocity, run.plan.arm.torque_limits
        self._grain_masses, self._new = run.solver.masses(), run.readings.collect()
        """Steps since the values before: forces are means over them."""

    def __call__(self, grains: GrainState) -> list[float]:
        """Return the values (curves,)."""
        steps = self._run.readings.collect()
        new = self._new = steps if len(steps.time) else self._new
        speeds, torques = self._limits
        return [*self._masses(grains.positions), *new.tool_force.mean(axis=0), *self._wrist(new),
                1e3 * float(np.linalg.norm(new.commanded[-1, :3] - new.reached[-1, :3])),
                100.0 * float(np.abs(new.torque / torques).max()), 100.0 * float(np.abs(new.qd / speeds).max()),
                100.0 * float(grains.awake.mean()), *self._dose()]

    def _dose(self) -> list[float]:
        """Masses [g] in the cup, on the balance's display, and wanted, as of its last reading; empty without a dose."""
        dosing = self._run.dosing
        if dosing is None:
            return []
        if not dosing.samples:
            return [np.nan] * 3
        last = dosing.samples[-1]
        return [1e3 * last.mass, 1e3 * last.shown, 1e3 * dosing.target]

    def _masses(self, positions: np.ndarray) -> tuple[float, float]:
        """Masses [g] in the tool, not a number while it digs, and outside of all places."""
        run, config = self._run, self._run.config
        pose, masses = run.cell.tool_pose(), self._grain_masses
        held = is_in_tool(config.tool, positions, pose)
        outside = masses[~find_placed(self._regions, {config.tool_name: pose}, positions)].sum()
        return (np.nan if run.digs(positions, held) else 1e3 * float(masses[held].sum())), 1e3 * float(outside)

    def _wrist(self, steps: Steps) -> np.ndarray:
        """Force (3,) [N] at the wrist, world axes, without the weight of hand and tool."""
        force = steps.wrist[:, :3].mean(axis=0)
        weight = GRAVITY * self._run.cell.scene.wrist_mass()
        return force - [0.0, 0.0, np.copysign(weight, force[2])]
