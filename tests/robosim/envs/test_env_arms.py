"""Sub-tasks with arms and hands: the scripted motion scores as the tool alone, or the joint is named."""

import pytest
from grain_envs import make, play

from robosim import ConfigError, UnknownName
from robosim.envs import TASKS
from robosim.envs.grain_env import GrainEnv

SLOW = pytest.mark.slow


@pytest.mark.parametrize(("task", "robot", "gripper"), [
    ("SpoonTranslate", "ur5e", None), pytest.param("SpoonTranslate", "panda", None, marks=SLOW),
    pytest.param("SpoonTranslate", "xarm7", "none", marks=SLOW),
    *(pytest.param("SpoonTranslate", *arm, marks=SLOW) for arm in (("iiwa14", "robotiq_3f"), ("gen3", None))),
    *(pytest.param(task, "iiwa14", None, marks=SLOW) for task in TASKS)])
def test_an_arm_scores_as_the_tool_alone(task: str, robot: str, gripper: str | None) -> None:
    """The same script, observation and actions: the score differs by a tenth of its range at most, or by 3 %."""
    alone, carried = make(task), make(task, arm=True, robot=robot, gripper=gripper)
    assert (alone.observation_space, alone.action_space) == (carried.observation_space, carried.action_space)
    (_, expected, _), (_, info, _) = (play(env, options={"nominal": True}) for env in (alone, carried))
    low, high = alone.reward.extremes()
    near = 0.03 * abs(expected["tcs"]) if task == "SpoonTranslate" else 0.1 * (high - low)
    assert abs(info["tcs"] - expected["tcs"]) < near
    arm = info["arm"]
    assert info["is_success"] and expected["is_success"] and "arm" not in expected
    assert 0.1 < arm["torque_limit_ratio_max"] < 1.0 and arm["surroundings_contacts"] == 0
    assert arm["tool_lag_max_m"] < 3e-3 or task != "SpoonTranslate"
    for env in (alone, carried):
        env.close()


@pytest.mark.slow
def test_the_joint_that_cannot_follow_is_named() -> None:
    """A wrist that accelerates at 5 rad/s^2 turns the spoon too late: its sixth joint is behind by tens of degrees."""
    arm = play(make("SpoonPour", arm=True, robot="ur5e"), options={"nominal": True})[1]["arm"]
    assert arm["slowest_joint"] == 6 and arm["joint_lag_max_deg"] > 10.0


@pytest.mark.slow
@pytest.mark.parametrize("name", ["SpoonTranslate", "SpoonPour", "BottlePickPour", "ShovelMove"])
def test_the_fingers_hold_the_tool_by_friction(name: str) -> None:
    env = make(name, arm=True, grasp="friction")
    _, info, _ = play(env)
    assert info["is_success"]
    assert 0 < env.carrier.cell.grasp.slip < 0.003  # pyright: ignore[reportAttributeAccessIssue]


def test_what_is_wrong_with_an_arm_is_said() -> None:
    with pytest.raises(ConfigError, match="robot = 'panda', gripper = None with arm = False; accepted: arm = True"):
        GrainEnv(task="SpoonTranslate", robot="panda")
    with pytest.raises(UnknownName, match="unknown robot 'kuka'; valid: gen3, iiwa14, panda, ur5e, xarm7"):
        GrainEnv(task="SpoonTranslate", arm=True, robot="kuka")
