"""Simulation of a planned rehearsal: robot and grains together, step by step."""

import time as clock
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from robosim.base.errors import ConfigError
from robosim.cell.cell import Cell
from robosim.cell.drivers import MotionDriver, OwnDriver, ReplayDriver, RobotState, plans_itself
from robosim.config.materials import MaterialConfig, load_material
from robosim.config.rehearsal import RehearsalConfig
from robosim.planning.lip_motion import dose_cup
from robosim.planning.picking import SETTLING
from robosim.planning.plan import Plan
from robosim.planning.waypoint_path import is_in_container as reaches_into
from robosim.rehearsal.comparison import WrenchComparison, compare_wrench
from robosim.rehearsal.dosing_driver import DosingDriver
from robosim.rehearsal.readings import EnergySample, GrainSample, Readings
from robosim.rehearsal.recorded_motion import RecordedMotion
from robosim.rehearsal.step_record import CAPACITY, StepRecord
from robosim.robot.model import Arm
from robosim.robot.model_errors import ModelErrors
from robosim.robot.timing import JointState
from robosim.scene.build import build_rehearsal_spec
from robosim.scene.compiled import compile_scene
from robosim.scene.container_clearance import monitor_containers
from robosim.scene.field import TOOL, FieldOptions, build_field
from robosim.scene.grains import is_at_border, is_in_container, is_in_tool
from robosim.scene.grasp import CLOSING_SHARE
from robosim.shapes import tool_shape

GRAIN_SAMPLE_INTERVAL = 10
"""Steps between readings that need all grains' positions."""
ENERGY_SAMPLE_INTERVAL = 200
"""Steps between readings of the grains' energies."""
SERVO_INTERVAL = 20
"""Steps between checks of the servo, of as many steps each."""
PATH_POSTURES = 200
"""Postures of the motion in which the servo is checked before it."""
STATE_INTERVAL = 250
"""Steps between states stored in memory, to be written when the run diverges."""
DOSE = "dose"
"""Name under which films and recordings show the dose, in place of the waypoints after it."""


class RehearsalRun:
    """The cell of a rehearsal, what drives it, and the readings of its steps.

    seed: of the grains' initial positions. material: None for the configured one. replay: a recording of the real arm,
    whose motion takes the place of the planned one. errors: by which the robot differs from the model that plans and
    controls it. driver: a user's own, see `robosim.cell.drivers.OwnDriver`; in a rehearsal with a dose a
    `robosim.dosing.command.DoseController`. Raises ConfigError for a replay with a dose, which no recording repeats,
    and for drivers that cannot be used."""

    def __init__(self, plan: Plan, seed: int = 0, material: MaterialConfig | None = None,
                 replay: RecordedMotion | None = None, errors: ModelErrors | None = None, driver: Any = None) -> None:
        if replay is not None and (plan.config.dose is not None or driver is not None):
            raise ConfigError("a recording with a dose or a driver; accepted: one of them, for a recording is of a "
                              "planned motion")
        self.plan = plan if replay is None else plan._replace(motion=replay)
        self.config = config = plan.config
        self.replay, self.errors, self.seed = replay, errors, seed
        self.material: MaterialConfig = material or load_material(config.material)
        self.cell = make_cell(config, plan.arm, (motion := self.plan.motion).state(-config.grasp_time).q, errors)
        self.cell.check_path(motion.state(time).q for time in np.linspace(0.0, motion.duration, PATH_POSTURES))
        self.surface = monitor_containers(config)
        """The containers' surfaces, against which the tool is tested; None where they are not monitored."""
        self.solver = build_field(config, self.material.make_law(), self.cell.tool_pose(), FieldOptions(seed))
        self.cell.couple(self.solver, TOOL, config.coupling)
        self._grain_mass = float(self.solver.masses()[0])
        self.driver: MotionDriver = self._make_driver(driver)
        """What commands the joints."""
        self._record = StepRecord(self.cell, plan.arm, self.plan.motion)
        self.readings = Readings(plan.arm.joints, plan.arm.assembly.robot.slides, self._record.compute)
        self._speeds = np.zeros((SERVO_INTERVAL, len(plan.arm.joints)))
        self._last_read: dict[str, tuple[int, tuple]] = {}  # what -> launches of the solver until then, and values
        self.wall_time = 0.0
        """Time [s] that the steps took: field, coupling and robot."""
        self.timings: dict[str, float] = {}
        """Times [s] of what stands beside the steps: "compile", and what a session adds."""
        self.scooped: np.ndarray | None = None
        """Which grains (n,) were in the tool when it was weighed or, in a recorded motion of its own, when it held most
        outside of containers; None before, or where neither is asked."""
        self._most = 0 if replay is not None and replay.is_own and config.sources else np.inf
        is_picked, rests = config.pick is not None, self.plan.path.rests
        self.grasp_begin = rests[config.waypoints[1].name][0] + config.grasp_time if is_picked else 0.0
        """Time [s] at which the fingers begin to close."""
        self.held_from = self.grasp_begin + config.grasp_time if is_picked else 0.0
        """Time [s] from which the hand holds the tool."""
        self._held_until = np.inf
        if config.pick is not None and config.pick.set_down:
            self._held_until = rests[config.waypoints[-2].name][0] + config.grasp_time + SETTLING
        waypoint = config.weigh_at
        self._weighing_end = np.inf if waypoint is None else rests[waypoint][1] + config.grasp_time
        self._store_state()

    def _make_driver(self, own: Any) -> MotionDriver:
        """Make what commands the joints: a user's own driver, the plan with a dose, or the plan or recording alone."""
        config, motion, arm = self.config, self.plan.motion, self.plan.arm
        late = 0.0 if self.errors is None else self.errors.latency
        if self.replay is not None and self.replay.is_own:
            return ReplayDriver(motion, config.grasp_time, late)
        if config.dose is None:
            if plans_itself(own):
                own.begin(self)
            return MotionDriver(motion, config.grasp_time, late) if own is None else \
                OwnDriver(own, motion, config.grasp_time, late, arm, config.host_dt, self._read_robot)
        if own is not None and (isinstance(own, type) or not (hasattr(own, "start") and hasattr(own, "command"))):
            raise ConfigError(f"driver = {own!r:.100} in a rehearsal with a dose; accepted: a controller of doses, "
                              f"with the methods `start` and `command` (robosim.dosing.command.DoseController)")
        return DosingDriver(self.plan, self.weigh_dose, self.seed, own, late)

    @property
    def dosing(self) -> DosingDriver | None:
        """The driver of a rehearsal with a dose."""
        return self.driver if isinstance(self.driver, DosingDriver) else None

    @property
    def held_until(self) -> float:
        """Time [s] at which the fingers begin to open."""
        return self._held_until + self.driver.delay

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return float(self.cell.data.time)

    def compare_wrench(self) -> WrenchComparison | None:
        """Return the recorded and the simulated wrench; None without a recorded one."""
        if self.replay is None:
            return None
        return compare_wrench(self.replay, self.readings, self.cell.model, self.cell.scene.arm_qpos,
                              self.config.grasp_time)

    def passages(self) -> list[tuple[float, str]]:
        """Return simulated times [s] and names of the waypoints that are passed at known times, in order.
        With a dose those up to it, and the dose itself: it decides when the arm goes on. Once it is over, all.
        A recorded motion of its own passes none."""
        if self.replay is not None and self.replay.is_own:
            return []
        times = [(self.config.grasp_time + time, name) for name, time in self.plan.path.times.items()]
        if not isinstance(self.driver, DosingDriver):
            return sorted(times)
        begin, delay = self.driver.due, self.driver.delay
        after = sorted((time + delay, name) for time, name in times if time >= begin)
        return sorted(one for one in times if one[0] < begin) + [(begin, DOSE)] + (after if delay > 0.0 else [])

    def is_held(self, positions: np.ndarray) -> np.ndarray:
        """Return which of the grains at positions (n, 3) [m] are in the tool (n,)."""
        return is_in_tool(self.config.tool, positions, self.cell.tool_pose())

    def digs(self, positions: np.ndarray, held: np.ndarray) -> bool:
        """Return whether the tool reaches into a container, among grains at positions (n, 3) [m] of which it holds
        `held` (n,). The region of the tool is larger than its bowl, and may then hold a part of the bed: no load."""
        config = self.config
        return bool(reaches_into(self.cell.tool_pose().position[None], config)[0]) or any(
            is_in_container(positions[held], name, config.containers[name]).any() for name in config.sources)

    def weigh_dose(self) -> tuple[float, float]:
        """Return the masses [kg] in the cup of the dose, less what the tool holds above it, and in the tool."""
        name, positions = dose_cup(self.config), self.solver.positions()
        inside = is_in_container(positions, name, self.config.containers[name])
        held = self.is_held(positions)
        return self._grain_mass * int((inside & ~held).sum()), self._grain_mass * int(held.sum())

    def _read_robot(self, time: float, planned: JointState) -> RobotState:
        """Return what a user's driver reads."""
        cell = self.cell
        return RobotState(time, cell.q.copy(), cell.qd.copy(), cell.tool_pose(), cell.wrist_wrench(), planned)

    def run(self, after_step: Callable[[], None]) -> None:
        """Simulate; `after_step` follows every step. Raises mpm.SimulationDiverged, RobotDiverged or DriverFault."""
        begin = clock.perf_counter()
        self.solver.compile()
        self.timings["compile"] = clock.perf_counter() - begin
        index, driver = 0, self.driver
        while driver.is_open_ended or index < round(driver.duration / self.config.host_dt):
            begin = clock.perf_counter()
            self.step(index)
            self.wall_time += clock.perf_counter() - begin
            after_step()
            index += 1

    def step(self, index: int) -> None:
        """Simulate one host step.
        1. Ask the driver for the joints' command; command the fingers.
        2. Step the cell: robot and grains together.
        3. Record the step; every few steps the grains too."""
        cell, record, time = self.cell, self._record, self.time
        target = self.driver.command(time)
        self._command_fingers(time)
        if record.count == CAPACITY:
            self.readings.collect()
        record.begin()
        torque = cell.step(target, self.held_from <= time + self.config.host_dt < self.held_until)
        if self.surface is not None:
            self.surface.record_penetrations(cell.tool_pose())
        time, is_free = self.time, self.driver.is_open_ended or self.driver.is_own
        record.end(target, np.nan if is_free else self.driver.motion_time(time), torque)
        self._speeds[index % SERVO_INTERVAL] = cell.qd
        if index % SERVO_INTERVAL == SERVO_INTERVAL - 1:
            cell.servo.check_motion(time, self._speeds)
        self._record_grains(index)

    def save_last_good_state(self, path: Path) -> None:
        """Write the last stored grains, joint positions and velocities whose numbers were finite."""
        np.savez_compressed(path, **self._last_good_state)  # pyright: ignore[reportArgumentType]

    def _command_fingers(self, time: float) -> None:
        """Close the fingers, release the tool to them when they have closed, or open them."""
        grasp, closing, share = self.cell.grasp, time - self.grasp_begin, CLOSING_SHARE * self.config.grasp_time
        if time >= self.held_until:
            grasp.open(min((time - self.held_until) / share, 1.0))
        elif 0.0 <= closing < self.config.grasp_time:
            grasp.close(min(closing / share, 1.0))
        elif closing >= self.config.grasp_time:
            grasp.release()

    def _record_grains(self, index: int) -> None:
        """Record what needs all grains, where the step's index is a multiple of its interval."""
        if index % GRAIN_SAMPLE_INTERVAL == 0:
            positions, lost, awake = self._read_once(self._read_grains)
            held = self.is_held(positions)
            count = int(held.sum())
            self.readings.grains.append(GrainSample(self.time, self._grain_mass * count, lost, awake))
            if count >= self._most and not self.digs(positions, held):
                self.scooped, self._most = held, count
        if self.scooped is None and self.time >= self._weighing_end:
            self.scooped = self.is_held(self.solver.positions())
        if index % ENERGY_SAMPLE_INTERVAL == 0:
            self.readings.energies.append(EnergySample(self.time, *self._read_once(self.solver.energy)))
        if index % STATE_INTERVAL == 0:
            self._store_state()

    def _read_once(self, read: Callable[[], tuple]) -> tuple:
        """Return what a function reads of the grains; it is called again only once the solver has moved them."""
        launches, values = self._last_read.get(read.__name__, (-1, ()))
        if launches != self.solver.loop.launches:
            launches, values = self._last_read[read.__name__] = self.solver.loop.launches, read()
        return values

    def _read_grains(self) -> tuple[np.ndarray, int, float]:
        """Read positions [m] (n, 3), how many grains are lost, and the share that is awake."""
        positions = self.solver.positions()
        return positions, int(is_at_border(positions, self.solver.grid).sum()), float(self.solver.awake.mean())

    def _store_state(self) -> None:
        data = self.cell.data
        self._last_good_state = self.solver.state() | {"qpos": data.qpos.copy(), "qvel": data.qvel.copy()}


def make_cell(config: RehearsalConfig, arm: Arm, q: np.ndarray, errors: ModelErrors | None = None) -> Cell:
    """Assemble and compile a rehearsal's scene at q (n,) [rad], where an unstable servo raises ConfigError."""
    spec = build_rehearsal_spec(config, arm.assembly)
    if errors is not None:
        errors.place_tool(spec, config.tool_name)
    scene = compile_scene(spec, arm.assembly)
    if errors is not None:
        errors.change_model(scene.model, scene.wrist, scene.arm_dofs)
    gains = arm.gains(config.host_dt, config.servo)
    return Cell(scene, arm, q, config.containers, gains=gains if errors is None else errors.change_gains(gains),
                stand=config.standing_pose, tip=tool_shape(config.tool).tip)
