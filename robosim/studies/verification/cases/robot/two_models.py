"""Pinocchio and MuJoCo on the same robot.

Measured: largest differences of mass matrix, bias torques and tool pose in random states. Reference: each of the two
independent implementations is the other's.
"""

import time

import mujoco
import numpy as np
import pinocchio

from robosim.robot.mjspec import compile_spec
from robosim.robot.model import Arm
from robosim.scene.models import assemble
from robosim.studies.verification.cases.case import Cost, Record, case, make_record
from robosim.studies.verification.cases.expectations import each_within


@case(
    source="two independent implementations of rigid-body dynamics (Featherstone 2008) on one MJCF file",
    sweep=[{"states": 500}], quick=[{"states": 500}],
    # mass matrix and bias torques relative to their largest entries
    expectations=each_within({"mass": 1e-10, "bias": 1e-10, "pose": 1e-10}),
    main_error="mass", units={"pose": "m"})
def measure(*, states: int = 500) -> Record:
    """Run the case; return the largest differences over random states of arm, fingers and tool."""
    assembly = assemble("spoon")
    model, arm, rng = compile_spec(assembly.build_spec()), Arm(assembly), np.random.default_rng(7)
    data = mujoco.MjData(model)
    ids = [arm.model.getJointId(model.joint(j).name) for j in range(model.njnt)]
    q_index = np.array([arm.model.joints[i].idx_q for i in ids])
    v_index = np.array([arm.model.joints[i].idx_v for i in ids])
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
    return make_record([Cost(0, states, time.perf_counter() - begin)], dict(zip(("mass", "bias", "pose"), worst)), {})
