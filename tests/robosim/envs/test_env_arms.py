"""Sub-tasks with other arms and hands: the scripted motion scores as the tool alone, or the joint is named."""

import pytest

from robosim import ConfigError, UnknownName
from robosim.envs.grain_env import GrainEnv
from robosim.studies.evaluation.policies import make_policy


def score(task: str, **options) -> tuple[float, dict[str, float]]:
    """Return the score of the scripted motion from the nominal start, and the arm's readings."""
    env = GrainEnv(task=task, **options)
    _, info = env.reset(seed=0, options={"nominal": True})
    policy, over = make_policy("scripted", env, 0), False
    while not over:
        _, _, terminated, truncated, info = env.step(policy(env.observation))
        over = terminated or truncated
    env.close()
    return env.reward.tcs, info.get("arm", {})


SLOW = pytest.mark.slow


@pytest.mark.parametrize(("robot", "gripper"), [
    ("ur5e", None), pytest.param("panda", None, marks=SLOW), pytest.param("xarm7", "none", marks=SLOW),
    pytest.param("iiwa14", "robotiq_3f", marks=SLOW)])
def test_an_arm_scores_as_the_tool_alone(robot: str, gripper: str | None) -> None:
    alone, _ = score("SpoonTranslate")
    carried, arm = score("SpoonTranslate", arm=True, robot=robot, gripper=gripper)
    assert carried == pytest.approx(alone, rel=0.03)
    assert arm["tool_lag_max_m"] < 3e-3 and arm["torque_limit_ratio_max"] < 1.0 and arm["surroundings_contacts"] == 0


@pytest.mark.slow
def test_the_joint_that_cannot_follow_is_named() -> None:
    """A wrist that accelerates at 5 rad/s^2 turns the spoon too late: its sixth joint is behind by tens of degrees."""
    _, arm = score("SpoonPour", arm=True, robot="ur5e")
    assert arm["slowest_joint"] == 6 and arm["joint_lag_max_deg"] > 10.0


def test_what_is_wrong_with_an_arm_is_said() -> None:
    with pytest.raises(ConfigError, match="robot = 'panda', gripper = None with arm = False; accepted: arm = True"):
        GrainEnv(task="SpoonTranslate", robot="panda")
    with pytest.raises(UnknownName, match="unknown robot 'kuka'; valid: iiwa14, panda, ur5e, xarm7"):
        GrainEnv(task="SpoonTranslate", arm=True, robot="kuka")
