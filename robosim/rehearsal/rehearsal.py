"""A whole-arm rehearsal: plan the motion, then carry it out in the coupled scene."""

import time as clock
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np

import mpm
from robosim.config.materials import MaterialConfig, law_of, load_material
from robosim.config.rehearsal import RehearsalConfig
from robosim.coupling.plugin import GranularPlugin
from robosim.errors import ConfigError
from robosim.rehearsal.learned_path import LearnedPath
from robosim.rehearsal.recording import EnergySample, Recording, Sample, Step
from robosim.rehearsal.waypoint_path import CommandedPath
from robosim.robot.joint_path import PathSolution, solve_path
from robosim.robot.model import Arm
from robosim.robot.servo import Servo
from robosim.robot.timing import JointState, SmoothMotion, compute_time_scale
from robosim.robot.torque_sensors import TorqueSensors
from robosim.scene.build import Scene, build_rehearsal_spec, compile_scene
from robosim.scene.collisions import CollisionMonitor
from robosim.scene.field import build_field
from robosim.scene.frames import body_pose
from robosim.scene.grain_regions import is_at_border, is_in_tool
from robosim.scene.grasp import Grasp
from robosim.scene.robot_spec import ARM_JOINTS

ROUNDS, MARGIN = 20, 0.92
"""How often a learnt motion is slowed down where the arm cannot follow it, and to what share of its limits."""
PATH_SAMPLING = 0.01
"""[s] between the poses at which the path is solved for joint angles."""
SAMPLE_EVERY = 10
"""Steps between readings that need all particles."""
ENERGY_EVERY = 100
"""Steps between readings of the grains' energies."""
KEEP_EVERY = 250
"""Steps between states kept in memory, to be written when the run diverges."""


class Plan(NamedTuple):
    """A motion, found before anything is simulated."""

    path: CommandedPath | LearnedPath
    solution: PathSolution
    motion: SmoothMotion
    arm: Arm


def plan(config: RehearsalConfig) -> Plan:
    """Solve the path and smooth it; raises ConfigError or UnreachableWaypoint."""
    arm = Arm(config.tool)
    if config.trajectory == "script":
        path = CommandedPath(config)
        times, solution = solved(arm, path)
        return Plan(path, solution, SmoothMotion(times, solution.q, config.limits, path.times), arm)
    path, reason = LearnedPath(config), None
    for _ in range(ROUNDS):
        times, solution = solved(arm, path)
        try:
            return Plan(path, solution, SmoothMotion(times, solution.q, config.limits, path.times), arm)
        except ConfigError as error:
            reason = error
        path.slow_down(times, compute_time_scale(times, solution.q, config.limits) / MARGIN)
    raise ConfigError(f"the learnt motion is too fast for the arm even {path.slower_by:.1f} times slower: {reason}")


def solved(arm: Arm, path: CommandedPath | LearnedPath) -> tuple[np.ndarray, PathSolution]:
    """Times [s] of a path's samples, and its joint angles there."""
    times = np.linspace(0.0, path.duration, int(np.ceil(path.duration / PATH_SAMPLING)) + 1)
    marks = [(int(np.searchsorted(times, t)), name) for name, t in path.times.items()]
    return times, solve_path(arm, [path.pose(t) for t in times], [(min(i, len(times) - 1), n) for i, n in marks])


class Rehearsal:
    """The coupled scene of a planned motion; `run` carries it out."""

    def __init__(self, config: RehearsalConfig, planned: Plan, seed: int = 0,
                 material: MaterialConfig | None = None) -> None:
        self.config, self.plan = config, planned
        self.material: MaterialConfig = material or load_material(config.material)
        self.scene: Scene = compile_scene(build_rehearsal_spec(config), config.tool)
        self.model, self.data = self.scene.model, mujoco.MjData(self.scene.model)
        self.data.qpos[self.scene.arm_qpos] = planned.motion.state(0.0).q
        mujoco.mj_forward(self.model, self.data)
        self.grasp = Grasp(self.model, self.data, self.scene.tool)
        self.sensors = TorqueSensors(self.model, self.data, ARM_JOINTS, planned.arm)
        law = law_of(self.material)
        self.grains = build_field(config, law, self.tool_pose(), seed)
        self.solver = self.grains.solver
        self.plugin = GranularPlugin(self.model, self.data, self.solver, bodies={config.tool: self.grains.tool},
                                     coupling=config.coupling)
        self.servo = Servo(planned.arm, config.servo)
        self.servo.check_step(self.model, self.data, self.scene.arm_dofs)
        self.recording = Recording()
        self.seed = seed
        self.duration = config.grasp_time + planned.motion.duration
        self.contacts = CollisionMonitor(self.model, self.data, config)
        self._grain_mass = float(self.solver.masses()[0])
        self.scooped: np.ndarray | None = None
        """Which grains (n,) hung in the tool when it was weighed."""
        weighed = config.weigh_at
        self._weighed = np.inf if weighed is None else planned.path.rests[weighed][1] + config.grasp_time
        self.wall_time = 0.0
        self._keep_good_state()

    def tool_pose(self) -> mpm.Pose:
        """World pose of the tool's frame."""
        return body_pose(self.data, self.scene.tool)

    @property
    def time(self) -> float:
        return float(self.data.time)

    def waypoint_time(self, name: str) -> float:
        """Simulated time [s] at which a waypoint is passed."""
        return self.config.grasp_time + self.plan.path.times[name]

    def run(self, each_step: Callable[[], None]) -> None:
        """Carry the motion out; `each_step` is called after every step. Raises mpm.SimulationDiverged."""
        begin = clock.perf_counter()
        steps = round(self.duration / self.config.host_dt)
        for index in range(steps):
            self.step(index)
            each_step()
        self.wall_time = clock.perf_counter() - begin

    def step(self, index: int) -> None:
        """One host step.

        1. Command fingers and arm.
        2. Step robot and grains together.
        3. Write down what happened.
        """
        wanted = self.plan.motion.state(self.time - self.config.grasp_time)
        torque = self._command(wanted)
        q, speeds = self.data.qpos[self.scene.arm_qpos].copy(), self.data.qvel[self.scene.arm_dofs].copy()
        twist = self._tool_twist()
        if self.time >= self.config.grasp_time:
            self.grasp.release()
        self.plugin.step()
        self.grasp.measure_slip()
        self.contacts.count()
        self.recording.steps.append(self._read(torque, q, speeds, twist))
        if index % SAMPLE_EVERY == 0:
            self.recording.samples.append(self._sample())
        if self.scooped is None and self.time >= self._weighed:
            self.scooped = is_in_tool(self.config.tool, self.solver.positions(), self.tool_pose())
        if index % ENERGY_EVERY == 0:
            self.recording.energies.append(EnergySample(self.time, *self.solver.energy()))
        if index % KEEP_EVERY == 0:
            self._keep_good_state()

    def _command(self, wanted: JointState) -> np.ndarray:
        """Set the motor torques and finger commands; returns the torques [N m] (7,)."""
        if self.time < self.config.grasp_time:
            self.grasp.close(min(self.time / (0.6 * self.config.grasp_time), 1.0))
        q, qd = self.data.qpos[self.scene.arm_qpos], self.data.qvel[self.scene.arm_dofs]
        torque = self.servo.compute_torque(wanted, q, qd)
        self.data.ctrl[self.scene.arm_actuators] = torque
        return torque

    def _tool_twist(self) -> np.ndarray:
        """Velocity of the tool at its centre of mass in world axes (6,): angular, linear, as MuJoCo orders them."""
        velocity = np.zeros(6)
        mujoco.mj_objectVelocity(self.model, self.data, mujoco.mjtObj.mjOBJ_BODY, self.scene.tool, velocity, 0)
        return velocity

    def _read(self, torque: np.ndarray, begin: np.ndarray, speeds: np.ndarray, twist: np.ndarray) -> Step:
        """The step's row, all at its end: commanded where the motion is by now, qdd as the change of qd."""
        s, data, ledger = self.scene, self.data, self.plugin.ledger
        wrench = self.plugin.wrench(self.config.tool)
        end = self.tool_pose()
        commanded = self.plan.arm.tool_pose(self.plan.motion.state(self.time - self.config.grasp_time).q)
        qd = data.qvel[s.arm_dofs].copy()
        parts = [ledger.gravity, ledger.walls, ledger.static, *ledger.bodies.values()]
        mean = 0.5 * (twist + self._tool_twist())
        power = wrench.force @ mean[3:] + wrench.torque @ mean[:3]
        q, qdd = data.qpos[s.arm_qpos].copy(), (qd - speeds) / self.config.host_dt
        # the sensors hold the values of the step's beginning, like MuJoCo's accelerations
        external = self.sensors.estimate_external(begin, speeds, data.qacc[s.arm_dofs])
        return Step(
            self.time, q, qd, qdd, torque, self.servo.demanded_torque, self.sensors.read(), external,
            np.concatenate(commanded), np.concatenate(end), self._wrist(),
            np.concatenate(ledger.residual),
            np.array([sum(np.linalg.norm(p.linear) for p in parts), sum(np.linalg.norm(p.angular) for p in parts)]),
            float(-power) * self.config.host_dt,
        )

    def _wrist(self) -> np.ndarray:
        """Force and torque of the wrist sensor in world axes (6,)."""
        site = self.model.site("wrist_sensor").id
        R = self.data.site_xmat[site].reshape(3, 3)
        return np.concatenate([R @ self.data.sensor("wrist_force").data, R @ self.data.sensor("wrist_torque").data])

    def _sample(self) -> Sample:
        positions = self.solver.positions()
        mass = self._grain_mass * is_in_tool(self.config.tool, positions, self.tool_pose()).sum()
        return Sample(self.time, float(mass), int(is_at_border(positions, self.solver.grid).sum()))

    def save_last_good_state(self, path: Path) -> None:
        """The last sampled state whose numbers were finite: grains, joints, time."""
        np.savez_compressed(path, **self._last_good)  # pyright: ignore[reportArgumentType]

    def _keep_good_state(self) -> None:
        self._last_good = self.solver.state() | {"qpos": self.data.qpos.copy(), "qvel": self.data.qvel.copy()}
