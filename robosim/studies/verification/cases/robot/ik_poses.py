"""Inverse kinematics of a thousand reachable poses, from mid-range and with restarts.

Measured: share of poses without a solution, mean and 95th percentile of the time [ms], and share of solutions that are
wrong. Reference: MuJoCo's forward kinematics; success and time of TRAC-IK on the same arm.
"""

import resource
import time

import mujoco
import numpy as np

from mpm import Pose
from mpm.geometry.rigid_motion import relative_rotation
from robosim.robot.assembly import assemble
from robosim.robot.inverse_kinematics import solve_pose
from robosim.robot.mjspec import compile_spec
from robosim.robot.model import Arm
from robosim.studies.verification.cases.claims import Within
from robosim.studies.verification.cases.record import Record

NAME = "ik_poses"
SOURCE = ("success and time of TRAC-IK on a KUKA LBR iiwa 14, 10 000 poses: 99.92 % and 0.28 ms at 1e-5 (README of "
          "TRAC-IK 1.5.1); poses are recomputed here by MuJoCo")
BANDS = {"failed": 0.005, "mean_ms": 2.0, "p95_ms": 10.0, "wrong": 0.0}
"""Share without a solution; milliseconds a pose; share of solutions that MuJoCo does not confirm."""
ARMS = ("iiwa14", "panda", "ur5e", "xarm7")
SWEEP = [{"restarts": n} for n in (1, 3, 10, 30)] + [{"restarts": 30, "robot": robot} for robot in ARMS[1:]]
"""Choices of the runs in a whole report."""
QUICK_SWEEP = [{"restarts": n, "poses": 300} for n in (1, 30)]
MAIN_ERROR, RESOLUTION = "failed", None
CLAIMS = tuple(Within(name, bound, {"restarts": 30}, low=0.0) for name, bound in BANDS.items())
ACCURACY = 1e-6
"""[m] and [rad] that MuJoCo's pose may be off."""


def measure(*, restarts: int = 30, poses: int = 1000, robot: str = "iiwa14") -> Record:
    """Run the case; return the shares of poses not solved and solved wrongly.

    restarts: most postures that a pose is solved from.
    """
    assembly = assemble("spoon", robot)
    spec = mujoco.MjSpec()
    assembly.attach_to(spec)
    arm, model = Arm(assembly), compile_spec(spec)
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    places = [model.joint(name).qposadr[0] for name in arm.joints]
    middle, half = 0.5 * (arm.lower + arm.upper), 0.5 * (arm.upper - arm.lower)
    seconds, failed, wrong, worst = [], 0, 0, 0.0
    for _ in range(poses):
        target = arm.tool_pose(rng.uniform(arm.lower, arm.upper))
        begin = time.perf_counter()
        for attempt in range(restarts):
            start = middle if attempt == 0 else middle + 0.9 * half * rng.uniform(-1.0, 1.0, len(half))
            solution = solve_pose(arm, target, start, rest=middle, iterations=60)
            if solution.converged:
                break
        seconds.append(time.perf_counter() - begin)
        if not solution.converged:
            failed += 1
            continue
        data.qpos[places] = solution.q
        mujoco.mj_kinematics(model, data)
        reached = Pose(data.body("spoon").xpos, data.body("spoon").xquat)
        error = max(np.linalg.norm(reached.position - target.position),
                    np.linalg.norm(relative_rotation(target.quaternion, reached.quaternion)))
        within = np.all(solution.q >= arm.lower) and np.all(solution.q <= arm.upper)
        wrong += int(error > ACCURACY or not within)
        worst = max(worst, float(error))
    times_ms = 1e3 * np.array(seconds)
    return Record(
        case=NAME, choices={"restarts": restarts, "poses": poses, "robot": robot}, particles=0, steps=poses,
        seconds=float(sum(seconds)), compile_seconds=0.0, errors={"failed": failed / poses, "wrong": wrong / poses},
        readings={"mean_ms": float(times_ms.mean()), "p95_ms": float(np.percentile(times_ms, 95)),
                  "worst_pose_error": worst},
        peak_bytes=resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024)
