"""A driver of rehearsals that closes the loop: a learned policy for each sub-task, and the ways between them."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

import mpm
from mpm.geometry.rigid_motion import relative_rotation, rotate
from robosim.base.errors import ConfigError, DriverFault
from robosim.cell.arm_sampler import ArmSampler
from robosim.cell.drivers import RobotState
from robosim.config.rehearsal import RehearsalConfig
from robosim.planning.recorded_motions import SubTaskMotion, load_sequence
from robosim.rehearsal.run import RehearsalRun
from robosim.robot.inverse_kinematics import step_towards
from robosim.robot.joint_control import JointSmoother
from robosim.robot.timing import JointState
from robosim.scene.grains import is_in_tool
from robosim.senses.perception import Perception
from robosim.senses.term import SenseScene, Sight
from robosim.studies.policies.make import MAX_REPEAT, check_task, load_policy
from robosim.studies.policies.network import Network
from robosim.tasks.actions import ActionScaling, move_pose
from robosim.tasks.task import TaskConfig

WAY_TIME, REST_TIME = 3.0, 0.8
"""Times [s] from the end of a sub-task to the start of the next, and of the rest before each and after the last."""
SEEN = ("goal_frame", "tool", "goal", "time", "pending", "joints", "torques", "wrist")
"""Terms of an observation that a rehearsal can show: none of them depends on where the sub-task's own scene stands."""


class Stage(NamedTuple):
    """A sub-task in a rehearsal."""

    name: str
    task: TaskConfig
    """With the rehearsal's step."""
    network: Network
    repeat: int
    """Steps of the rehearsal for which an action is repeated."""
    offset: np.ndarray
    """Translation (3,) [m] from where the task has its scene to where the rehearsal has it."""
    begin: int
    """Step of the motion in which the policy takes over."""
    end: int

    @property
    def start(self) -> mpm.Pose:
        """Pose of the tool at its beginning."""
        pose = self.task.start.pose
        return pose._replace(position=pose.position + self.offset)


class PolicyDriver:
    """Commands the joints as policies ask, one after the other; a user's own driver, see `OwnDriver`, and its path.

    source: folder of a policy TASK.npz of each sub-task of a rehearsal, or the file or run of a single one. A policy
    sees grains and tool in the frame of its task, acts as often as it was trained to and within the task's box; inverse
    kinematics find the joints, and Ruckig keeps them within their limits. Each sub-task begins where its own start is;
    a policy of a full tool sees the grains in it. Raises ConfigError, mpm.InvalidValue for files that cannot be used.
    """

    def __init__(self, source: Path, config: RehearsalConfig) -> None:
        self._k, self._dt, self._stages, step = 0, config.host_dt, list[Stage](), 0
        for motion in load_sequence(config):
            step += round((REST_TIME + (WAY_TIME if self._stages else 0.0)) / self._dt)
            path = find_policy(source, motion.name, len(config.recorded))
            self._stages.append(self._make_stage(motion, path, step))
            step = self._stages[-1].end
        self.times = {stage.name: stage.begin * self._dt for stage in self._stages}
        """As of a plan's path: sub-task -> time [s] of its begin, rest -> its times, and the time [s] of all."""
        self.duration = step * self._dt + REST_TIME
        end = [*self.times.values(), self.duration][config.tool_fill_height is None]
        self.rests = {} if config.weigh_at is None else {config.weigh_at: (end - REST_TIME, end)}
        self._pose = self._left = self._stages[0].start

    def _make_stage(self, motion: SubTaskMotion, path: Path, begin: int) -> Stage:
        check_task(str(path), motion.task, arm=True)
        arrays, dt = load_policy(path), motion.task.step_dt
        network, every = Network(path, arrays), arrays.integer("action_repeat", 10, 1, MAX_REPEAT) * dt
        unseen = [name for name in network.obs.split(",") if name not in SEEN] + ["an expert"] * ("expert" in arrays)
        if unseen:
            raise ConfigError(f"policy {path}: sees {', '.join(unseen)}; accepted in a rehearsal: {', '.join(SEEN)}")
        repeat, steps = round(every / self._dt), round(motion.task.steps * dt / self._dt)
        if abs(repeat * self._dt - every) > 1e-9:
            raise ConfigError(f"policy {path}: acts every {every:g} s; accepted: a multiple of host_dt, {self._dt:g} s")
        task = motion.task.model_copy(update={"step_dt": self._dt})
        return Stage(motion.name, task, network, repeat, motion.offset, begin, begin + steps)

    def begin(self, run: RehearsalRun) -> None:
        """Take the run whose robot and grains the policies see, and give its plan the times of the sub-tasks."""
        self._run, self.cell, arm = run, run.cell, run.plan.arm
        self._rest = self._q = run.plan.motion.state(0.0).q
        self._smoother = JointSmoother(arm.step_limits(), self._dt, arm)
        self._smoother.restart(self._q)
        run.plan = run.plan._replace(path=self)
        for stage in self._stages:
            self._look(stage, np.arange(1))
            stage.network.check_sizes(stage.network.obs, self._senses.space.shape, stage.task.action.size)

    def pose(self, time: float) -> mpm.Pose:
        """Return the pose in which the sub-task of a time [s] begins."""
        return [stage for k, stage in enumerate(self._stages) if k == 0 or stage.begin * self._dt <= time][-1].start

    def command(self, state: RobotState) -> JointState:
        """Return the joints' command; raises DriverFault for a sub-task that begins with an empty tool."""
        step, stage = round(state.time / self._dt), self._stages[self._k]
        if step == stage.end and stage is not self._stages[-1]:
            self._left, self._k = self._pose, self._k + 1
            stage = self._stages[self._k]
        if step < stage.begin:
            self._pose = self._way(stage.start, (stage.begin - step) * self._dt - REST_TIME)
        elif step < stage.end:
            self._act(stage, state, step - stage.begin)
        q = step_towards(self._run.plan.arm, self._pose, self._q, self._rest)
        qd, self._q = (q - self._q) / self._dt, q
        return self._smoother.step(q, qd)

    def _way(self, goal: mpm.Pose, left: float) -> mpm.Pose:
        """Return the pose on the straight way to the start of a sub-task, at rest at both ends; left: time [s]."""
        begin, u = self._left, min(max(1.0 - left / WAY_TIME, 0.0), 1.0)
        u = u * u * (3.0 - 2.0 * u)
        turn = begin.matrix @ relative_rotation(begin.quaternion, goal.quaternion)
        return mpm.Pose(begin.position + u * (goal.position - begin.position), rotate(begin.quaternion, u * turn))

    def _act(self, stage: Stage, state: RobotState, step: int) -> None:
        """Move the commanded pose by a step of the policy's action, of which there is a new one from time to time."""
        tool = state.tool._replace(position=state.tool.position - stage.offset)
        if step == 0:
            held = is_in_tool(stage.task.tool, self._run.solver.positions() - stage.offset, tool)
            if stage.task.carried and not held.any():
                raise DriverFault("policy", state.time, f"begins {stage.name} with an empty tool", "a load in it")
            self._look(stage, np.flatnonzero(held) if stage.task.carried else np.arange(len(held)))
            self._memory = self._senses.begin(self._sight(stage, tool, step), 0)
        if self._sampler is not None:
            self._sampler.take()
        if step % stage.repeat == 0:
            action = stage.network(self._senses.read(self._sight(stage, tool, step), self._memory))
            self._velocity = ActionScaling(stage.task).velocities(action)
            if self._sampler is not None:
                self._sampler.begin_action()
        pose = self._pose._replace(position=self._pose.position - stage.offset)
        pose = move_pose(pose, stage.task, *self._velocity)
        self._pose = pose._replace(position=pose.position + stage.offset)

    def _look(self, stage: Stage, grains: np.ndarray) -> None:
        """Make the senses of a sub-task, for grains by their indices (n,)."""
        own = stage.task.grains.model_copy(update={"count": len(grains), "observe_every": 1, "elites": None})
        task, run = stage.task.model_copy(update={"grains": own}), self._run
        self._grains, self._lost = grains, np.zeros(len(grains), bool)
        self._senses = Perception(task, stage.network.obs.split(","), flatten=True)
        self._senses.build(SenseScene(task, run.material, run.solver, self))
        self._sampler = ArmSampler(run.cell) if self._senses.reads_arm else None

    def _sight(self, stage: Stage, tool: mpm.Pose, step: int) -> Sight:
        """Return what the policy's terms see: tool and grains in the frame of the sub-task's own scene."""
        task, solver = stage.task, self._run.solver
        x, v = solver.positions()[self._grains] - stage.offset, solver.velocities()[self._grains]
        held = is_in_tool(task.tool, x, tool)
        self._lost |= ~task.bounds.region.holds(x) & ~held
        counts = mpm.Counts(0.0, 0, 0, int(task.target.region.holds(x).sum()), int(self._lost.sum()), int(held.sum()),
                            0, 0, 0.0)
        return Sight(step * self._dt, step / (stage.end - stage.begin), tool, counts,
                     np.hstack([x, v]).astype(np.float32), np.zeros(6), stage.repeat * self._dt, sensors=self._sampler)


def find_policy(source: Path, task: str, count: int) -> Path:
    """Return the file of a sub-task's policy; raises ConfigError where there is none. count: of sub-tasks."""
    names = [f"{task}.npz", *(["best_policy.npz"] if count == 1 else [])]
    paths = [source / name for name in names] if source.is_dir() else [source] if count == 1 else []
    if found := [path for path in paths if path.is_file()]:
        return found[0]
    raise ConfigError(f"--policy {source}: no policy for {task}; accepted: a folder with {' or '.join(names)}"
                      f"{', or the file itself' if count == 1 else ' and so on'}")
