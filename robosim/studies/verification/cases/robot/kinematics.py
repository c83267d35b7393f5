"""Inverse kinematics, smooth motions and dynamics of the arm."""

import time

import mujoco
import numpy as np
import pinocchio

from mpm import Pose
from mpm.geometry.rigid_motion import relative_rotation
from robosim.config.rehearsal import load_rehearsal
from robosim.robot.inverse_kinematics import solve_pose
from robosim.robot.mjspec import compile_spec
from robosim.robot.model import Arm
from robosim.robot.timing import SmoothMotion
from robosim.scene.models import assemble
from robosim.studies.verification.cases.case import Cost, Record, case, make_record
from robosim.studies.verification.cases.expectations import each_within


@case(
    source="success and time of TRAC-IK on a KUKA LBR iiwa 14, 10 000 poses: 99.92 % and 0.28 ms at 1e-5 (README of "
           "TRAC-IK 1.5.1); poses are recomputed here by MuJoCo",
    sweep=[*({"restarts": n} for n in (1, 3, 10, 30)),
           *({"restarts": 30, "robot": robot} for robot in ("gen3", "panda", "ur5e", "xarm7"))],
    quick=[{"restarts": n, "poses": 300} for n in (1, 30)],
    expectations=each_within({"failed": 0.005, "mean_ms": 2.0, "p95_ms": 10.0, "wrong": 0.0}, {"restarts": 30}, 0.0),
    main_error="failed", units={"mean_ms": "ms", "p95_ms": "ms"})
def ik_poses(*, restarts: int = 30, poses: int = 1000, robot: str = "iiwa14") -> Record:
    """Inverse kinematics of a thousand reachable poses, from mid-range and with restarts.

    Measured: share of poses without a solution, mean and 95th percentile of the time [ms], and share of solutions that
    MuJoCo's forward kinematics does not confirm. restarts: most postures that a pose is solved from."""
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
        wrong += int(error > 1e-6 or not within)
        worst = max(worst, float(error))
    times_ms = 1e3 * np.array(seconds)
    return make_record([Cost(0, poses, float(sum(seconds)))], {"failed": failed / poses, "wrong": wrong / poses},
                       mean_ms=times_ms.mean(), p95_ms=np.percentile(times_ms, 95), worst_pose_error=worst)


@case(
    source="the limits themselves; between the samples of a motion of bounded jerk, mean jerk is bounded by the same",
    sweep=[{"host_dt": dt} for dt in (1e-3, 2e-3, 5e-3)], quick=[{"host_dt": 1e-3, "motions": 5}],
    expectations=each_within({"velocity": 1e-9, "acceleration": 1e-9, "jerk": 1e-6, "end": 1e-7}),
    main_error="jerk", units={"end": "rad"})
def jerk_limits(*, host_dt: float = 1e-3, motions: int = 20) -> Record:
    """Smoothed joint motions at the controller's samples, every host_dt [s].

    Measured: relative excess of speed, acceleration and jerk over their limits, and the error [rad] of the end, on
    random smooth joint paths of two seconds."""
    arm, rng = Arm(assemble("spoon")), np.random.default_rng(0)
    limits = arm.limits(load_rehearsal("spoon").limits)
    most, end, samples, begin = dict[str, float](), 0.0, 0, time.perf_counter()
    for _ in range(motions):
        times = np.linspace(0.0, 2.0, 201)
        u = times / 2.0
        ease = u**3 * (10 - 15 * u + 6 * u * u)
        reach = rng.uniform(0.6, 0.85, 7) * limits.velocity * rng.choice([-1.0, 1.0], 7)  # peaks at 1.1 to 1.6 rad/s
        q = rng.uniform(-0.5, 0.5, 7) + ease[:, None] * reach + np.sin(np.pi * ease)[:, None] ** 2 * 0.1 * reach
        motion = SmoothMotion(times, q, limits, {"end": 2.0}, arm.joints)
        states = [motion.state(t) for t in np.arange(0.0, motion.duration + host_dt, host_dt)]
        samples += len(states)
        qd, qdd = np.array([s.qd for s in states]), np.array([s.qdd for s in states])
        jerk = np.abs(np.diff(qdd, axis=0)) / host_dt
        for name, values in (("velocity", np.abs(qd)), ("acceleration", np.abs(qdd)), ("jerk", jerk)):
            most[name] = max(most.get(name, 0.0), float((values / getattr(limits, name)).max()))
        end = max(end, float(np.abs(states[-1].q - q[-1]).max()))
    errors = {name: max(share - 1.0, 0.0) for name, share in most.items()}
    return make_record([Cost(0, samples, time.perf_counter() - begin)], errors | {"end": end},
                       **{f"{name}_share": share for name, share in most.items()})


@case(
    source="two independent implementations of rigid-body dynamics (Featherstone 2008) on one MJCF file",
    sweep=[{"states": 500}], quick=[{"states": 500}],
    # mass matrix and bias torques relative to their largest entries
    expectations=each_within({"mass": 1e-10, "bias": 1e-10, "pose": 1e-10}), main_error="mass", units={"pose": "m"})
def two_models(*, states: int = 500) -> Record:
    """Pinocchio and MuJoCo on the same robot.

    Measured: largest differences of mass matrix, bias torques and tool pose in random states of arm, fingers and tool.
    """
    assembly = assemble("spoon")
    model, arm, rng = compile_spec(assembly.build_spec()), Arm(assembly), np.random.default_rng(7)
    data = mujoco.MjData(model)
    joints = [arm.model.joints[arm.model.getJointId(model.joint(j).name)] for j in range(model.njnt)]
    q_index, v_index = np.array([(joint.idx_q, joint.idx_v) for joint in joints]).T
    worst, begin = np.zeros(3), time.perf_counter()
    for _ in range(states):
        data.qpos[:] = rng.uniform(model.jnt_range[:, 0], model.jnt_range[:, 1])
        data.qvel[:] = rng.uniform(-1.0, 1.0, model.nv)
        mujoco.mj_forward(model, data)
        M, q, v = np.zeros((model.nv, model.nv)), np.zeros(arm.model.nq), np.zeros(arm.model.nv)
        mujoco.mj_fullM(model, data, M)
        q[q_index], v[v_index] = data.qpos, data.qvel
        P = pinocchio.crba(arm.model, arm.data, q)
        P = np.triu(P) + np.triu(P, 1).T
        bias = pinocchio.nonLinearEffects(arm.model, arm.data, q, v)
        pinocchio.forwardKinematics(arm.model, arm.data, q)
        place = pinocchio.updateFramePlacement(arm.model, arm.data, arm.frame)
        tool = data.body("spoon")
        worst = np.maximum(worst, [
            np.abs(P[np.ix_(v_index, v_index)] - M).max() / np.abs(M).max(),
            np.abs(bias[v_index] - data.qfrc_bias).max() / np.abs(data.qfrc_bias).max(),
            max(np.abs(place.translation - tool.xpos).max(), np.abs(place.rotation.ravel() - tool.xmat).max())])
    return make_record([Cost(0, states, time.perf_counter() - begin)], dict(zip(("mass", "bias", "pose"), worst)))
