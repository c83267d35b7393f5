"""Scooping with the whole arm within its limits."""

from typing import Any

import numpy as np

from robosim.envs.grain_env import GrainEnv
from robosim.episode.play import Transition, play
from robosim.studies.evaluation.policies import ScriptedPolicy
from robosim.studies.verification.cases.case import Record, TimedSolver, case, grid
from robosim.studies.verification.cases.expectations import each_within

TORQUES = np.array([320.0, 320.0, 176.0, 176.0, 110.0, 40.0, 40.0])
SPEEDS = np.radians([85.0, 85.0, 100.0, 75.0, 130.0, 135.0, 135.0])
"""[N m], [rad/s]"""


@case(
    source="KUKA LBR iiwa 14 R820 data sheet: torques and speeds of A1 to A7",
    sweep=grid(task=("SpoonScoop", "ScoopScoop"), material=("salt", "sugar", "flour")),
    quick=[{"task": "SpoonScoop", "material": "salt"}],
    expectations=each_within({"torque": 0.0, "speed": 0.0, "saturated": 0.0}, low=-1.0),
    main_error="torque", units={"saturated": "steps"})
def arm_limits(*, task: str = "SpoonScoop", material: str = "salt") -> Record:
    """Scooping with the whole arm within its limits.

    Measured: relative excess of motor torques and joint speeds over their limits in every step of 2 ms of the task's
    scripted policy, and steps in which a torque was saturated."""
    env: Any = GrainEnv(task=task, arm=True, material=material, action_repeat=1)
    env.reset(options={"nominal": True})
    cell, timed, most, info = env.carrier.cell, TimedSolver(env.solver), np.zeros(2), {}

    def measure(_: Transition) -> None:
        ratios = cell.servo.demanded_torque / TORQUES, cell.data.qvel[cell.scene.arm_dofs] / SPEEDS
        most[:] = np.maximum(most, np.abs(ratios).max(1))

    timed.run(lambda: info.update(play(env, ScriptedPolicy(env), observation=env.observation, hooks=[measure])[1]))
    errors = {"torque": most[0] - 1.0, "speed": most[1] - 1.0, "saturated": cell.servo.saturations}
    return timed.record(errors, score=info["tcs"], tool_lag_m=env.carrier.arm_readings["tool_lag_max_m"])
