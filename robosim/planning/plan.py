"""Planning of a rehearsal's motion, before anything is simulated."""

from typing import NamedTuple

import numpy as np

from robosim.base.errors import ConfigError, UnreachableWaypoint
from robosim.config.rehearsal import RehearsalConfig
from robosim.planning.approach import Approach, plan_approach
from robosim.planning.clearance import Clearances, PathClearance
from robosim.planning.picking import add_picking
from robosim.planning.recorded_path import RecordedPath
from robosim.planning.waypoint_path import WaypointPath
from robosim.robot.assembly import GRIP_TURNS_DEG
from robosim.robot.inverse_kinematics import PathSolution, solve_path
from robosim.robot.model import Arm
from robosim.robot.timing import JointMotion, JointState, SmoothMotion, compute_time_scale, find_nearest
from robosim.scene.build import assemble_rehearsal

MAX_SLOWDOWNS = 20
"""Times that a motion is slowed down before it is refused."""
LIMIT_SHARE = 0.92
"""Share of the arm's limits to which a motion is slowed down."""
LEAST_SLOWDOWN = 1.02
"""Smallest factor by which a motion is slowed down at a time. Where the limits of its derivatives demand no more, as
with torques, it is slower by one factor more each time."""
PATH_SAMPLING = 0.01
"""Time [s] between the poses at which the path is solved for joint angles."""
SLOWNESS = 1.3
"""Factor by which a path's derivatives may exceed the limits for it to be tried at full speed: Ruckig's motion through
its knots has a smaller jerk than a spline."""
JOINT_MARGIN = 0.02
"""Distance [rad] from the joints' limits with which a grip is taken without trying others."""


class Plan(NamedTuple):
    """The planned motion of a rehearsal."""

    config: RehearsalConfig
    """With what the planner has chosen: the turn of the tool in the hand, and slower waypoints."""
    path: WaypointPath | RecordedPath
    solution: PathSolution
    motion: JointMotion
    arm: Arm
    clearance: PathClearance
    time_scale: float = 1.0
    """Factor by which a script's waypoints come later than the file says."""
    approach: Approach | None = None
    """The motion from the arm's home to the start of this one; None: `no_approach` says why."""
    no_approach: str = ""


class Grip:
    """The joint path with the tool held as the configuration says, before its timing; errors as of `plan_path`."""

    def __init__(self, config: RehearsalConfig) -> None:
        self.arm = Arm(assemble_rehearsal(config))
        config = add_picking(config, self.arm.assembly)
        self.path = RecordedPath(config) if config.trajectory == "recorded" else WaypointPath(config)
        self._limits, self._clearances = self.arm.limits(config.limits), Clearances(config, self.arm)
        self._solve()
        self._check()

    @property
    def slowness(self) -> float:
        """Largest factor on time that the arm's limits demand."""
        return float(self._scales.max())

    def _solve(self) -> None:
        """Solve the path for joint angles."""
        path = self.path
        self._times = np.linspace(0.0, path.duration, int(np.ceil(path.duration / PATH_SAMPLING)) + 1)
        self._poses = [path.pose(t) for t in self._times]
        waypoints = [(min(int(np.searchsorted(self._times, t)), len(self._times) - 1), name)
                     for name, t in path.times.items()]
        self.solution = solve_path(self.arm, self._poses, waypoints, self._times[1] - self._times[0],
                                   clearance=lambda q: self._clearances.of_robot(q).distance)
        self._scales = compute_time_scale(self._times, self.solution.q, self._limits)
        """Factors (n,) on the time about each of `_times` that the arm's limits demand at least."""

    def _check(self) -> None:
        """Check that the motors hold the path's postures, the clearances along it and, at the end of the rest in which
        it begins, of a dose."""
        q, config = self.solution.q, self.path.config
        still = np.zeros(len(self.arm.joints))
        self._check_torques(self._times, [JointState(one, still, still) for one in q], "a lighter tool")
        self.clearance = self._clearances.check_path(self.path.times, self._times, q, self._poses)
        if config.dose is not None:
            self._clearances.check_dose(q[int(np.searchsorted(self._times, self.path.rests[config.dose_at][1]))])

    def _check_torques(self, times: np.ndarray, states: list[JointState], remedy: str) -> None:
        """Raise ConfigError where states at times (n,) [s] demand more than a motor has."""
        share, k, joint = self.arm.most_demanded(states)
        if share > 1.0:
            limit = self.arm.torque_limits[joint]
            raise ConfigError(f"near waypoint {find_nearest(self.path.times, times[k])!r} (t = {times[k]:.2f} s) joint "
                              f"{self.arm.joints[joint]} would need a torque of {share * limit:.3g} N m; accepted: up "
                              f"to {limit:.3g} N m; {remedy}")

    def time(self, most: float) -> Plan:
        """Put the joint path into time, a script slower by up to a factor where limits demand it; raises ConfigError.
        The path is solved again each time that it is slower."""
        path, reason = self.path, ConfigError("")
        for count in range(MAX_SLOWDOWNS):
            try:
                motion = SmoothMotion(self._times, self.solution.q, self._limits, path.times, self.arm.joints)
                times = np.arange(0.0, motion.duration, PATH_SAMPLING)
                self._check_torques(times, [motion.state(time) for time in times], "lower the speeds there")
            except ConfigError as error:
                reason = error
            else:
                if count > 0:
                    self._check()
                return Plan(path.config, path, self.solution, motion, self.arm, self.clearance,
                            path.time_scale if isinstance(path, WaypointPath) else 1.0)
            factors = self._scales / LIMIT_SHARE
            if factors.max() < LEAST_SLOWDOWN:
                factors = np.full_like(factors, LEAST_SLOWDOWN ** (count + 1))
            if isinstance(path, WaypointPath):
                needed = path.time_scale * float(factors.max())
                if needed > most:
                    raise ConfigError(f"{reason}, or allow the whole motion to be played slower (max_time_scale = "
                                      f"{path.config.max_time_scale:g}, needed: {needed:.3g})")
            path.slow_down(self._times, factors)
            self._solve()
        raise ConfigError(f"the motion is too fast for the arm even {path.time_scale:.1f} times slower: {reason}")


def plan_motion(config: RehearsalConfig) -> Plan:
    """Plan a rehearsal's motion, and the one from home to its start, if there is a way; errors of `plan_path`."""
    plan = plan_path(config)
    if config.tool_fill_height is not None and config.pick is None:
        return plan._replace(no_approach="the tool is full at the start: it is filled where the motion begins")
    try:
        return plan._replace(approach=plan_approach(plan.config, plan.arm, plan.motion.state(0.0).q))
    except ConfigError as error:
        return plan._replace(no_approach=str(error))


def plan_path(config: RehearsalConfig) -> Plan:
    """Plan the motion along a rehearsal's path.

    Tool path, joint path, and joint motion within the arm's limits, without a collision. Where the file leaves it open
    how the hand holds the handle, the turns of GRIP_TURNS_DEG are tried until one can be followed at full speed, away
    from the joints' limits; where none can, the fastest. Recorded motions are slowed down where the arm is too slow for
    them, scripts up to `max_time_scale`. Raises ConfigError or UnreachableWaypoint."""
    refused: list[ConfigError | UnreachableWaypoint] = []
    grips: list[Grip] = []
    for turn in GRIP_TURNS_DEG if config.grip_turn_deg is None else (config.grip_turn_deg,):
        try:
            grip = Grip(config.model_copy(update={"grip_turn_deg": turn}))
            grips.append(grip)
            if grip.slowness <= SLOWNESS and grip.solution.margin >= JOINT_MARGIN:
                return grip.time(1.0)
        except (ConfigError, UnreachableWaypoint) as error:
            refused.append(error)
    for grip in sorted(grips, key=lambda grip: (max(grip.slowness, 1.0), -grip.solution.margin)):
        try:
            return grip.time(config.max_time_scale)
        except (ConfigError, UnreachableWaypoint) as error:
            refused.append(error)
    if grips:
        raise refused[-1]
    # a grip that can be reached says more than one that cannot
    raise next((one for one in refused if not isinstance(one, UnreachableWaypoint)), refused[0])
