"""Simulation of a planned rehearsal: robot and grains together, step by step."""

import time as clock
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np

import mpm
from robosim.base.errors import ConfigError
from robosim.config.materials import MaterialConfig, law_of, load_material
from robosim.coupling.plugin import GranularPlugin
from robosim.dosing.command import DoseController
from robosim.rehearsal.dosing.lip_motion import dose_cup
from robosim.rehearsal.dosing.stage import DosingStage
from robosim.rehearsal.planning.picking import SETTLING
from robosim.rehearsal.planning.plan import Plan
from robosim.rehearsal.readings import EnergySample, GrainSample, Readings, Step
from robosim.rehearsal.replay.comparison import Simulated, WrenchComparison, compare_wrench
from robosim.rehearsal.replay.recorded_motion import Replay
from robosim.robot.assembly import WRIST_SITE
from robosim.robot.joint_control import Servo, TorqueSensors
from robosim.robot.model_errors import ModelErrors
from robosim.robot.timing import JointState
from robosim.scene.build import assemble_rehearsal, build_rehearsal_spec, standing_pose
from robosim.scene.collisions import CollisionMonitor
from robosim.scene.compiled import Scene, compile_scene
from robosim.scene.field import FieldOptions, build_field
from robosim.scene.frames import body_pose
from robosim.scene.grains import is_at_border, is_in_container, is_in_tool
from robosim.scene.grasp import Grasp, put_tool

GRAIN_SAMPLE_INTERVAL = 10
"""Steps between readings that need all grains' positions."""
ENERGY_SAMPLE_INTERVAL = 100
"""Steps between readings of the grains' energies."""
STATE_INTERVAL = 250
"""Steps between states stored in memory, to be written when the run diverges."""
DOSE = "dose"
"""Name under which films and recordings show the dose, in place of the waypoints after it."""
CLOSING_SHARE = 0.6
"""Share of the grasp time in which the fingers close; in the rest they settle on the handle."""


class RehearsalRun:
    """The coupled scene of a planned motion, and the simulation of it.

    seed: of the grains' initial positions. material: None for the configured one. replay: a recording of the real arm,
    whose motion takes the place of the planned one. errors: by which the robot differs from the model that plans and
    controls it. controller: of the dose; None for the configured one. Raises ConfigError for a replay with a dose,
    which no recording repeats.
    """

    def __init__(self, plan: Plan, seed: int = 0,
                 material: MaterialConfig | None = None, replay: Replay | None = None,
                 errors: ModelErrors | None = None, controller: DoseController | None = None) -> None:
        if replay is not None and plan.config.dose is not None:
            raise ConfigError("a recording of a rehearsal with a dose; accepted: one without, whose motion is planned")
        self.plan = plan if replay is None else plan._replace(motion=replay.motion)
        self.config = config = plan.config
        self.replay, self.errors, self.seed = replay, errors, seed
        self.material: MaterialConfig = material or load_material(config.material)
        spec = build_rehearsal_spec(config)
        if errors is not None:
            errors.place_tool(spec, config.tool_name)
        self.scene: Scene = compile_scene(spec, assemble_rehearsal(config))
        if errors is not None:
            errors.change_model(self.scene.model, self.scene.wrist, self.scene.arm_dofs)
        self.model, self.data = self.scene.model, mujoco.MjData(self.scene.model)
        self.data.qpos[self.scene.arm_qpos] = self.plan.motion.state(-config.grasp_time).q
        stand = standing_pose(config)
        if stand is not None:
            put_tool(self.scene, self.data, stand)
        mujoco.mj_forward(self.model, self.data)
        self.grasp = Grasp(self.scene, self.data)
        self.sensors = TorqueSensors(self.model, self.data, plan.arm)
        self.grains = build_field(config, law_of(self.material), self.tool_pose(), FieldOptions(seed))
        self.solver = self.grains.solver
        self.plugin = GranularPlugin(self.model, self.data, self.solver, bodies={config.tool_name: self.grains.tool},
                                     coupling=config.coupling)
        gains = plan.arm.gains(config.servo)
        self.servo = Servo(plan.arm, gains if errors is None else errors.change_gains(gains))
        self.servo.check_step(self.model, self.data, self.scene.arm_dofs)
        self.collisions = CollisionMonitor(self.scene, self.data, config)
        self.readings = Readings(plan.arm.joints, plan.arm.assembly.robot.slides)
        self.duration = config.grasp_time + self.plan.motion.duration
        """Simulated time [s], including the grasp."""
        self.wall_time = 0.0
        """Time [s] that the steps took: field, coupling and robot."""
        self.timings: dict[str, float] = {}
        """Times [s] of what stands beside the steps: "compile", and what a session adds."""
        self.scooped: np.ndarray | None = None
        """Which grains (n,) were in the tool when it was weighed; None before, or where nothing is weighed."""
        self.grasp_begin = 0.0 if stand is None else plan.path.rests[config.waypoints[1].name][0] + config.grasp_time
        """Time [s] at which the fingers begin to close."""
        self.held_from = 0.0 if stand is None else self.grasp_begin + config.grasp_time
        """Time [s] from which the hand holds the tool."""
        self.held_until = np.inf
        """Time [s] at which the fingers begin to open."""
        if config.pick is not None and config.pick.set_down:
            self.held_until = plan.path.rests[config.waypoints[-2].name][0] + config.grasp_time + SETTLING
        self.stage: DosingStage | None = None
        """The dose, of a rehearsal with one."""
        if config.dose is not None:
            begin = plan.path.rests[config.dose_at][1]
            self._dose_begin = begin + config.grasp_time
            self.stage = DosingStage(config, plan.arm, plan.motion.state(begin).q, self.mass_in_cup, seed, controller,
                                     0.0 if errors is None else errors.latency)
        waypoint = config.weigh_at
        self._weighing_end = np.inf if waypoint is None else plan.path.rests[waypoint][1] + config.grasp_time
        self._grain_mass = float(self.solver.masses()[0])
        self._store_state()

    @property
    def _doses(self) -> bool:
        """Whether a dose runs."""
        return self.stage is not None and self.stage.is_running

    @property
    def expected_duration(self) -> float:
        """Simulated time [s] that the run takes, if a dose that runs ended now."""
        stage = self.stage
        return self.duration + (self.time - stage.begin if stage and stage.is_running and stage.begin else 0.0)

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return float(self.data.time)

    def tool_pose(self) -> mpm.Pose:
        """Return the world pose of the tool's frame."""
        return body_pose(self.data, self.scene.tool)

    def compare_wrench(self) -> WrenchComparison | None:
        """Return the recorded and the simulated wrench; None without a recorded one."""
        if self.replay is None:
            return None
        steps = Simulated(*(self.readings.stack_steps(name) for name in ("time", "q", "wrist")))
        return compare_wrench(self.replay, steps, self.model, self.scene.arm_qpos, self.config.grasp_time)

    def waypoint_time(self, name: str) -> float:
        """Return the simulated time [s] at which a waypoint is passed."""
        time = self.config.grasp_time + self.plan.path.times[name]
        return time if self.stage is None or time < self._dose_begin else time + self.delay

    @property
    def delay(self) -> float:
        """Time [s] by which a dose has delayed the planned motion; 0 until it is over, and without one."""
        return 0.0 if self.stage is None else self.stage.duration

    def planned_passages(self) -> list[tuple[float, str]]:
        """Return times [s] and names of the waypoints that are passed at times known before the run, in order.

        Those up to a dose, and the dose itself: it decides when the arm goes on.
        """
        passages = sorted((self.waypoint_time(name), name) for name in self.plan.path.times)
        if self.stage is None:
            return passages
        return [(time, name) for time, name in passages if time < self._dose_begin] + [(self._dose_begin, DOSE)]

    def passages_after_dose(self) -> list[tuple[float, str]]:
        """Return times [s] and names of the waypoints after a dose, in order, without the time that it takes."""
        if self.stage is None:
            return []
        times = {name: self.config.grasp_time + time for name, time in self.plan.path.times.items()}
        return sorted((time, name) for name, time in times.items() if time >= self._dose_begin)

    def mass_in_cup(self) -> float:
        """Return the mass [kg] in the cup of the dose, without grains that the tool holds above it."""
        name, positions = dose_cup(self.config), self.solver.positions()
        inside = is_in_container(positions, name, self.config.containers[name])
        return self._grain_mass * int((inside & ~is_in_tool(self.config.tool, positions, self.tool_pose())).sum())

    def run(self, after_step: Callable[[], None]) -> None:
        """Simulate the motion; `after_step` is called after every step.

        Raises mpm.SimulationDiverged or RobotDiverged.
        """
        begin = clock.perf_counter()
        self.solver.compile()
        self.timings["compile"] = clock.perf_counter() - begin
        index = 0
        while self._doses or index < round(self.duration / self.config.host_dt):  # a dose makes it longer
            begin = clock.perf_counter()
            self.step(index)
            self.wall_time += clock.perf_counter() - begin
            after_step()
            index += 1

    def step(self, index: int) -> None:
        """Simulate one host step.

        1. Command fingers and arm.
        2. Step robot and grains together.
        3. Update slip and collisions.
        4. Record the step; every few steps the grains too.
        """
        target = self._target()
        torque = self._command(target)
        q, qd = self.data.qpos[self.scene.arm_qpos].copy(), self.data.qvel[self.scene.arm_dofs].copy()
        velocity = self._tool_velocity()
        self.plugin.step()
        self.grasp.measure_slip()
        self.collisions.count(self.held_from <= self.time < self.held_until)
        self.readings.steps.append(self._read_step(target, torque, q, qd, velocity))
        self._record_grains(index)

    def save_last_good_state(self, path: Path) -> None:
        """Write the last stored state, whose numbers were finite.

        It holds the grains, and joint positions and velocities.
        """
        np.savez_compressed(path, **self._last_good_state)  # pyright: ignore[reportArgumentType]

    def _target(self) -> JointState:
        """Return the joints' command: of the dose while it runs, else of the planned motion, which it delays."""
        late = 0.0 if self.errors is None else self.errors.latency
        stage = self.stage
        if stage is None:
            return self.plan.motion.state(self.time - self.config.grasp_time - late)
        if stage.begin is None and self.time >= self._dose_begin:
            held = is_in_tool(self.config.tool, self.solver.positions(), self.tool_pose()).sum()
            stage.start(self.time, self._grain_mass * int(held))
        if stage.is_running:
            target = stage.step(self.time)
            if stage.end is not None:
                self.duration += stage.duration
                self.held_until += stage.duration
            return target
        return self.plan.motion.state(self.motion_time(self.time) - late)

    def is_dosing_at(self, time: float) -> bool:
        """Return whether the dose decides the motion at a simulated time [s]."""
        stage = self.stage
        return stage is not None and stage.begin is not None and stage.begin <= time <= (stage.end or np.inf)

    def motion_time(self, time: float) -> float:
        """Return the time [s] of the planned motion at a simulated time [s]; it rests while a dose runs."""
        planned = time - self.config.grasp_time
        if self.stage is None or self.stage.begin is None or time < self.stage.begin:
            return planned
        rest = self.stage.begin - self.config.grasp_time
        return rest if self.stage.end is None or time < self.stage.end else planned - self.stage.duration

    def _command(self, target: JointState) -> np.ndarray:
        """Set finger commands and motor torques, release the grasp after its time; returns the torques [N m] (n,)."""
        closing, share = self.time - self.grasp_begin, CLOSING_SHARE * self.config.grasp_time
        if self.time >= self.held_until:
            self.grasp.open(min((self.time - self.held_until) / share, 1.0))
        elif 0.0 <= closing < self.config.grasp_time:
            self.grasp.close(min(closing / share, 1.0))
        elif closing >= self.config.grasp_time:
            self.grasp.release()
        q, qd = self.data.qpos[self.scene.arm_qpos], self.data.qvel[self.scene.arm_dofs]
        torque = self.servo.compute_torque(target, q, qd)
        self.data.ctrl[self.scene.arm_actuators] = torque
        return torque

    def _tool_velocity(self) -> np.ndarray:
        """Velocity of the tool's centre of mass in world axes (6,): angular, linear, in MuJoCo's order."""
        velocity = np.zeros(6)
        mujoco.mj_objectVelocity(self.model, self.data, mujoco.mjtObj.mjOBJ_BODY, self.scene.tool, velocity, 0)
        return velocity

    def _read_step(self, target: JointState, torque: np.ndarray, q_begin: np.ndarray, qd_begin: np.ndarray,
                   velocity_begin: np.ndarray) -> Step:
        """Readings of the step that has just ended; arguments ending in _begin are from its start."""
        scene, data, ledger = self.scene, self.data, self.plugin.ledger
        wrench = self.plugin.wrench(self.config.tool_name)
        end = self.tool_pose()
        planned = self.plan.motion.state(self.motion_time(self.time))
        commanded = self.plan.arm.tool_pose((target if self._doses else planned).q)
        q, qd = data.qpos[scene.arm_qpos].copy(), data.qvel[scene.arm_dofs].copy()
        mean_velocity = 0.5 * (velocity_begin + self._tool_velocity())
        power = wrench.force @ mean_velocity[3:] + wrench.torque @ mean_velocity[:3]
        # sensor values belong to the step's start, as MuJoCo's accelerations do
        external = self.sensors.estimate_external(q_begin, qd_begin, data.qacc[scene.arm_dofs])
        return Step(
            time=self.time, q=q, qd=qd, qdd=(qd - qd_begin) / self.config.host_dt, torque=torque,
            demanded_torque=self.servo.demanded_torque, sensed_torque=self.sensors.read(), external_torque=external,
            commanded=np.concatenate(commanded), reached=np.concatenate(end), wrist=self._wrist_wrench(),
            residual=np.concatenate(ledger.residual), exchanged=ledger.exchanged,
            tool_force=wrench.force, tool_work=float(-power) * self.config.host_dt, is_missed=self.plugin.is_missed)

    def _wrist_wrench(self) -> np.ndarray:
        """Force and torque of the wrist sensor in world axes (6,)."""
        site = self.model.site(WRIST_SITE).id
        R = self.data.site_xmat[site].reshape(3, 3)
        return np.concatenate([R @ self.data.sensor("wrist_force").data, R @ self.data.sensor("wrist_torque").data])

    def _record_grains(self, index: int) -> None:
        """Record what needs all grains, where the step's index is a multiple of its interval."""
        if index % GRAIN_SAMPLE_INTERVAL == 0:
            self.readings.grains.append(self._sample_grains())
        if self.scooped is None and self.time >= self._weighing_end:
            self.scooped = is_in_tool(self.config.tool, self.solver.positions(), self.tool_pose())
        if index % ENERGY_SAMPLE_INTERVAL == 0:
            self.readings.energies.append(EnergySample(self.time, *self.solver.energy()))
        if index % STATE_INTERVAL == 0:
            self._store_state()

    def _sample_grains(self) -> GrainSample:
        positions = self.solver.positions()
        mass = self._grain_mass * is_in_tool(self.config.tool, positions, self.tool_pose()).sum()
        return GrainSample(self.time, float(mass), int(is_at_border(positions, self.solver.grid).sum()),
                           float(self.solver.awake.mean()))

    def _store_state(self) -> None:
        self._last_good_state = self.solver.state() | {"qpos": self.data.qpos.copy(), "qvel": self.data.qvel.copy()}
