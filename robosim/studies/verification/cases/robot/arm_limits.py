"""Scooping with the whole arm within its limits."""

from typing import Any

import gymnasium
import numpy as np

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
    scripted policy, and steps in which a torque was saturated.
    """
    import robosim  # noqa: F401  (its environments are registered with it)

    env: Any = gymnasium.make(f"robosim/{task}-v0", arm=True, material=material, action_repeat=1).unwrapped
    env.reset(options={"nominal": True})
    carrier, script, timed = env.carrier, ScriptedPolicy(env), TimedSolver(env.solver)
    torque, speed, over, info = 0.0, 0.0, False, {}

    def step() -> None:
        nonlocal over, info
        _, _, ended, cut, info = env.step(script(env.observation))
        over = ended or cut

    while not over:
        timed.run(step)
        torque = max(torque, float(np.abs(carrier.cell.servo.demanded_torque / TORQUES).max()))
        speed = max(speed, float(np.abs(carrier.cell.data.qvel[carrier.cell.scene.arm_dofs] / SPEEDS).max()))
    errors = {"torque": torque - 1.0, "speed": speed - 1.0, "saturated": carrier.cell.servo.saturations}
    return timed.record(errors, score=info["tcs"], tool_lag_m=carrier.arm_readings["tool_lag_max_m"])
