"""Environments with arms and tools of one's own."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from bundled import read_bundled
from grain_envs import make, play
from own_meshes import BOWL_MM, ladle_keys, write_bowl, write_ladle

from robosim import ConfigError, UnknownName
from robosim.config.tool import ToolConfig
from robosim.envs import TASKS
from robosim.envs.grain_env import GrainEnv
from robosim.scene.field import build_tool_lattice
from robosim.scene.grains import fill, grain_volume
from robosim.studies.evaluation.evaluate import evaluate
from robosim.tasks.counting import TOOL
from robosim.tasks.task import load_task

RADIUS = 0.08
"""Of the bowl, inside [m]."""
FLOOR, CENTRE = 0.008, 0.083
"""Heights [m] of its inner floor, which is the foot's upper face, and of the half sphere's centre."""


def segment(depth: float) -> float:
    """Return the volume [m^3] of the half sphere up to a height above its pole."""
    return np.pi * depth**2 * (RADIUS - depth / 3.0)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with both meshes and a file of the ladle, and a task in a folder below it."""
    write_ladle(tmp_path / "ladle.stl")
    write_bowl(tmp_path / "bowl.stl")
    (tmp_path / "ladle.yaml").write_text(yaml.safe_dump(ladle_keys("ladle.stl")))
    task = read_bundled("tasks", "SpoonScoop") | {
        "tool": "../ladle.yaml", "containers": {"bowl": {"mesh": "../bowl.stl", "scale": 1e-3, "yaw_deg": 90,
                                                         "position": [0.78, 0.0, 0.0], "fill_height": 0.06}}}
    (tmp_path / "tasks").mkdir()
    (tmp_path / "tasks" / "LadleScoop.yaml").write_text(yaml.safe_dump(task))
    return tmp_path


def test_grains_fill_a_round_bowl_up_to_their_height(folder: Path) -> None:
    """All of them lie in the half sphere, and together they have the volume of its part."""
    task = load_task(str(folder / "tasks" / "LadleScoop.yaml"))
    assert isinstance(task.tool, ToolConfig) and Path(task.tool.mesh) == folder / "ladle.stl"
    lowest = CENTRE - RADIUS
    expected = segment(FLOOR + 0.06 - lowest) - segment(FLOOR - lowest)
    assert grain_volume(task) * task.grains.count == pytest.approx(expected, rel=0.02)
    spacing = grain_volume(task) ** (1 / 3)
    grains = fill(task, build_tool_lattice(task), task.start.pose).positions
    centre = np.array([0.78, 0.0, CENTRE])
    assert len(grains) == task.grains.count
    assert np.linalg.norm(grains - centre, axis=1).max() < RADIUS + 0.002
    assert grains[:, 2].min() > FLOOR - 0.002 and grains[:, 2].max() < FLOOR + 0.06 + spacing


@pytest.mark.slow
def test_another_tool_in_a_sub_task(folder: Path) -> None:
    """The ladle is filled to its inner surface, and holds all of its grains while it stays level."""
    env = make("SpoonTranslate", tool=str(folder / "ladle.yaml"), action_repeat=250, obs="none")
    assert env.task.tool_name == "ladle"
    env.reset(seed=0, options={"nominal": True})
    pose = env.solver.collider_pose(TOOL)
    local = pose.inverse().apply(env.solver.positions())
    wall = np.linalg.norm(local, axis=1)[local[:, 2] < -0.004]
    assert len(wall) > 50 and wall.max() < 1e-3 * BOWL_MM + 0.002
    info = env.step(np.zeros(env.action_space.shape, np.float32))[4]
    assert info["readings"]["retained"] == 1.0 and info["readings"]["spilled"] == 0.0
    env.close()


def test_what_does_not_fit_is_refused_by_name(folder: Path) -> None:
    path = folder / "tasks" / "LadleScoop.yaml"
    text = path.read_text()
    for old, new, message in (("  bowl:", "  ladle:", "'ladle' is the tool's name"),
                              ("../ladle.yaml", "ladle.yaml", "tasks/ladle.yaml: no such file"),
                              ("../ladle.yaml", "ladel", "unknown tool 'ladel'; valid: bottle, scoop, shaker"),
                              ("../bowl.stl", "../bowl.step", "bowl.step")):
        path.write_text(text.replace(old, new))
        with pytest.raises(ConfigError, match=message):
            grain_volume(load_task(str(path)))


@pytest.mark.slow
def test_a_ladle_scoops_from_a_bowl(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """With the script of the spoon, whose size it has."""
    evaluate(str(folder / "tasks" / "LadleScoop.yaml"), "scripted", None, episodes=1, nominal=True, film=False)
    assert "success_rate                 1" in capsys.readouterr().out


SLOW = pytest.mark.slow


@pytest.mark.long
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


@pytest.mark.long
def test_what_is_wrong_with_an_arm_is_said() -> None:
    with pytest.raises(ConfigError, match="robot = 'panda', gripper = None with arm = False; accepted: arm = True"):
        GrainEnv(task="SpoonTranslate", robot="panda")
    with pytest.raises(UnknownName, match="unknown robot 'kuka'; valid: gen3, iiwa14, panda, ur5e, xarm7"):
        GrainEnv(task="SpoonTranslate", arm=True, robot="kuka")
