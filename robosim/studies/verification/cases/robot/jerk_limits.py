"""Smoothed joint motions at the controller's samples.

Measured: relative excess of speed, acceleration and jerk over their limits, and the error [rad] of the end. Reference:
the limits; between the samples of a motion of bounded jerk, the mean jerk has the same bound.
"""

import time

import numpy as np

from robosim.config.rehearsal import load_rehearsal
from robosim.robot.model import Arm
from robosim.robot.timing import SmoothMotion
from robosim.scene.models import assemble
from robosim.studies.verification.cases.case import Cost, Record, case, make_record
from robosim.studies.verification.cases.expectations import each_within


@case(
    source="the limits themselves; between the samples of a motion of bounded jerk, mean jerk is bounded by the same",
    sweep=[{"host_dt": dt} for dt in (1e-3, 2e-3, 5e-3)],
    quick=[{"host_dt": 1e-3, "motions": 5}],
    expectations=each_within({"velocity": 1e-9, "acceleration": 1e-9, "jerk": 1e-6, "end": 1e-7}),
    main_error="jerk", units={"end": "rad"})
def measure(*, host_dt: float = 1e-3, motions: int = 20) -> Record:
    """Run the case on random smooth joint paths of two seconds, at samples every host_dt [s]."""
    arm, rng = Arm(assemble("spoon")), np.random.default_rng(0)
    limits = arm.limits(load_rehearsal("spoon").limits)
    speed = limits.velocity
    worst, most = dict[str, float](velocity=0.0, acceleration=0.0, jerk=0.0, end=0.0), {}
    begin, samples = time.perf_counter(), 0
    for _ in range(motions):
        times = np.linspace(0.0, 2.0, 201)
        u = times / 2.0
        ease = u**3 * (10 - 15 * u + 6 * u * u)
        reach = rng.uniform(0.6, 0.85, 7) * speed * rng.choice([-1.0, 1.0], 7)  # peaks at 1.1 to 1.6 rad/s
        q = rng.uniform(-0.5, 0.5, 7) + ease[:, None] * reach + np.sin(np.pi * ease)[:, None] ** 2 * 0.1 * reach
        motion = SmoothMotion(times, q, limits, {"end": 2.0}, arm.joints)
        states = [motion.state(t) for t in np.arange(0.0, motion.duration + host_dt, host_dt)]
        samples += len(states)
        qd, qdd = np.array([s.qd for s in states]), np.array([s.qdd for s in states])
        jerk = np.abs(np.diff(qdd, axis=0)) / host_dt
        for name, values, limit in (("velocity", np.abs(qd), speed), ("acceleration", np.abs(qdd), limits.acceleration),
                                    ("jerk", jerk, limits.jerk)):
            share = float((values / limit).max())
            worst[name], most[name] = max(worst[name], share - 1.0, 0.0), max(most.get(name, 0.0), share)
        worst["end"] = max(worst["end"], float(np.abs(states[-1].q - q[-1]).max()))
    return make_record([Cost(0, samples, time.perf_counter() - begin)], worst,
                       {f"{name}_share": value for name, value in most.items()})
